"""Samplers against reference posteriors, and their diagnostics and shared rules."""

from dataclasses import replace

import numpy as np
import pytest

from bayesdamp.inference import diagnostics
from bayesdamp.inference.coordinates import whitening_of
from bayesdamp.inference.mode import find_mode
from bayesdamp.inference.samplers import SAMPLERS, Sampler, Settings
from bayesdamp.inference.samplers.nuts import Nuts
from bayesdamp.priors import LogNormal
from bayesdamp.types import OK, Posterior
from tests.inference import problems

BARS = {"nuts": (0.05, 0.03)}
"""Largest departures from a reference: of a mean in sds, and of an sd as a share."""
WIDER = (0.1, 0.06)


def departures(posterior: Posterior, name: str) -> list[str]:
    """Return the means and sds that differ from the reference by more than the bars of the sampler.

    Means of the reference have errors of about 0.005 sd, and its sds of 0.4 %. NUTS has an ESS of about 10,000 and
    errors of 0.01 sd and 0.7 %: its bars are four standard errors or more, a false alarm in 400 for 16 parameters. The
    ensembles stop at an ESS of 1,100 with errors of 0.03 sd and 2 %; their bars are three errors, for one seed.
    """
    mean_bar, sd_bar = BARS.get(posterior.sampler, WIDER)
    names = []
    for i, n in enumerate(posterior.names):
        x, expected = posterior.draws[..., i], problems.reference(name)["posterior"][n]
        if abs(x.mean() - expected["mean"]) > mean_bar * expected["sd"]:
            names.append(f"mean of {n}")
        if abs(x.std(ddof=1) / expected["sd"] - 1) > sd_bar:
            names.append(f"sd of {n}")
    return names


@pytest.mark.parametrize(
    ("sampler", "name"), [*(("nuts", name) for name in problems.NAMES), ("emcee", "touching_zero")]
)
def test_moments_and_quantiles_are_those_of_the_reference(sampler, name):
    """With an ESS of 2,000 and more, outer quantiles have errors of 0.06 sd, and inner ones of 0.03."""
    posterior = problems.posterior(name, sampler)
    assert posterior.outcome == "ok"
    assert departures(posterior, name) == []
    for parameter, s in posterior.summaries.items():
        assert s["rhat"] <= 1.01
        assert min(s["ess_bulk"], s["ess_tail"]) >= 400
        expected = problems.reference(name)["posterior"][parameter]
        for q, label in zip(expected["quantiles"], ("q2.5", "q25", "median", "q75", "q97.5")):
            allowed = 0.25 if label in ("q2.5", "q97.5") else 0.15
            assert abs(s[label] - q) < allowed * expected["sd"], (parameter, label)


def test_the_reference_detects_half_the_noise():
    """Negative control: the same posterior with the noise fixed at half its size."""
    name = "viscous_coulomb"
    target, reference = problems.target(name), problems.reference(name)
    half = 0.5 * reference["posterior"]["noise_sd"]["mean"]
    wrong = replace(target, priors={**target.priors, "noise_sd": LogNormal(median=half, sigma=1e-3)})
    mode = find_mode(wrong, [reference["truth"]], noise_level=half)
    posterior = SAMPLERS.get("nuts").sample(wrong, mode, Settings(chains=4, warmup=200, draws=600, seed=4))
    assert {"sd of zeta", "sd of theta0"} <= set(departures(posterior, name))


@pytest.mark.parametrize("sampler", SAMPLERS.names())
def test_a_sampler_returns_draws_with_their_log_likelihoods_and_repeats_them_for_a_seed(sampler):
    """Names and shapes are those of the target, and coefficients are not negative."""
    plugin = SAMPLERS.get(sampler)
    assert isinstance(plugin, Sampler)
    assert plugin.name == sampler
    name, settings = "viscous_coulomb", Settings(chains=4, warmup=100, draws=200, seed=4)
    target, mode = problems.target(name), problems.mode(name)
    posterior = plugin.sample(target, mode, settings)
    assert posterior.sampler == sampler
    assert posterior.names == target.names
    assert posterior.draws.shape == (*posterior.log_likelihood.shape, len(posterior.names))
    assert np.all(np.isfinite(posterior.draws))
    assert np.all(posterior.draws[..., : len(target.oscillator.coefficients)] >= 0)
    z = np.array([target.scores(dict(zip(posterior.names, x))) for x in posterior.draws[0, :3]])
    np.testing.assert_allclose(posterior.log_likelihood[0, :3], mode.likelihood.log_likelihoods(z), atol=1e-6)
    np.testing.assert_array_equal(plugin.sample(target, mode, settings).draws, posterior.draws)
    other = plugin.sample(target, mode, replace(settings, seed=5))
    assert not np.array_equal(other.draws.ravel()[:50], posterior.draws.ravel()[:50])


def test_the_shortest_interval_of_an_exponential_distribution_begins_at_zero() -> None:
    """Its 95 % interval is 0 to ln 20; control: the interval between quantiles is not."""
    values = -np.log1p(-(np.arange(20000) + 0.5) / 20000)
    row = diagnostics.moments_and_quantiles(values)
    assert [row["hdi_low"], row["hdi_high"]] == pytest.approx([0.0, np.log(20)], abs=1e-3)
    assert [row["q2.5"], row["q97.5"]] == pytest.approx([-np.log(0.975), -np.log(0.025)], rel=1e-3)
    assert [row["mean"], row["sd"]] == pytest.approx([1.0, 1.0], rel=1e-3)


def test_too_few_draws_and_chains_that_disagree_are_reported():
    rng = np.random.default_rng(0)
    few = diagnostics.summarise(rng.normal(size=(4, 60)))
    assert "too few draws" in diagnostics.verdict({"zeta": {**few, "rhat": 1.0}})
    stuck = np.repeat([0.0, 0.0, 1.0, 1.0], 500).reshape(4, 500) + 0.01 * rng.normal(size=(4, 500))
    assert "R-hat of zeta" in diagnostics.verdict({"zeta": diagnostics.summarise(stuck)})
    assert diagnostics.verdict({"zeta": {"rhat": float("nan"), "ess_bulk": 1e4, "ess_tail": 1e4}}) != "ok"
    assert diagnostics.verdict({"zeta": diagnostics.summarise(rng.normal(size=(4, 1000)))}) == "ok"


def test_draws_are_added_to_too_few_ones():
    """The first draws stay, and new draws have their own log likelihoods."""
    target, mode = problems.target("viscous_coulomb"), problems.mode("viscous_coulomb")
    few = Settings(chains=4, warmup=100, draws=130, seed=2)
    run = Nuts().run_chains(mode, whitening_of(target, mode), few)
    first, result = run.posterior(mode), Nuts().sample(target, mode, few)
    assert "too few draws" in first.outcome
    assert result.outcome == OK
    assert result.draws.shape[1] == 130 + 230
    np.testing.assert_array_equal(result.draws[:, :130], first.draws)
    z = np.array([target.scores(dict(zip(result.names, x))) for x in result.draws[0, 130:133]])
    expected = mode.likelihood.log_likelihoods(z)
    np.testing.assert_allclose(result.log_likelihood[0, 130:133], expected, atol=1e-6)
