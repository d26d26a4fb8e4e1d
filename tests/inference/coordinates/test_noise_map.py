"""Coordinates in which the parameters of correlated noise can be sampled, whatever its correlation time."""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache

import numpy as np
import pytest
from scipy.special import ndtr

from bayesdamp.inference.coordinates.whitening import NoiseMap
from bayesdamp.inference.evidence import Draws
from bayesdamp.inference.evidence.methods import bridge, importance
from bayesdamp.inference.fit.mode import Mode
from bayesdamp.inference.fit.search import find_mode
from bayesdamp.inference.model.target import Target
from bayesdamp.inference.samplers import Settings, nuts
from bayesdamp.physics.oscillator import Oscillator
from bayesdamp.priors import HalfNormal, LogNormal, LogUniform, Normal
from bayesdamp.types import OK, Seed, Signal

TRUTH = {"zeta": 0.05, "theta0": 0.3, "omega0": 0.0}
K, SD, TIME = 20.0, 0.01, 8.0


@lru_cache
def slow(kind: type = LogUniform) -> tuple[Target, Mode]:
    """A viscous record in noise (Ornstein and Uhlenbeck's) that is slower than it may be: its time lies at the end of
    its prior, and its size at what that leaves."""
    rng = np.random.default_rng(4)
    t = np.arange(0, 20, 0.02)
    omega = np.sqrt(K - TRUTH["zeta"] ** 2)
    y = 0.3 * np.exp(-0.05 * t) * (np.cos(omega * t) + 0.05 / omega * np.sin(omega * t))
    rho = np.exp(-0.02 / TIME)
    noise = np.empty(t.size)
    noise[0] = SD * rng.standard_normal()
    for i in range(1, t.size):
        noise[i] = rho * noise[i - 1] + SD * np.sqrt(1 - rho**2) * rng.standard_normal()
    priors = {
        "zeta": HalfNormal(scale=1.0),
        "theta0": Normal(mean=0.0, sd=1.0),
        "omega0": Normal(mean=0.0, sd=3.0),
        "noise_sd": LogNormal(median=0.001, sigma=1.0),
        "noise_time": LogUniform(low=1e-3, high=2.8)
        if kind is LogUniform
        else LogNormal(median=1.0, sigma=1.0),
    }
    oscillator = Oscillator(("viscous",), "linear")
    known = {"stiffness": K, "rest_angle": 0.0}
    target = Target(Signal(t, y + noise, "angle"), oscillator, "correlated", priors, known)
    start = {**TRUTH, "noise_sd": 0.005, "noise_time": 1.0}
    return target, find_mode(target, {Seed("truth"): start}, noise_level=0.001)


@lru_cache
def of_noise_alone(correlation_time: float | None) -> tuple[Target, Mode]:
    """A record of 150 samples of a known motion; its noise has this correlation time, or is white."""
    t = np.linspace(0.0, 6.0, 150)
    y = simulated_noise(t, correlation_time)
    priors = {
        "noise_sd": LogNormal(median=0.003, sigma=1.0),
        "noise_time": LogUniform(low=7e-4, high=2.8),
    }
    known = {"stiffness": K, "rest_angle": 0.0, "zeta": 0.05, "theta0": 0.0, "omega0": 0.0}
    target = Target(Signal(t, y, "angle"), Oscillator(("viscous",), "linear"), "correlated", priors, known)
    start = {"noise_sd": 0.003, "noise_time": correlation_time or 0.005}
    return target, find_mode(target, {Seed("truth"): start}, noise_level=0.003)


def simulated_noise(t: np.ndarray, correlation_time: float | None) -> np.ndarray:
    """Normal noise of sd 0.003, white where it has no correlation time."""
    white = np.random.default_rng(4).standard_normal(t.size)
    if correlation_time is None:
        return 0.003 * white
    kernel = np.exp(-np.abs(t[:, None] - t) / correlation_time)
    return 0.003 * np.linalg.cholesky(kernel) @ white


