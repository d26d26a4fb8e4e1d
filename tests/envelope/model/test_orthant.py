"""Normals that are cut off at zero, against scipy's own and against rejection."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import multivariate_normal

from bayesdamp.envelope.model.orthant import draw_orthant, log_orthant

COVARIANCE = np.array([[1.0, -0.8, 0.5], [-0.8, 1.5, -0.7], [0.5, -0.7, 0.8]])


@pytest.mark.parametrize("d", [1, 2, 3])
@pytest.mark.parametrize("mean", [(1.0, 0.5, 0.2), (-1.0, 0.4, 0.3), (-2.0, -1.0, 0.5), (5.0, 4.0, 6.0)])
def test_probability_is_that_of_scipy(d, mean):
    mean, covariance = np.array(mean[:d]), COVARIANCE[:d, :d]
    truth = multivariate_normal(np.zeros(d), covariance, seed=1).cdf(
        mean
    )  # P(x > 0), x normal about the mean
    found = log_orthant(mean[None], covariance[None])[0]
    assert np.exp(found) == pytest.approx(float(truth), rel=2e-3)


def test_far_tails_keep_their_order_of_magnitude():
    mean = np.array([[-8.0, 3.0]])
    independent = log_orthant(mean, np.eye(2)[None])[0]
    assert independent == pytest.approx(-35.013 + np.log(0.99865), abs=0.02)  # ln Φ(-8) = -35.0134


def test_draws_are_those_that_rejection_keeps():
    """Means of 4,000 draws against 20,000 kept ones, five standard errors: one false alarm in a million runs."""
    rng = np.random.default_rng(5)
    mean = np.array([-0.5, 0.6, 0.4])
    truth = rng.multivariate_normal(mean, COVARIANCE, 200_000)
    truth = truth[np.all(truth > 0, axis=1)]
    n = 4000
    found = draw_orthant(np.tile(mean, (n, 1)), np.tile(COVARIANCE, (n, 1, 1)), np.full((n, 3), 0.5), rng)
    assert found.min() >= 0
    assert np.all(np.abs(found.mean(0) - truth.mean(0)) < 5 * truth.std(0) * np.sqrt(1 / n + 1 / len(truth)))
    # Negative control: draws that are not cut off are not these.
    loose = rng.multivariate_normal(mean, COVARIANCE, n)
    assert np.any(np.abs(loose.mean(0) - truth.mean(0)) > 5 * truth.std(0) * np.sqrt(1 / n + 1 / len(truth)))
