"""Samplers and nested sampling under approximate laws, against a sum over the parameter and sequential Monte Carlo."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
import pytest
from scipy.special import logsumexp

import bayesdamp as bd
from bayesdamp.inference.evidence import nested
from tests.interface.problems import KNOWN
from tests.interface.test_deviation import drifting, fit, one_parameter

LENGTHS = {"nuts": {"chains": 2, "warmup": 50, "draws": 300}, "emcee": {}}
GRID = np.linspace(0.040, 0.060, 201)


@lru_cache
def by_sum() -> tuple[float, float, float]:
    """Compute mean and sd of ζ, and the log evidence, by a sum over a grid of ζ; the prior is half-normal."""
    prior, likelihood = one_parameter().priors["zeta"], one_parameter().law.mode.likelihood
    z = np.array([prior.score(v) for v in GRID])[:, None]
    log = likelihood.log_posteriors(z) + np.log(2) + np.log(np.gradient(z[:, 0]))
    total = float(logsumexp(log))
    weights = np.exp(log - total)
    mean = float(weights @ GRID)
    return mean, float(np.sqrt(weights @ (GRID - mean) ** 2)), total


@lru_cache
def exact_laws() -> bd.Fit:
    model = bd.Model("viscous", noise="gaussian", known=KNOWN, priors=one_parameter().priors)
    return bd.fit(drifting(), model)


@pytest.mark.parametrize("sampler", ["nuts", pytest.param("emcee", marks=pytest.mark.slow)])
def test_chains_draw_from_the_density(sampler: str) -> None:
    """Mean and sd within five standard errors of the effective draws. Control: the sd from noise alone is smaller."""
    mean, sd, _ = by_sum()
    row = bd.sample(one_parameter(), sampler, **LENGTHS[sampler]).summary(derived=False).loc["zeta"]
    error = sd / np.sqrt(row["ess_bulk"])
    assert abs(row["mean"] - mean) < 5 * error
    assert abs(row["sd"] - sd) < 5 * error
    assert one_parameter().sd_noise["zeta"] < sd - 5 * error


def test_the_density_has_the_evidence_of_sequential_monte_carlo() -> None:
    """Within four standard errors and 0.1 nats, the size of what the curvature of the deviations changes.
    Control: exact laws have 5 nats less."""
    sampled, total = bd.evidence(one_parameter()), by_sum()[2]
    assert abs(total - sampled.log_evidence) < 4 * sampled.stderr + 0.1
    assert total - bd.evidence(exact_laws(), "laplace").log_evidence > 5


def test_nested_sampling_around_the_mode_has_the_evidence_of_the_density(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Within four standard errors and 0.002 nats of the sum. Control: exact laws have 5 nats less.

    The run starts around the mode if it would take too long from the prior, which is pretended here."""
    monkeypatch.setattr(nested, "LIKELIHOODS_PER_CHECK", 1)
    monkeypatch.setattr(nested, "log_evidence_about", lambda _: -1e9)
    evidence, control = bd.evidence(one_parameter(), "nested"), bd.evidence(exact_laws(), "laplace")
    assert evidence.outcome == "ok"
    assert "around the mode" in evidence.diagnostic
    assert evidence.log_evidence - control.log_evidence > 5
    assert abs(evidence.log_evidence - by_sum()[2]) < 4 * evidence.stderr + 0.002


def test_emcee_agrees_with_sequential_monte_carlo_on_five_parameters() -> None:
    """Means within five standard errors, sds within a tenth; also the deviations of the draws."""
    emcee, smc = bd.sample(fit(), "emcee"), bd.sample(fit(), draws=600)
    assert emcee.outcome == "ok"
    a, b = (post.summary(derived=False) for post in (emcee, smc))
    error = np.hypot(*(s["sd"] / np.sqrt(s["ess_bulk"]) for s in (a, b)))
    assert (abs(a["mean"] - b["mean"]) < 5 * error).all()
    assert dict(a["sd"]) == pytest.approx(dict(b["sd"]), rel=0.1)
    widths = [(r.high - r.low).item() for r in (post.damping_ratio([0.25]) for post in (emcee, smc))]
    assert widths[0] == pytest.approx(widths[1], rel=0.15)
    shares = [float((p.data["posterior"]["damping_deviation_size"] == 0).mean()) for p in (emcee, smc)]
    assert abs(shares[0] - shares[1]) < 0.1
    assert bd.evidence(emcee).method == "smc"


def test_the_density_in_natural_units() -> None:
    """Its log likelihood is that of the scores; its gradient is the log posterior's by finite differences."""
    density, likelihood = fit().density, fit().law.mode.likelihood
    x = density.vector()
    scores = likelihood.target.scores(density.values)
    assert density.log_likelihood(x) == pytest.approx(likelihood.log_likelihood(scores))
    for i, name in enumerate(density.names):
        sd = fit().sd[name]
        up, down = (density.log_posterior(x + s * sd * np.eye(x.size)[i]) for s in (0.01, -0.01))
        assert density.gradient(x)[i] * sd == pytest.approx((up - down) / 0.02, rel=0.02, abs=0.02)
    assert bd.Model("viscous", "linear", deviation="law").bind(fit().signal).values == pytest.approx(
        density.values
    )
