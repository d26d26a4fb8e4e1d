"""Probabilities that normal variables are all positive, against SciPy and quadrature; draws against rejection."""

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.stats import ks_2samp, multivariate_normal, norm

from bayesdamp.numerics.orthant import draw, log_probability

FALSE_ALARM = 1e-4
"""Probability of a false alarm of each comparison of draws."""


@pytest.mark.parametrize("k", [1, 2, 3, 4])
def test_the_probability_is_that_of_scipy(k: int) -> None:
    rng = np.random.default_rng(k)
    means = rng.normal(0, 1.5, (8, k))
    roots = rng.standard_normal((8, k, k + 1))
    roots[:4, k // 2] = roots[:4, 0]  # two coordinates are perfectly correlated
    covariances = roots @ roots.transpose(0, 2, 1)
    exactly = {"abseps": 1e-8, "releps": 1e-8, "maxpts": 10**6, "allow_singular": True}
    truth = [multivariate_normal.cdf(m, np.zeros(k), c, **exactly) for m, c in zip(means, covariances)]
    assert np.exp(log_probability(means, covariances)) == pytest.approx(truth, abs=1e-4, rel=2e-3)
    assert np.max(np.abs(np.exp(log_probability(-means, covariances)) - truth)) > 0.1  # control


def test_the_probability_in_20_dimensions_is_that_of_the_closed_form() -> None:
    """With correlations of one half it is the chance that the first of 21 independent variables is the smallest."""
    covariance = 0.5 * (np.eye(20) + np.ones((20, 20)))
    assert np.exp(log_probability(np.zeros((1, 20)), covariance[None])) == pytest.approx(1 / 21, rel=0.1)


def by_quadrature(mean: np.ndarray, r: float) -> float:
    """Return log P(both ≥ 0) for unit variances and correlation r, by quadrature over the second variable."""
    s = np.sqrt(1 - r * r)

    def log_density(y: float) -> float:
        return float(norm.logpdf(y, mean[1]) + norm.logcdf((mean[0] + r * (y - mean[1])) / s))

    grid = np.linspace(0, max(mean[1], 0) + 10, 40001)
    values = [log_density(y) for y in grid[::40]]
    at = int(np.argmax(values))
    top, centre = values[at], grid[::40][at]
    near = [p for p in (centre - 0.1, centre, centre + 0.1) if p > 0]
    ends = max(centre - 12, 0), centre + 12
    return top + float(np.log(quad(lambda y: np.exp(log_density(y) - top), *ends, points=near, limit=400)[0]))


@pytest.mark.parametrize(
    ("mean", "r"),
    [((12.0, -5.0), -0.99), ((-5.0, 12.0), 0.98), ((0.0, 0.0), -0.3), ((-5.0, -5.5), 0.8), ((1.3, -1.2), -0.9999)],
)  # fmt: skip
def test_small_probabilities_do_not_depend_on_the_order(mean: tuple[float, float], r: float) -> None:
    """One mean is far below 0, and the correlation strong. The logarithm is right to 2e-3."""
    covariance = np.array([[1.0, r], [r, 1.0]])
    truth = by_quadrature(np.array(mean), r)
    assert log_probability(np.array([mean]), covariance[None])[0] == pytest.approx(truth, abs=2e-3)


def smallest_p_value(draws: np.ndarray, truth: np.ndarray) -> float:
    """Return the smallest p-value of two-sample Kolmogorov–Smirnov tests of all coordinates and their sums in pairs."""
    rows, columns = np.triu_indices(draws.shape[1])
    sums = ((x[:, rows] + x[:, columns]).T for x in (draws, truth))
    return min(float(ks_2samp(*pair).pvalue) for pair in zip(*sums, strict=True))


@pytest.mark.parametrize("places", [[1], [0, 1, 3]])
def test_draws_are_those_of_rejection(places: list[int]) -> None:
    """False alarm: 1e-5 for each test. Every fourth draw is used, because resampling repeats draws.

    Control: draws of the normal distribution that are clipped at 0.
    """
    rng = np.random.default_rng(11 + len(places))
    mean, factor = np.array([0.3, -0.8, 1.0, 0.4]), rng.standard_normal((4, 4))
    draws = draw(rng, mean, factor, np.array(places, int), 8000)
    assert draws.shape == (8000, 4)
    assert np.all(draws[:, places] >= 0)
    truth = mean + rng.standard_normal((400_000, mean.size)) @ factor.T
    truth = truth[np.all(truth[:, places] >= 0, axis=1)]
    assert smallest_p_value(draws[::4], truth) > FALSE_ALARM / 10
    plain = mean + rng.standard_normal((2000, 4)) @ factor.T
    assert smallest_p_value(np.maximum(plain, 0), truth) < FALSE_ALARM / 10


def test_the_probability_in_one_dimension_is_the_normal_distribution_function() -> None:
    means = np.array([-200.0, -30.0, -3.0, 0.0, 2.0])
    logs = log_probability(means[:, None], np.full((5, 1, 1), 4.0))
    assert logs == pytest.approx(norm.logcdf(means / 2), rel=1e-12)
