"""NUTS and emcee under laws that hold approximately: against a sum over the parameter, and the sampler of motions."""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache

import numpy as np
import pytest
from scipy.special import logsumexp

import bayesdamp as bd
from bayesdamp.inference.approximate.evidence import by_importance
from bayesdamp.inference.approximate.sensitivity import over_widths
from bayesdamp.inference.deviation.sampled.marginal import Marginal, marginal_of
from bayesdamp.inference.evidence import widths as evidence_widths
from tests.interface.test_deviation import SCALE, by_quadrature, fit, one_parameter

LENGTHS = {"nuts": {"chains": 2, "warmup": 50, "draws": 300}, "emcee": {}}
GRID = np.linspace(0.040, 0.060, 201)


def marginal(of: bd.Fit) -> Marginal:
    assert of.law is not None
    return marginal_of(of.law.single.weighing, of.law.single.result)


def without_deviations(whole: Marginal) -> Marginal:
    nothing = np.zeros((1, *whole.maps.shape[1:]))
    return replace(
        whole, log_prior=np.zeros(1), maps=nothing, effects=nothing, whitening=nothing + np.eye(nothing.shape[1]),
        log_scale=np.zeros(1),
    )  # fmt: skip


@lru_cache
def by_sum() -> tuple[float, float, float]:
    """Mean and sd of ζ, and the log evidence, by a sum over a grid of ζ."""
    prior = one_parameter().priors["zeta"]
    z = np.array([prior.score(v) for v in GRID])[:, None]
    log = marginal(one_parameter()).log_density(z) + np.log(np.gradient(z[:, 0]))
    total = float(logsumexp(log))
    weights = np.exp(log - total)
    mean = float(weights @ GRID)
    return mean, float(np.sqrt(weights @ (GRID - mean) ** 2)), total


@pytest.mark.parametrize("sampler", ["nuts", "emcee"])
def test_chains_draw_from_the_density(sampler: str) -> None:
    """Mean within five, sd within five standard errors of the effective draws. Control: noise alone is narrower."""
    mean, sd, _ = by_sum()
    drawn = bd.sample(one_parameter(), sampler, **LENGTHS[sampler])
    row = drawn.summary(derived=False).loc["zeta"]
    error = sd / np.sqrt(row["ess_bulk"])
    assert abs(row["mean"] - mean) < 5 * error
    assert abs(row["sd"] - sd) < 5 * error
    assert one_parameter().sd_noise["zeta"] < sd - 5 * error


def test_the_density_has_the_evidence_of_the_motions() -> None:
    """Within four standard errors and 0.1 nats, which the curvature of the deviations is worth. Control: a density that
    lacks the deviations is 5 nats behind."""
    sampled = bd.evidence(one_parameter())
    total = by_sum()[2]
    assert abs(total - sampled.log_evidence) < 4 * sampled.stderr + 0.1
    alone = without_deviations(marginal(one_parameter()))
    z = np.array([one_parameter().priors["zeta"].score(v) for v in GRID])[:, None]
    exact = alone.log_density(z) + np.log(np.gradient(z[:, 0]))
    assert total - float(logsumexp(exact)) > 5


@pytest.mark.parametrize("enough", [evidence_widths.ENOUGH, np.inf], ids=["as it comes", "all sampled anew"])
def test_the_evidence_under_other_widths_of_the_prior_against_a_sum(
    enough: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Five standard errors and 0.002 nats. Control: without the prior's constant it would be off by a logarithm."""
    monkeypatch.setattr(evidence_widths, "ENOUGH", enough)
    law = one_parameter().law
    assert law is not None
    found = by_importance(law, "viscous", "importance", 1)
    widths = over_widths(law, found.arrays["y"], found.arrays["log_weights"], 1)
    assert widths.varied == ("zeta",)
    assert np.all(widths.trusted)
    prior = one_parameter().priors["zeta"]
    likelihood = marginal(one_parameter()).log_likelihood(np.array([prior.score(v) for v in GRID])[:, None])
    gaps = np.log(np.gradient(GRID))
    exact = np.array(
        [
            float(logsumexp(likelihood + bd.HalfNormal(f * SCALE).log_density(GRID) + gaps))
            for f in widths.factors
        ]
    )
    assert np.all(np.abs(widths.log_evidence - exact) < 5 * widths.stderr + 2e-3)
    flat = widths.log_evidence + np.log(widths.factors)
    assert np.all(np.abs(flat - exact)[widths.factors != 1.0] > 0.1)


@pytest.mark.slow
def test_the_density_is_that_of_dense_normal_distributions() -> None:
    assert abs(by_sum()[2] - by_quadrature(SCALE)) < 0.05
    assert by_sum()[2] - by_quadrature(SCALE, exact=True) > 5


def test_several_parameters_are_those_of_the_motions_themselves() -> None:
    """Five parameters, a damping that ends at zero among them: means of two samplers within five standard errors, sds
    within a tenth. Draws have deviations of their own, as large as the others'."""
    ours = bd.sample(fit(), "emcee")
    theirs = bd.sample(fit(), draws=600)
    assert ours.outcome == "ok"
    one, other = ours.summary(derived=False), theirs.summary(derived=False)
    for name in one.index:
        error = np.hypot(*(s.loc[name, "sd"] / np.sqrt(s.loc[name, "ess_bulk"]) for s in (one, other)))
        assert abs(one.loc[name, "mean"] - other.loc[name, "mean"]) < 5 * error
        assert one.loc[name, "sd"] == pytest.approx(other.loc[name, "sd"], rel=0.1)
    a, b = (p.damping_ratio([0.25]).iloc[0] for p in (ours, theirs))
    assert a.high - a.low == pytest.approx(b.high - b.low, rel=0.15)
    shares = [float((p.data["posterior"]["damping_deviation_size"] == 0).mean()) for p in (ours, theirs)]
    assert abs(shares[0] - shares[1]) < 0.1
    assert bd.evidence(ours).method == "smc"


def test_the_slope_is_that_of_the_density() -> None:
    target = marginal(fit())
    z = fit().law.scores[7, : target.positive.size]  # type: ignore[union-attr]
    step = 1e-4 * np.eye(z.size)
    slopes = [np.ptp(target.log_density(np.stack([z + s, z - s]))[::-1]) for s in step]
    found = target.gradient(z)
    assert np.abs(found) == pytest.approx(np.abs(slopes) / 2e-4, rel=0.02, abs=0.05)
    assert target.log_density(np.where(target.positive, -0.1, z)[None])[0] == -np.inf
