"""Samplers: one contract, one posterior, whichever of them draws."""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache

import jax.numpy as jnp
import numpy as np
import pytest

from bayesdamp.inference import diagnostics
from bayesdamp.inference.folded import FoldedT
from bayesdamp.inference.mode import find_mode
from bayesdamp.inference.samplers import SAMPLERS, Sampler
from bayesdamp.inference.target import compiled
from bayesdamp.priors import LogNormal
from bayesdamp.types import Posterior

from . import problems
from .written_out import PROBLEMS

NAME = "coulomb_correlated"
EACH = pytest.mark.parametrize("sampler", SAMPLERS.names())


@lru_cache
def weighted(name: str) -> dict[str, tuple[float, float]]:
    """Mean and sd of each parameter from 40,000 independent weighted draws: no Markov chain, errors below 1 %.

    The likelihood under the weights is checked against LSODA's elsewhere.
    """
    target, mode = problems.target(name), problems.mode(name)
    folded = np.asarray(target.layout.folded)
    proposal = FoldedT(np.where(folded, np.abs(mode.z), mode.z), 1.1 * mode.factor, folded)
    z = proposal.draw(np.random.default_rng(0), 40_000)
    batch = compiled(target.layout).batch
    logs = np.concatenate([np.asarray(batch(mode.context, jnp.asarray(c))) for c in np.split(z, 160)])
    logs -= proposal.log_density(z)
    w = np.exp(logs - logs.max())
    w /= w.sum()
    assert 1 / np.sum(w**2) > 10_000
    found = {}
    for n, x in target.values(z).items():
        mean = float(w @ x)
        found[n] = mean, float(np.sqrt(w @ (x - mean) ** 2))
    return found


def moments(posterior: Posterior) -> dict[str, tuple[float, float, float]]:
    """Mean, sd and Monte Carlo error of the mean of each parameter."""
    draws = ((n, posterior.draws[..., i]) for i, n in enumerate(posterior.names))
    return {n: (float(x.mean()), float(x.std(ddof=1)), diagnostics.monte_carlo_error(x)) for n, x in draws}


def departures(posterior: Posterior, name: str) -> list[str]:
    """What differs from the weighted draws: means by more than 0.1 sd, sds by more than 7 %.

    Both sides together are uncertain by at most 0.025 sd in a mean and 1.7 % in an sd: four standard errors, a
    false alarm in a thousand over the parameters of two samplers.
    """
    found = []
    for n, (mean, sd, _) in moments(posterior).items():
        expected, spread = weighted(name)[n]
        if abs(mean - expected) > 0.1 * spread:
            found.append(f"mean of {n}")
        if abs(sd / spread - 1) > 0.07:
            found.append(f"sd of {n}")
    return found


@EACH
def test_draws_are_of_the_posterior(sampler):
    posterior = problems.posterior(NAME, sampler)
    assert posterior.outcome == "ok"
    assert departures(posterior, NAME) == []
    for s in posterior.diagnostics["summary"].values():  # type: ignore[union-attr]
        assert s["rhat"] <= 1.01
        assert min(s["ess_bulk"], s["ess_tail"]) >= 1000


def test_samplers_agree():
    """Means within 4 Monte Carlo standard errors: a false alarm in 2,500 over six parameters."""
    nuts, emcee = (moments(problems.posterior(NAME, s)) for s in ("nuts", "emcee"))
    for parameter in nuts:
        error = np.hypot(nuts[parameter][2], emcee[parameter][2])
        assert abs(nuts[parameter][0] - emcee[parameter][0]) < 4 * error, parameter


def test_negative_control_half_the_noise():
    """The noise held at half of what it is (only a prior's numbers change, nothing is compiled anew)."""
    target = problems.target(NAME)
    half = 0.5 * weighted(NAME)["noise_sd"][0]
    wrong = replace(target, priors={**target.priors, "noise_sd": LogNormal(median=half, sigma=1e-3)})
    mode = find_mode(wrong, {"s": PROBLEMS[NAME]["truth"]}, noise_level=half)
    draws = SAMPLERS.get("nuts").sample(wrong, mode, problems.SETTINGS)
    assert {"sd of mu_c", "sd of stiffness", "sd of theta0"} <= set(departures(draws, NAME))


@EACH
def test_contract(sampler):
    """Names, shapes, log likelihoods that belong to the draws, and the same draws again under the same seed."""
    plugin = SAMPLERS.get(sampler)
    assert isinstance(plugin, Sampler)
    assert plugin.name == sampler
    target, mode = problems.target(NAME), problems.mode(NAME)
    found = problems.posterior(NAME, sampler)
    assert found.sampler == sampler
    assert found.names == target.names
    assert found.draws.shape == (*found.log_likelihood.shape, len(found.names))
    assert np.all(np.isfinite(found.draws))
    assert np.all(found.draws[..., : len(target.oscillator.coefficients)] >= 0)
    z = np.array([target.scores(dict(zip(found.names, x))) for x in found.draws[0, :3]])
    np.testing.assert_allclose(
        found.log_likelihood[0, :3], problems.log_likelihoods(target, mode, z), atol=1e-6
    )
    again = plugin.sample(target, mode, problems.SETTINGS)
    np.testing.assert_array_equal(again.draws, found.draws)
    other = plugin.sample(target, mode, replace(problems.SETTINGS, seed=5))
    assert not np.array_equal(other.draws[0, :50], found.draws[0, :50])


def test_draws_that_are_not_to_be_trusted_are_said_to_be():
    rng = np.random.default_rng(0)
    few = diagnostics.summarise(rng.normal(size=(4, 60)))
    assert "too few draws" in diagnostics.verdict({"zeta": {**few, "rhat": 1.0}})
    stuck = np.repeat([0.0, 0.0, 1.0, 1.0], 500).reshape(4, 500) + 0.01 * rng.normal(size=(4, 500))
    assert "R-hat of zeta" in diagnostics.verdict({"zeta": diagnostics.summarise(stuck)})
    assert diagnostics.verdict({"zeta": {"rhat": float("nan"), "ess_bulk": 1e4, "ess_tail": 1e4}}) != "ok"
    good = diagnostics.summarise(rng.normal(size=(4, 1000)))
    assert diagnostics.verdict({"zeta": good}) == "ok"


def test_saved_draws_read_back(tmp_path):
    """As ArviZ reads them."""
    found = problems.posterior(NAME, "nuts")
    diagnostics.save(found, tmp_path / "draws.nc")
    data = diagnostics.az.from_netcdf(str(tmp_path / "draws.nc"))
    np.testing.assert_array_equal(data.posterior["mu_c"].values, found.draws[..., 0])
    assert "diverging" in data.sample_stats
