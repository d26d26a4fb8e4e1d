"""Sampling of the parameters of correlated noise, for short and long correlation times."""

from functools import lru_cache

import numpy as np
import pytest

from bayesdamp.inference.evidence import Draws, bridge
from bayesdamp.inference.mode import Mode, find_mode
from bayesdamp.inference.model.target import Target
from bayesdamp.inference.samplers import Sampler, Settings, emcee, nuts
from bayesdamp.types import OK
from tests.inference.problems import linear_target


@lru_cache
def of_noise_alone(correlation_time: float | None) -> tuple[Target, Mode]:
    """Return target and mode of 150 samples of a known motion, whose noise has this correlation time or is white."""
    t = np.linspace(0.0, 6.0, 150)
    y = 0.003 * np.random.default_rng(4).standard_normal(t.size)
    if correlation_time is not None:
        y = np.linalg.cholesky(np.exp(-np.abs(t[:, None] - t) / correlation_time)) @ y
    known = {"stiffness": 20.0, "zeta": 0.05, "theta0": 0.0, "omega0": 0.0}
    target = linear_target(t, y, "viscous", known, "correlated")
    start = {"noise_sd": 0.003, "noise_time": correlation_time or 0.005}
    return target, find_mode(target, [start], noise_level=0.003)


def quadrature(target: Target, mode: Mode) -> tuple[np.ndarray, np.ndarray, float]:
    """Return scores of the correlation time, their cumulative probabilities, and the log evidence, by a grid."""
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
def test_the_correlation_time_and_the_evidence_are_those_of_quadrature(
    correlation_time: float | None,
) -> None:
    """The median of NUTS and the evidence of the bridge, within four standard errors. Trajectories are short, and half
    of the draws or more are effective."""
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
    bridged = bridge.PLUGIN.evidence("m", target, mode, 5, Draws.of(target, posterior.draws, OK))
    assert bridged.stderr < 0.05
    assert abs(bridged.log_evidence - log_evidence) < 4 * bridged.stderr


@pytest.mark.parametrize("sampler", [nuts.PLUGIN, emcee.PLUGIN])
def test_log_likelihoods_do_not_contain_the_volume_of_the_map(sampler: Sampler) -> None:
    target, mode = of_noise_alone(0.03)
    posterior = sampler.sample(target, mode, Settings(chains=4, warmup=20, draws=20, seed=1, grows=False))
    residual, gaps = mode.likelihood.residual(mode.z), mode.likelihood.gaps
    values = dict(zip(posterior.names, np.moveaxis(posterior.draws[:3, -1], -1, 0), strict=True))
    draws = [{n: v[i] for n, v in values.items()} for i in range(3)]
    expected = [target.noise_model.log_likelihood(residual, gaps, draw) for draw in draws]
    assert posterior.log_likelihood[:3, -1] == pytest.approx(np.array(expected, float), abs=1e-6)
