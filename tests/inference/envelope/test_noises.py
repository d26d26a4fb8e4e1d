"""Corrections of the readings of a decay, before laws are fitted."""

from __future__ import annotations

import numpy as np
import pytest

from bayesdamp.inference.envelope.candidates import Blocks
from bayesdamp.inference.envelope.decay import infer_noises
from bayesdamp.physics.amplitude import decay

TERMS, RATES = ("quadratic",), np.array([4.0])


def test_means_of_readings_are_corrected_for_the_curvature_of_the_decay():
    """Blocks of twenty readings with very little noise. Control: the means themselves are five times further off."""
    each, n = 20, 60
    t = np.arange(each * n) * (10.0 / (each * n))
    x = decay(t, 0.0, TERMS, RATES).reshape(n, each).mean(axis=1)
    times = t.reshape(n, each).mean(axis=1)
    start = times[0]
    rng = np.random.default_rng(1)
    scatter = 1e-4 * rng.standard_normal(n)
    b = Blocks(times - start, x + scatter, 10.0, float(x[0] - x[-1]) / 10.0, None, each)
    result = infer_noises(b)[0]
    truth = decay(times, 0.0, TERMS, RATES) + scatter
    assert np.abs(b.x - truth).max() > 5e-3
    assert result.x == pytest.approx(truth, abs=1e-3)


def test_the_means_of_a_straight_decay_are_not_changed():
    t, noise = np.linspace(0.0, 10.0, 60), 0.01 * np.random.default_rng(2).standard_normal(60)
    x = decay(t, 1.0, ("viscous",), np.array([0.3])) + noise
    b = Blocks(t, x, 10.0, 0.3, None, 20)
    assert infer_noises(b)[0].x == pytest.approx(x, abs=1e-4)
