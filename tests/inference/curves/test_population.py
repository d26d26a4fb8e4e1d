"""The population of a coefficient against the normal-normal model, by quadrature of its closed form."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import norm

from bayesdamp.inference.curves.population import Sample, population
from bayesdamp.types import Refusal

SCALE = 0.3
N = 4000


def sample(name: str, mean: float, sd: float, rng: np.random.Generator, prior_sd: float = SCALE) -> Sample:
    """Draws of the posterior of a measured value, mean ± sd, under the half-normal prior, from a wider normal."""
    x = np.abs(rng.normal(mean, 1.3 * sd, N))
    proposal = np.logaddexp(norm.logpdf(x, mean, 1.3 * sd), norm.logpdf(-x, mean, 1.3 * sd))
    log_prior = norm.logpdf(x, 0, prior_sd) + np.log(2)
    return Sample(name, x, norm.logpdf(x, mean, sd) + log_prior - proposal, log_prior)


def exact(means: np.ndarray, sds: np.ndarray) -> tuple[tuple, tuple, np.ndarray]:
    """Mean and sd of m and of τ, and each value's own posterior mean, far from zero: on a dense grid, no draws."""
    tau = np.linspace(1e-5, 0.1, 2000)  # 30 sds of the values
    m = np.linspace(1e-3, 0.2, 601)[:, None, None]
    var = sds**2 + tau[:, None] ** 2
    log_p = np.sum(-0.5 * (means - m) ** 2 / var - 0.5 * np.log(var), axis=-1)
    log_p = log_p - 0.5 * (m[..., 0] / SCALE) ** 2 - 0.5 * (tau / m[..., 0]) ** 2 - np.log(m[..., 0])
    p = np.exp(log_p - log_p.max())
    p /= p.sum()
    collected = []
    for x, q in ((m[:, 0, 0], p.sum(axis=1)), (tau, p.sum(axis=0))):
        mean = q @ x
        collected.append((mean, np.sqrt(q @ (x - mean) ** 2)))
    own = [np.sum(p * (a * tau**2 + m[..., 0] * s**2) / (s**2 + tau**2)) for a, s in zip(means, sds)]
    return collected[0], collected[1], np.array(own)


def test_far_from_zero_it_is_the_normal_normal_model():
    """4,000 draws each: their Monte Carlo error is some 2 % of an sd, the bounds 5 % of one."""
    rng = np.random.default_rng(1)
    means, sds = np.array([0.095, 0.102, 0.099, 0.108, 0.101, 0.093]), np.array([3, 2, 4, 3, 2, 3]) * 1e-3
    samples = [sample(f"s{i}", a, b, rng) for i, (a, b) in enumerate(zip(means, sds))]
    result = population(samples, SCALE)
    (m, m_sd), (tau, tau_sd), own = exact(means, sds)
    assert result.outcome == "ok"
    assert result.mean["mean"] == pytest.approx(m, abs=0.05 * m_sd)
    assert result.mean["sd"] == pytest.approx(m_sd, rel=0.05)
    assert result.spread["mean"] == pytest.approx(tau, abs=0.05 * tau_sd)
    assert result.spread["sd"] == pytest.approx(tau_sd, rel=0.05)
    for i, expected in enumerate(own):
        assert result.shrunk[f"s{i}"]["mean"] == pytest.approx(expected, abs=0.05 * sds[i])
    # Negative control: what a specimen alone says would fail.
    assert abs(own[3] - means[3]) > 0.5 * sds[3]


def test_at_zero_it_is_the_cut_off_model():
    """Specimens whose likelihoods reach over zero, against a dense grid over θ, m and τ of the cut-off normals."""
    rng = np.random.default_rng(3)
    means, sds = np.array([0.004, 0.012, -0.003, 0.007, 0.02]), np.full(5, 0.008)
    result = population([sample(f"s{i}", a, b, rng) for i, (a, b) in enumerate(zip(means, sds))], SCALE)
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
    for x, text in ((mean, result.mean), (spread, result.spread)):
        middle = np.sum(p * x)
        sd = np.sqrt(np.sum(p * (x - middle) ** 2))
        assert text["mean"] == pytest.approx(middle, abs=0.1 * sd)
        assert text["sd"] == pytest.approx(sd, rel=0.1)


def test_one_specimen_is_refused_and_few_draws_are_told():
    rng = np.random.default_rng(5)
    item = sample("a", 0.1, 1e-3, rng)
    with pytest.raises(Refusal, match="two specimens or more"):
        population([item], SCALE)
    poor = Sample("b", item.values[:60], item.log_weights[:60], item.log_prior[:60])
    assert "b has" in population([item, poor], SCALE).outcome