def quadrature(target: Target, mode: Mode) -> tuple[np.ndarray, np.ndarray, float]:
    """Scores of the time, its cumulative probability there, and the log evidence, by sums over a grid."""
    sd, time = np.linspace(-3.0, 5.0, 500), np.linspace(-6.0, 4.0, 800)
    z = np.stack(np.meshgrid(sd, time, indexing="ij"), axis=-1).reshape(-1, 2)
    residual, gaps = mode.likelihood.residual(mode.z), mode.likelihood.gaps
    values = target.values(z)
    each = [target.noise_model.log_likelihood(residual, gaps, values) + mode.likelihood.log_prior(z)]
    height = np.reshape(each, (sd.size, time.size))
    density = np.exp(height - height.max()).sum(axis=0)
    cell = (sd[1] - sd[0]) * (time[1] - time[0])
    cumulative = (np.cumsum(density) - 0.5 * density) / density.sum()
    return time, cumulative, float(np.log(density.sum() * cell) + height.max())


@pytest.mark.parametrize("correlation_time", [None, 0.03, 2.0])
def test_the_level_score_of_the_time_is_standard_normal(correlation_time: float | None) -> None:
    """Against quadrature, within 0.02 in probability; the control, a normal distribution about the mode, is far off
    where the noise is white."""
    target, mode = of_noise_alone(correlation_time)
    time, cumulative, _ = quadrature(target, mode)
    z = np.stack([np.full(time.size, mode.z[0]), time], axis=-1)
    level = NoiseMap.of(target, mode).level(z)[:, 1]
    np.testing.assert_allclose(ndtr(level), cumulative, atol=0.02)
    if correlation_time is None:
        assert np.max(np.abs(ndtr((time - mode.z[1]) / mode.sd()[1]) - cumulative)) > 0.2


@pytest.mark.parametrize("correlation_time", [None, 0.03, 2.0])
def test_evidence_and_time_under_any_correlation(correlation_time: float | None) -> None:
    """NUTS and the bridge against quadrature, within 4 standard errors, and draws that are as good as independent."""
    target, mode = of_noise_alone(correlation_time)
    time, cumulative, log_evidence = quadrature(target, mode)
    posterior = nuts.PLUGIN.sample(target, mode, Settings(chains=4, warmup=50, draws=300, seed=1))
    assert posterior.outcome == OK
    assert posterior.summaries["noise_time"]["ess_bulk"] > 600
    assert np.mean(posterior.stats["n_steps"]) < 6
    drawn = posterior.draws[..., posterior.names.index("noise_time")]
    median = float(target.priors["noise_time"].value(np.interp(0.5, cumulative, time)))
    below = drawn < median
    error = 0.5 / np.sqrt(posterior.summaries["noise_time"]["ess_bulk"])
    assert abs(below.mean() - 0.5) < 4 * error
    draws = Draws.of(target, posterior.draws, OK)
    bridged = bridge.PLUGIN.evidence("m", target, mode, 5, draws)
    assert bridged.stderr < 0.05
    assert abs(bridged.log_evidence - log_evidence) < 4 * bridged.stderr


def test_without_the_map_the_time_of_white_noise_hardly_moves(monkeypatch: pytest.MonkeyPatch) -> None:
    target, mode = of_noise_alone(None)
    settings = Settings(chains=4, warmup=50, draws=300, seed=1)
    mapped = nuts.PLUGIN.attempt(mode, nuts.whitening_of(target, mode), settings).posterior(mode)
    monkeypatch.setattr(NoiseMap, "of", classmethod(lambda cls, target, mode: cls()))
    plain = nuts.PLUGIN.attempt(mode, nuts.whitening_of(target, mode), settings).posterior(mode)
    assert plain.summaries["noise_time"]["ess_bulk"] < 0.4 * mapped.summaries["noise_time"]["ess_bulk"]


def test_the_level_score_of_the_size_follows_the_ridge() -> None:
    """Where the noise is slow, noise_sd²/noise_time is nearly constant at a level score; in scores it is not."""
    target, mode = slow()
    noise = NoiseMap.of(target, mode)
    level = np.tile(noise.level(mode.z), (30, 1))
    level[:, 4] = np.linspace(-2, 2, 30)

    def log_ratio(scores: np.ndarray) -> np.ndarray:
        values = target.values(scores)
        return 2 * np.log(values["noise_sd"]) - np.log(values["noise_time"])

    scores = noise.scores(level)
    plain = scores.copy()
    plain[:, 3] = mode.z[3]
    assert np.ptp(log_ratio(scores)) < 0.2 * np.ptp(log_ratio(plain))


