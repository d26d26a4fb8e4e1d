"""Samplers: the same posterior from two of them, and from a reference made by other means."""

from __future__ import annotations

import errno
import os
from dataclasses import replace
from functools import lru_cache

import numpy as np
import pytest
import xarray
from scipy.stats import genpareto

from bayesdamp.inference.checks import diagnostics
from bayesdamp.inference.coordinates.whitening import whitening_of
from bayesdamp.inference.fit.search import find_mode
from bayesdamp.inference.samplers import SAMPLERS, Sampler, Settings, nuts
from bayesdamp.inference.samplers.nuts import Chain, Nuts
from bayesdamp.numerics.pareto import pareto_k
from bayesdamp.priors import LogNormal
from bayesdamp.store import write_bytes
from bayesdamp.types import OK, Posterior, Seed
from tests.inference import problems

SAMPLER_NAMES = SAMPLERS.names()
EACH = pytest.mark.parametrize("sampler", SAMPLER_NAMES)
EXACT = pytest.mark.parametrize("sampler", [n for n in SAMPLER_NAMES if not SAMPLERS.get(n).approximate])
PROBLEM = pytest.mark.parametrize("name", problems.NAMES)


def moments(posterior: Posterior) -> dict[str, tuple[float, float, float]]:
    """Mean, sd and Monte Carlo error of the mean of each parameter."""
    return {
        n: (float(x.mean()), float(x.std(ddof=1)), diagnostics.monte_carlo_error(x))
        for n, x in ((n, posterior.draws[..., i]) for i, n in enumerate(posterior.names))
    }


BARS = {"nuts": (0.05, 0.03)}
"""Largest departure from a reference by sampler: of a mean in sds, of an sd as a share."""
WIDER = (0.1, 0.06)


def departures(posterior: Posterior, name: str) -> list[str]:
    """What differs from the reference by more than the sampler's bars.

    The reference's means have errors of about 0.005 sd and its sds of 0.4 %. NUTS has an ESS of about 10,000 here,
    errors of 0.01 sd and 0.7 %: its bars are at four standard errors or more, a false alarm in 400 over 16
    parameters. The ensembles stop at an ESS of 1,100, errors of 0.03 sd and 2 %; bars at three, and one seed.
    """
    mean_bar, sd_bar = BARS.get(posterior.sampler, WIDER)
    collected = []
    for n, (mean, sd, _) in moments(posterior).items():
        expected = problems.reference(name)["posterior"][n]
        if abs(mean - expected["mean"]) > mean_bar * expected["sd"]:
            collected.append(f"mean of {n}")
        if abs(sd / expected["sd"] - 1) > sd_bar:
            collected.append(f"sd of {n}")
    return collected


@PROBLEM
def test_the_reference_can_be_trusted(name):
    for parameter, s in problems.reference(name)["posterior"].items():
        assert s["rhat"] < 1.01, parameter
        assert s["ess"] > 8_000, parameter


@PROBLEM
@EXACT
def test_against_the_reference(sampler, name):
    posterior = problems.posterior(name, sampler)
    assert posterior.outcome == "ok"
    assert departures(posterior, name) == []
    for parameter, s in posterior.summaries.items():
        assert s["rhat"] <= 1.01
        assert min(s["ess_bulk"], s["ess_tail"]) >= 400
        expected = problems.reference(name)["posterior"][parameter]
        # With ESS of 2,000 and more on both sides the outer quantiles are uncertain by 0.06 sd, the inner by 0.03.
        for q, label in zip(expected["quantiles"], ("q2.5", "q25", "median", "q75", "q97.5")):
            allowed = 0.25 if label in ("q2.5", "q97.5") else 0.15
            assert abs(s[label] - q) < allowed * expected["sd"], (parameter, label)


@PROBLEM
def test_two_samplers_agree(name):
    """Means within 4 Monte Carlo standard errors: a false alarm in 1,500 over the parameters of both problems."""
    nuts, emcee = (moments(problems.posterior(name, s)) for s in ("nuts", "emcee"))
    for parameter in nuts:
        error = np.hypot(nuts[parameter][2], emcee[parameter][2])
        assert abs(nuts[parameter][0] - emcee[parameter][0]) < 4 * error, parameter


@lru_cache
def half_the_noise(name: str) -> Posterior:
    """The same posterior with the noise held at half of what it is."""
    target = problems.target(name)
    half = 0.5 * problems.reference(name)["posterior"]["noise_sd"]["mean"]
    wrong = replace(target, priors={**target.priors, "noise_sd": LogNormal(median=half, sigma=1e-3)})
    mode = find_mode(wrong, {Seed("s"): problems.reference(name)["truth"]}, noise_level=half)
    return SAMPLERS.get("nuts").sample(wrong, mode, problems.SETTINGS)


