"""NUTS and emcee under laws that hold approximately: against a sum over the parameter, and the sampler of motions."""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache

import numpy as np
import pytest
from scipy.special import logsumexp

import bayesdamp as bd
from bayesdamp.inference.model.likelihood import Likelihood
from tests.interface.test_deviation import fit, one_parameter

LENGTHS = {"nuts": {"chains": 2, "warmup": 50, "draws": 300}, "emcee": {}}
GRID = np.linspace(0.040, 0.060, 201)


def density(of: bd.Fit) -> Likelihood:
    return of.law.mode.likelihood


def folded(of: Likelihood, z: np.ndarray) -> np.ndarray:
    """Log density of scores (m, d), of which reflected ones are not negative."""
    return of.log_posteriors(z) + np.log(2) * of.target.reflected.sum()


def without_deviations(of: Likelihood) -> Likelihood:
    """The same with deviations held at the mode's, and without their effect."""
    deviation = of.target.deviation
    k = deviation.maps.shape[1]
    nothing = np.zeros((1, k, k))
    alone = replace(deviation, log_prior=np.zeros(1), maps=nothing, effects=nothing, probabilities=np.ones(1))
    return replace(of, target=replace(of.target, deviation=alone))


@lru_cache
def by_sum() -> tuple[float, float, float]:
    """Mean and sd of ζ, and the log evidence, by a sum over a grid of ζ."""
    prior = one_parameter().priors["zeta"]
    z = np.array([prior.score(v) for v in GRID])[:, None]
    log = folded(density(one_parameter()), z) + np.log(np.gradient(z[:, 0]))
    total = float(logsumexp(log))
    weights = np.exp(log - total)
    mean = float(weights @ GRID)
    return mean, float(np.sqrt(weights @ (GRID - mean) ** 2)), total


@pytest.mark.parametrize("sampler", ["nuts", pytest.param("emcee", marks=pytest.mark.slow)])
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
    alone = without_deviations(density(one_parameter()))
    z = np.array([one_parameter().priors["zeta"].score(v) for v in GRID])[:, None]
    exact = folded(alone, z) + np.log(np.gradient(z[:, 0]))
    assert total - float(logsumexp(exact)) > 5


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


def test_the_density_in_natural_units() -> None:
    """Its log likelihood is that of the scores, and its gradient that of the log posterior by differences."""
    ours, of = fit().density, density(fit())
    x = ours.vector()
    assert ours.log_likelihood(x) == pytest.approx(of.log_likelihood(of.target.scores(fit().density.values)))
    for i, name in enumerate(ours.names):
        step = np.eye(x.size)[i] * 0.01 * fit().sd[name]
        slope = (ours.log_posterior(x + step) - ours.log_posterior(x - step)) / (2 * step[i])
        assert ours.gradient(x)[i] * fit().sd[name] == pytest.approx(
            slope * fit().sd[name], rel=0.02, abs=0.02
        )
    assert bd.Model("viscous", "linear", deviation="law").bind(fit().signal).values == pytest.approx(
        ours.values
    )
