"""The distribution of a coefficient over specimens, against quadrature."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import norm

from bayesdamp.inference.population import Sample, infer_population
from bayesdamp.types import Refusal

SCALE = 0.3
N = 4000


def sample(name: str, mean: float, sd: float, rng: np.random.Generator, prior_sd: float = SCALE) -> Sample:
    """Return draws of the posterior of a measured value, mean ± sd, under a half-normal prior, from a wider normal."""
    x = np.abs(rng.normal(mean, 1.3 * sd, N))
    proposal = np.logaddexp(norm.logpdf(x, mean, 1.3 * sd), norm.logpdf(-x, mean, 1.3 * sd))
    log_prior = norm.logpdf(x, 0, prior_sd) + np.log(2)
    return Sample(name, x, norm.logpdf(x, mean, sd) + log_prior - proposal, log_prior)


def test_near_zero_the_population_is_that_of_a_truncated_normal():
    """By a dense grid over θ, m and τ, for specimens whose likelihoods extend below zero. The value of a specimen is
    moved towards the others. Control: its own likelihood alone has another mean."""
    rng = np.random.default_rng(3)
    means, sds = np.array([0.004, 0.012, -0.003, 0.007, 0.02]), np.full(5, 0.008)
    result = infer_population([sample(f"s{i}", a, b, rng) for i, (a, b) in enumerate(zip(means, sds))], SCALE)
    theta = np.linspace(0, 0.07, 1401)
    tau = np.geomspace(1e-4, 4 * SCALE, 70)
    m = np.r_[np.linspace(2e-4, 0.05, 160), np.linspace(0.05, 3 * SCALE, 80)[1:]][:, None]
    log_p = np.log(np.gradient(m[:, 0]))[:, None] + np.log(tau) - 0.5 * (m / SCALE) ** 2
    log_p = log_p - 0.5 * (tau / m) ** 2 - np.log(m)
    like = norm.pdf(theta[:, None], means, sds) * (theta[1] - theta[0])
    like[0] /= 2
    for i, width in enumerate(tau):
        density = norm.pdf(theta, m, width) @ like / norm.cdf(m / width)
        log_p[:, i] += np.sum(np.log(np.maximum(density, 1e-200)), axis=1)
    p = np.exp(log_p - log_p.max())
    p /= p.sum()
    a = m / tau
    hazard = norm.pdf(a) / norm.cdf(a)
    mean, spread = m + tau * hazard, tau * np.sqrt(1 - a * hazard - hazard**2)
    for x, summary in ((mean, result.mean), (spread, result.spread)):
        middle = np.sum(p * x)
        sd = np.sqrt(np.sum(p * (x - middle) ** 2))
        assert summary["mean"] == pytest.approx(middle, abs=0.1 * sd)
        assert summary["sd"] == pytest.approx(sd, rel=0.1)
    own = np.empty_like(log_p)
    for i, width in enumerate(tau):
        density = norm.pdf(theta, m, width) * like[:, -1]
        own[:, i] = density @ theta / np.maximum(density.sum(axis=1), 1e-200)
    shrunk, alone = np.sum(p * own), like[:, -1] @ theta / like[:, -1].sum()
    assert result.shrunk["s4"]["mean"] == pytest.approx(shrunk, abs=0.1 * sds[-1])
    assert abs(alone - shrunk) > 0.5 * sds[-1]


def test_one_specimen_is_refused_and_few_draws_are_reported():
    rng = np.random.default_rng(5)
    item = sample("a", 0.1, 1e-3, rng)
    with pytest.raises(Refusal, match="two specimens or more"):
        infer_population([item], SCALE)
    poor = Sample("b", item.values[:60], item.log_weights[:60], item.log_prior[:60])
    assert "b has" in infer_population([item, poor], SCALE).outcome