def test_negative_control_half_the_noise():
    result = departures(half_the_noise("viscous_coulomb"), "viscous_coulomb")
    assert {"sd of zeta", "sd of theta0"} <= set(result)


def test_surrogate_force_and_exact_force():
    """The force of the linearised trajectory draws from the same posterior as the exact gradient: 4 errors."""
    name = "viscous_coulomb"
    target, mode = problems.target(name), problems.mode(name)
    exact = Nuts().attempt(mode, whitening_of(target, mode), problems.SETTINGS, True).posterior(mode)
    assert departures(exact, name) == []
    assert problems.posterior(name, "nuts").diagnostics["exact_force"] is False
    first, second = moments(problems.posterior(name, "nuts")), moments(exact)
    for parameter in first:
        error = np.hypot(first[parameter][2], second[parameter][2])
        assert abs(first[parameter][0] - second[parameter][0]) < 4 * error, parameter


def test_a_step_is_as_long_as_it_may_be():
    """Half the likelihoods of half the step, for draws that are as good: none below 0.8 of its effective ones, of which
    the estimate has an error of 5 %."""
    target, mode = problems.target("viscous_coulomb"), problems.mode("viscous_coulomb")
    at, settings = whitening_of(target, mode), Settings(chains=4, warmup=100, draws=1000, seed=2)
    whole, half = (Nuts().attempt(mode, at, settings, shorter=share).posterior(mode) for share in (1.0, 0.5))
    assert np.mean(whole.stats["n_steps"]) < min(4.0, 0.6 * np.mean(half.stats["n_steps"]))
    for name, result in whole.summaries.items():
        assert result["ess_bulk"] > 0.8 * half.summaries[name]["ess_bulk"]


@EACH
def test_contract(sampler):
    """Names, shapes, log likelihoods that belong to the draws, and the same draws again under the same seed."""
    plugin = SAMPLERS.get(sampler)
    assert isinstance(plugin, Sampler)
    assert plugin.name == sampler
    name = "viscous_coulomb"
    target, mode = problems.target(name), problems.mode(name)
    posterior = problems.posterior(name, sampler)
    assert posterior.sampler == sampler
    assert posterior.names == target.names
    assert posterior.draws.shape == (*posterior.log_likelihood.shape, len(posterior.names))
    assert np.all(np.isfinite(posterior.draws))
    assert np.all(posterior.draws[..., : len(target.oscillator.coefficients)] >= 0)
    z = np.array([target.scores(dict(zip(posterior.names, x))) for x in posterior.draws[0, :3]])
    expected = mode.likelihood.log_likelihoods(z)
    np.testing.assert_allclose(posterior.log_likelihood[0, :3], expected, atol=1e-6)
    again = plugin.sample(target, mode, problems.SETTINGS)
    np.testing.assert_array_equal(again.draws, posterior.draws)
    other = plugin.sample(target, mode, replace(problems.SETTINGS, seed=5))
    assert not np.array_equal(other.draws.ravel()[:50], posterior.draws.ravel()[:50])


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
    posterior = problems.posterior("viscous_coulomb", "nuts")
    (tmp_path / "draws.nc").write_bytes(diagnostics.saved(posterior))
    data = xarray.open_datatree(tmp_path / "draws.nc", engine="h5netcdf")
    np.testing.assert_array_equal(data.posterior["zeta"].values, posterior.draws[..., 0])
    assert data.posterior["zeta"].dims == ("chain", "draw")
    assert "diverging" in data.sample_stats


def test_draws_that_find_no_room_leave_nothing(tmp_path, monkeypatch):
    """HDF5 itself would end the process. Control: with room the file is there."""

    def full(_: int) -> None:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    posterior = problems.posterior("viscous_coulomb", "nuts")
    with monkeypatch.context() as disk:
        disk.setattr(os, "fsync", full)
        with pytest.raises(OSError, match="No space left"):
            write_bytes(tmp_path / "posterior" / "draws.nc", diagnostics.saved(posterior))
    assert not [path for path in tmp_path.rglob("*") if path.is_file()]
    write_bytes(tmp_path / "posterior" / "draws.nc", diagnostics.saved(posterior))
    assert (tmp_path / "posterior" / "draws.nc").stat().st_size > 1000


def test_the_tails_are_the_outer_twentieths():
    """Independent draws, of which those beyond the 5 % and 95 % quantiles come one after the other: a run a chain."""
    x = np.random.default_rng(8).normal(size=(4, 1000))
    low, high = np.quantile(x, [0.05, 0.95])
    runs = np.stack([np.concatenate([c[c < low], c[(c >= low) & (c <= high)], c[c > high]]) for c in x])
    assert diagnostics.summarise(x)["ess_tail"] > 2000
    assert diagnostics.summarise(runs)["ess_tail"] < 100


