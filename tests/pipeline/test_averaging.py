"""Averages over models by their probabilities, and draws by their weights."""

from __future__ import annotations

import numpy as np
from scipy.stats import norm

from bayesdamp.numerics.weights import resample
from bayesdamp.pipeline.candidates.evidence import average_curves
from bayesdamp.pipeline.candidates.posteriors import STORED_LEVELS


def quantiles(mean: float, sd: float) -> np.ndarray:
    return norm(mean, sd).ppf(STORED_LEVELS)[:, None] + np.array([0.0, 10.0])


def test_the_average_of_two_models_is_their_mixture():
    """The quantiles are those of the mixture's distribution. Control: the mean of the models' own quantiles."""
    low, median, high = average_curves(
        {"a": quantiles(0.0, 0.1), "b": quantiles(1.0, 0.2)}, {"a": 0.25, "b": 0.75}
    )
    x = np.linspace(-1, 2, 300_001)
    exact = np.interp([0.025, 0.5, 0.975], 0.25 * norm(0, 0.1).cdf(x) + 0.75 * norm(1, 0.2).cdf(x), x)
    np.testing.assert_allclose([low[0], median[0], high[0]], exact, atol=0.01)
    assert abs(0.75 + 0.25 * norm(0, 0.1).ppf(0.025) + 0.75 * norm(0, 0.2).ppf(0.025) - exact[0]) > 0.2


def test_draws_are_chosen_by_their_weights():
    """Each as often as its share of the weights, within one. Control: multinomial draws are not."""
    rng = np.random.default_rng(3)
    log_weights = rng.normal(scale=2.0, size=50)
    shares = np.exp(log_weights) / np.exp(log_weights).sum()
    counts = np.bincount(resample(log_weights, 1000, rng), minlength=50)
    assert np.max(np.abs(counts - 1000 * shares)) < 1.0
    assert np.max(np.abs(rng.multinomial(1000, shares) - 1000 * shares)) > 1.0
