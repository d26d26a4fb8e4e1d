"""The reflected Student t that evidence is sampled from."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import dblquad, quad
from scipy.stats import kstest, multivariate_t

from bayesdamp.inference.evidence.methods.importance import DEGREES, ReflectedT

FACTOR = np.array([[0.7, 0.0], [0.4, 0.5]])


def reflected(centre: float) -> ReflectedT:
    return ReflectedT(np.array([centre]), np.array([[0.8]]), np.array([True]))


def test_two_directions_integrate_to_one():
    q = ReflectedT(np.array([0.3, -0.5]), FACTOR, np.array([True, False]))
    total = dblquad(
        lambda y, x: float(np.exp(q.log_density(np.array([[x, y]]))[0])), 0, 40, -40, 40, epsabs=1e-5
    )[0]
    assert total == pytest.approx(1.0, abs=1e-4)


def test_without_folds_it_is_the_student_t():
    q = ReflectedT(np.array([0.3, -0.5]), FACTOR, np.array([False, False]))
    x = np.random.default_rng(0).normal(size=(50, 2))
    law = multivariate_t([0.3, -0.5], FACTOR @ FACTOR.T, df=DEGREES)
    np.testing.assert_allclose(q.log_density(x), law.logpdf(x), atol=1e-12)


def test_all_images_of_a_fully_folded_one():
    """The density of |x| is the sum over the four sign patterns."""
    q = ReflectedT(np.array([0.3, 0.5]), FACTOR, np.array([True, True]))
    law = multivariate_t([0.3, 0.5], FACTOR @ FACTOR.T, df=DEGREES)
    y = np.abs(np.random.default_rng(1).normal(size=(20, 2)))
    images = sum(law.pdf(y * np.array(s)) for s in ((1, 1), (1, -1), (-1, 1), (-1, -1)))
    np.testing.assert_allclose(q.log_density(y), np.log(images), atol=1e-12)


def test_draws_follow_the_density():
    """Kolmogorov–Smirnov over 2,000 draws at a false-alarm rate of 1e-3."""
    q = reflected(0.4)
    draws = q.draw(np.random.default_rng(2), 2000)[:, 0]
    assert np.all(draws >= 0)
    grid = np.linspace(0, 60, 120_001)
    mass = np.exp(q.log_density(grid[:, None]))
    cdf = np.concatenate([[0.0], np.cumsum(0.5 * (mass[1:] + mass[:-1]))]) * (grid[1] - grid[0])
    assert kstest(draws, lambda x: np.interp(x, grid, cdf)).pvalue > 1e-3


def test_negative_control_one_side_alone():
    """Without the mirror image the density near zero does not integrate to one."""
    q = reflected(0.4)
    q._signs = q._signs[:1]
    total = quad(lambda x: float(np.exp(q.log_density(np.array([[x]]))[0])), 0, np.inf, limit=200)[0]
    assert total < 0.9
