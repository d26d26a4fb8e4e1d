"""Noise of which the data tell a ratio alone, and the coordinates in which it can be sampled."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
import pytest

from bayesdamp.inference.coordinates.whitening import NoiseShear, shear_of
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


def test_a_lift_holds_the_ratio() -> None:
    """Along level lines noise_sd²/noise_time is exponential in the time's score, as if the prior never levelled off;
    the control: in scores it is not."""
    target, mode = slow()
    tied = NoiseShear.of(target, mode)
    z = np.tile(mode.z, (50, 1))
    z[:, 4] += np.linspace(-3, 3, 50)
    away = z[:, 4] - mode.z[4]

    def log_ratio(scores: np.ndarray) -> np.ndarray:
        values = target.values(scores)
        return 2 * np.log(values["noise_sd"]) - np.log(values["noise_time"])

    line = np.polynomial.Polynomial.fit(away, log_ratio(tied.sheared(z)), 1)
    np.testing.assert_allclose(line(away), log_ratio(tied.sheared(z)), atol=1e-9)
    plain = np.polynomial.Polynomial.fit(away, log_ratio(z), 1)
    assert np.max(np.abs(plain(away) - log_ratio(z))) > 0.1


def test_a_lift_keeps_volumes_and_is_flat_at_the_mode() -> None:
    target, mode = slow()
    tied = NoiseShear.of(target, mode)
    z = mode.z + np.random.default_rng(0).standard_normal((7, 5))
    np.testing.assert_allclose(tied.level(tied.sheared(z)), z, atol=1e-12)
    steps = 1e-5 * np.eye(5)
    measured = np.stack([(tied.sheared(z + e) - tied.sheared(z - e)) / 2e-5 for e in steps], axis=-1)
    np.testing.assert_allclose(tied.slope(z), measured, atol=1e-9)
    np.testing.assert_array_equal(tied.slope(z)[0], tied.slope(z[0]))
    assert np.linalg.det(tied.slope(z)) == pytest.approx(np.ones(7))
    np.testing.assert_allclose(tied.slope(mode.z), np.eye(5), atol=1e-12)
    assert np.max(np.abs(measured - np.eye(5))) > 0.1


def test_other_priors_and_noises_are_left_alone() -> None:
    target, mode = slow(LogNormal)
    assert not np.any(NoiseShear.of(target, mode).moved)
    assert np.any(NoiseShear.of(*slow()).moved)


def test_a_straightened_ridge_keeps_the_lift() -> None:
    """A ridge's shear and its noise's shear together."""
    target, mode = slow()
    ridge = shear_of(target, mode)
    assert ridge is not None
    assert np.any(ridge.curve)
    np.testing.assert_array_equal(ridge.noise.moved, NoiseShear.of(target, mode).moved)
    z = mode.z + mode.sd()
    np.testing.assert_allclose(ridge.straight(ridge.scores(z)), z, atol=1e-12)
    assert np.max(np.abs(ridge.level(z) - ridge.scores(z))) > 1e-3


def test_slow_noise_is_sampled(monkeypatch: pytest.MonkeyPatch) -> None:
    """NUTS by the cheap force, at half its usual step; its mean of the noise's time against importance draws, within
    five of its errors, and the two evidences within four. Negative control: without the shear the noise's size and time
    hardly move, and the bridge is half as good."""
    target, mode = slow()
    settings = Settings(chains=4, warmup=100, draws=400, seed=2)
    at = nuts.whitening_of(target, mode)
    posterior = nuts.PLUGIN.attempt(mode, at, settings, shorter=0.5).posterior(mode)
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
    monkeypatch.setattr(NoiseShear, "of", classmethod(lambda cls, target, mode: cls.none(mode.z.size)))
    at = nuts.whitening_of(target, mode)
    plain = nuts.PLUGIN.attempt(mode, at, settings, shorter=0.5).posterior(mode)
    assert plain.summaries["noise_time"]["ess_bulk"] < 0.2 * summary["ess_bulk"]
    assert bridge.PLUGIN.evidence("m", target, mode, 5, draws).stderr > 1.5 * bridged.stderr