def test_the_map_and_its_derivatives() -> None:
    for target, mode in (slow(), of_noise_alone(None)):
        noise, d = NoiseMap.of(target, mode), mode.z.size
        level = noise.level(mode.z) + np.random.default_rng(0).standard_normal((7, d))
        level[0, -1], level[1, -1] = 7.0, -7.0  # on the straight lines
        np.testing.assert_allclose(noise.level(noise.scores(level)), level, atol=1e-9)
        steps = 1e-5 * np.eye(d)
        measured = np.stack(
            [(noise.scores(level + e) - noise.scores(level - e)) / 2e-5 for e in steps], axis=-1
        )
        np.testing.assert_allclose(noise.slope(level), measured, rtol=1e-5, atol=1e-5)
        np.testing.assert_array_equal(noise.slope(level)[2], noise.slope(level[2]))
        np.testing.assert_allclose(noise.log_volume(level), np.linalg.slogdet(noise.slope(level))[1])
        rises = [(noise.log_volume(level + e) - noise.log_volume(level - e)) / 2e-5 for e in steps]
        for row, rise in zip(level[2:], np.transpose(rises)[2:], strict=True):
            np.testing.assert_allclose(noise.volume_slope(row), rise, atol=1e-2)


def test_other_priors_are_mapped_and_other_noises_left_alone() -> None:
    target, mode = slow(LogNormal)
    assert NoiseMap.of(target, mode).table is not None
    known = {**target.known, "noise_time": 1.0}
    priors = {n: p for n, p in target.priors.items() if n != "noise_time"}
    assert NoiseMap.of(replace(target, priors=priors, known=known), mode).table is None
    assert NoiseMap.of(replace(target, noise="gaussian"), mode).table is None


def test_slow_noise_is_sampled(monkeypatch: pytest.MonkeyPatch) -> None:
    """NUTS by the cheap force; its mean of the noise's time against importance draws, within
    five of its errors, and the two evidences within four. Negative control: without the map the noise's size and time
    hardly move, and the bridge is half as good."""
    target, mode = slow()
    settings = Settings(chains=4, warmup=100, draws=400, seed=2)
    at = nuts.whitening_of(target, mode)
    posterior = nuts.PLUGIN.attempt(mode, at, settings).posterior(mode)
    assert not nuts.poor(posterior)
    summary = posterior.summaries["noise_time"]
    assert summary["ess_bulk"] > 300
    weighed = importance.PLUGIN.evidence("m", target, mode, 5)
    assert weighed.outcome == OK
    weights = np.exp(weighed.arrays["log_weights"] - weighed.arrays["log_weights"].max())
    times = target.values(weighed.arrays["y"])["noise_time"]
    mean = np.average(times, weights=weights)
    error = np.std(times) * np.sqrt(1 / summary["ess_bulk"] + 1 / 1000)
    drawn = posterior.draws[..., posterior.names.index("noise_time")]
    assert abs(drawn.mean() - mean) < 5 * error
    draws = Draws.of(target, posterior.draws, OK)
    bridged = bridge.PLUGIN.evidence("m", target, mode, 5, draws)
    assert abs(bridged.log_evidence - weighed.log_evidence) < 4 * np.hypot(bridged.stderr, weighed.stderr)
    monkeypatch.setattr(NoiseMap, "of", classmethod(lambda cls, target, mode: cls()))
    at = nuts.whitening_of(target, mode)
    plain = nuts.PLUGIN.attempt(mode, at, settings, shorter=0.5).posterior(mode)
    assert plain.summaries["noise_time"]["ess_bulk"] < 0.2 * summary["ess_bulk"]
    assert bridge.PLUGIN.evidence("m", target, mode, 5, draws).stderr > 1.5 * bridged.stderr
