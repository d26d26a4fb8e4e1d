"""Draws that are chosen by their weights."""

import numpy as np

from bayesdamp.numerics.weights import resample


def test_draws_are_chosen_by_their_weights():
    """Each as often as its share of the weights, within one. Control: multinomial draws are not."""
    rng = np.random.default_rng(3)
    log_weights = rng.normal(scale=2.0, size=50)
    shares = np.exp(log_weights) / np.exp(log_weights).sum()
    counts = np.bincount(resample(log_weights, 1000, rng), minlength=50)
    assert np.max(np.abs(counts - 1000 * shares)) < 1.0
    assert np.max(np.abs(rng.multinomial(1000, shares) - 1000 * shares)) > 1.0
