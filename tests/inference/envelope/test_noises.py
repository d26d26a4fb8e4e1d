"""Corrections of the readings of a decay, before laws are fitted."""

import numpy as np
import pytest

from bayesdamp.inference.envelope.candidates import Blocks
from bayesdamp.inference.envelope.decay import infer_noises


def quadratic_decay(t: np.ndarray) -> np.ndarray:
    """Return ln A for dA/dt = -4 A² with A = 1 at the start."""
    return -np.log1p(4.0 * t)


def test_means_of_readings_are_corrected_for_the_curvature_of_the_decay():
    """Blocks of twenty readings with very little noise. Control: the means themselves are five times further off."""
    each, n = 20, 60
    t = np.arange(each * n) * (10.0 / (each * n))
    x = quadratic_decay(t).reshape(n, each).mean(axis=1)
    times = t.reshape(n, each).mean(axis=1)
    scatter = 1e-4 * np.random.default_rng(1).standard_normal(n)
    b = Blocks(times - times[0], x + scatter, 10.0, float(x[0] - x[-1]) / 10.0, None, each)
    truth = quadratic_decay(times) + scatter
    assert np.abs(b.x - truth).max() > 5e-3
    assert infer_noises(b)[0].x == pytest.approx(truth, abs=1e-3)


def test_means_of_a_straight_decay_and_of_readings_at_rest_are_not_corrected():
    """Friction stops the second motion within the last block. Control: with ln A = -60 at rest, its mean changed by
    26."""
    t, rng = np.linspace(0.0, 10.0, 60), np.random.default_rng(2)
    for decay, tolerance in ((1.0 - 0.3 * t, 1e-4), (np.log1p(-t / 10.02), 0.1)):
        x = decay + 0.01 * rng.standard_normal(60)
        b = Blocks(t, x, 10.0, float(x[0] - x[-1]) / 10.0, None, 20)
        assert infer_noises(b)[0].x == pytest.approx(x, abs=tolerance)
