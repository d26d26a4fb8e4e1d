"""Samplers under approximate laws, against a sum over the parameter and sequential Monte Carlo."""

from functools import lru_cache

import numpy as np
import pytest
from scipy.special import logsumexp

import bayesdamp as bd
from tests.interface.test_deviation import MODEL, fit, one_parameter

LENGTHS = {"nuts": {"chains": 2, "warmup": 50, "draws": 300}, "emcee": {}}
GRID = np.linspace(0.040, 0.060, 201)


@lru_cache
def by_sum() -> tuple[float, float]:
    """Compute mean and sd of ζ by a sum over a grid of ζ; the prior is half-normal."""
    prior, likelihood = one_parameter().priors["zeta"], one_parameter().law.mode.likelihood
    z = np.array([prior.score(v) for v in GRID])[:, None]
    log = likelihood.log_posteriors(z) + np.log(np.gradient(z[:, 0]))
    weights = np.exp(log - logsumexp(log))
    mean = float(weights @ GRID)
    return mean, float(np.sqrt(weights @ (GRID - mean) ** 2))


@pytest.mark.parametrize("sampler", ["nuts", pytest.param("emcee", marks=pytest.mark.slow)])
def test_chains_draw_from_the_density(sampler: str) -> None:
    """Mean and sd within five standard errors of the effective draws. Control: the sd from noise alone is smaller."""
    mean, sd = by_sum()
    row = bd.sample(one_parameter(), sampler, **LENGTHS[sampler]).summary(derived=False).loc["zeta"]
    error = sd / np.sqrt(row["ess_bulk"])
    assert abs(row["mean"] - mean) < 5 * error
    assert abs(row["sd"] - sd) < 5 * error
    assert one_parameter().sd_noise["zeta"] < sd - 5 * error


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
    assert MODEL.bind(fit().signal).values == pytest.approx(density.values)
