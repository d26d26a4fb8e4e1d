"""Laplace's evidence against closed forms and quadrature."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import dblquad
from scipy.stats import multivariate_normal, norm

from bayesdamp.inference.fit.laplace import log_integral, log_orthant


@pytest.mark.parametrize("mean", [-30.0, -3.0, 0.0, 2.0])
def test_one_wall_is_the_normal_distribution_function(mean: float) -> None:
    assert log_orthant(np.array([mean]), np.array([[4.0]])) == pytest.approx(norm.logcdf(mean / 2), rel=1e-12)


def test_two_and_three_walls_against_an_independent_rule() -> None:
    covariance = np.array([[1.0, -0.6, 0.2], [-0.6, 2.0, 0.5], [0.2, 0.5, 1.5]])
    mean = np.array([0.3, -0.8, 1.1])
    two = np.log(multivariate_normal(-mean[:2], covariance[:2, :2]).cdf([0.0, 0.0]))  # type: ignore
    assert log_orthant(mean[:2], covariance[:2, :2]) == pytest.approx(two, abs=1e-3)
    # P(z ≥ 0) of three by conditioning on the third, with the exact two-dimensional rule inside
    grid, weights = np.polynomial.legendre.leggauss(200)
    z = 5.0 * (grid + 1.0)
    gain = covariance[:2, 2] / covariance[2, 2]
    rest = covariance[:2, :2] - np.outer(gain, covariance[:2, 2])
    inner = [multivariate_normal(-(mean[:2] + gain * (x - mean[2])), rest).cdf([0.0, 0.0]) for x in z]  # type: ignore
    three = np.log(np.sum(5.0 * weights * norm.pdf(z, mean[2], 1.5**0.5) * inner))
    assert log_orthant(mean, covariance) == pytest.approx(three, abs=1e-3)
    assert abs(log_orthant(mean, np.diag(np.diag(covariance))) - three) > 0.01  # the correlation counts


def test_the_integral_of_a_cut_normal_is_exact() -> None:
    information, gradient = np.array([[3.0, 0.8], [0.8, 2.0]]), np.array([-1.5, 0.4])
    at = np.array([0.05, 0.3])

    def density(b: float, a: float) -> float:
        away = np.array([a, b]) - at
        return float(np.exp(gradient @ away - 0.5 * away @ information @ away))

    whole = dblquad(density, 0.0, 12.0, -12.0, 12.0)[0]
    found = log_integral(0.0, gradient, information, at, np.array([0]))
    assert np.exp(found) == pytest.approx(2 * whole, rel=1e-7)