@pytest.mark.parametrize("shape", [0.2, 0.5, 0.9])
def test_the_tail_of_weights_has_its_shape(shape):
    """Of ratios that are generalised Pareto; their inverses have no tail. False alarm below 1e-3 (four sds)."""
    ratios = genpareto.rvs(shape, size=20_000, random_state=np.random.default_rng(4))
    # Its sd by maximum likelihood is (1 + k) / √(tail): Smith (1987).
    tail = 3 * np.sqrt(ratios.size)
    assert abs(pareto_k(np.log(ratios)) - shape) < 4 * (1 + shape) / np.sqrt(tail)
    assert pareto_k(-np.log(ratios + 1)) < 0.0


def test_too_few_draws_are_added_to():
    """Chains go on from their last draws: what was drawn stays, new draws have their own likelihoods and the
    reference's moments. No more than three times the draws are taken where these do not suffice either.

    Negative control: chains that do not go on, but draw the same again.
    """
    name = "viscous_coulomb"
    target, mode = problems.target(name), problems.mode(name)
    few = Settings(chains=4, warmup=100, draws=130, seed=2)
    run = Nuts().attempt(mode, whitening_of(target, mode), few)
    first, result = run.posterior(mode), Nuts().sample(target, mode, few)
    assert "too few draws" in first.outcome
    assert result.outcome == OK
    assert result.draws.shape[1] == 130 + 230
    np.testing.assert_array_equal(result.draws[:, :130], first.draws)
    z = np.array([target.scores(dict(zip(result.names, x))) for x in result.draws[0, 130:133]])
    expected = mode.likelihood.log_likelihoods(z)
    np.testing.assert_allclose(result.log_likelihood[0, 130:133], expected, atol=1e-6)
    longer = run.longer(10_000)
    assert longer.draws == 10_130
    assert departures(longer.posterior(mode), name) == []
    same = replace(run, left=tuple(np.concatenate([x] * 40, axis=1) for x in run.left))
    assert departures(same.posterior(mode), name)
    least = replace(few, draws=10, warmup=10)
    result = Nuts().sample(target, mode, least)
    assert result.outcome != OK
    assert result.draws.shape[1] == 10 + 20


def test_added_draws_go_on_from_the_last(monkeypatch):
    target, mode = problems.target("viscous_coulomb"), problems.mode("viscous_coulomb")
    settings = Settings(chains=4, warmup=10, draws=10, seed=3)
    run = Nuts().attempt(mode, whitening_of(target, mode), settings)
    given = []
    monkeypatch.setattr(Chain, "sampled", lambda self, *them: given.append(them) or [x[0] for x in run.left])
    run.longer(20)
    starts, heights, counts = map(np.array, zip(*given, strict=True))
    np.testing.assert_array_equal(starts, run.left[0][:, -1])
    np.testing.assert_array_equal(heights, run.left[1][:, -1])
    assert set(counts) == {20}


@pytest.mark.parametrize(("good", "tries"), [(1, 0), (2, 1), (4, 3), (99, 5)])
def test_shorter_steps_come_before_the_exact_force(monkeypatch, good, tries):
    """good: which attempt's draws are. The first is at the usual step by the cheap force; there is no ridge."""
    target, mode = problems.target("viscous_coulomb"), problems.mode("viscous_coulomb")
    settings = Settings(chains=4, warmup=10, draws=10, seed=3)
    run = Nuts().attempt(mode, whitening_of(target, mode), settings)
    collected = []

    def attempt(self, mode, at, settings, exact=False, shorter=1.0):
        collected.append((exact, shorter))
        return run

    monkeypatch.setattr(Nuts, "attempt", attempt)
    monkeypatch.setattr(nuts, "shear_of", lambda *_: None)
    monkeypatch.setattr(nuts, "poor", lambda _: len(collected) < good)
    Nuts().sample(target, mode, replace(settings, draws=1))
    assert (
        collected
        == [(False, 1.0), (False, 0.5), (True, 1.0), (True, 0.5), (True, 0.25), (True, 0.125)][: 1 + tries]
    )


def test_few_divergences_are_no_reason_for_another_attempt():
    posterior = problems.posterior("viscous_coulomb", "nuts")
    size = posterior.stats["diverging"].size

    def with_divergences(count):
        diverging = np.arange(size).reshape(posterior.stats["diverging"].shape) < count
        return replace(posterior, stats={**posterior.stats, "diverging": diverging})

    assert not nuts.poor(with_divergences(size // 1000))
    assert nuts.poor(with_divergences(size // 200))
    refused = replace(posterior, stats={**posterior.stats, "acceptance_rate": np.full((4, 10), 0.4)})
    assert nuts.poor(refused)
