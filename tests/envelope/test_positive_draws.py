"""Draws of normals that are cut off at zero, against rejection."""

from __future__ import annotations

import numpy as np

from bayesdamp.envelope.answer.posterior import positive_draws

COVARIANCE = np.array([[1.0, -0.8, 0.5], [-0.8, 1.5, -0.7], [0.5, -0.7, 0.8]])


def test_draws_are_those_that_rejection_keeps():
    """Means of 4,000 draws against 20,000 kept ones, five standard errors: one false alarm in a million runs."""
    rng = np.random.default_rng(5)
    mean = np.array([-0.5, 0.6, 0.4])
    truth = rng.multivariate_normal(mean, COVARIANCE, 200_000)
    truth = truth[np.all(truth > 0, axis=1)]
    n = 4000
    found = positive_draws(np.tile(mean, (n, 1)), np.tile(COVARIANCE, (n, 1, 1)), np.full((n, 3), 0.5), rng)
    assert found.min() >= 0
    assert np.all(np.abs(found.mean(0) - truth.mean(0)) < 5 * truth.std(0) * np.sqrt(1 / n + 1 / len(truth)))
    # Negative control: draws that are not cut off are not these.
    loose = rng.multivariate_normal(mean, COVARIANCE, n)
    assert np.any(np.abs(loose.mean(0) - truth.mean(0)) > 5 * truth.std(0) * np.sqrt(1 / n + 1 / len(truth)))
