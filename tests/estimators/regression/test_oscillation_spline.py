"""The smoothing spline of sindy: what it does not smooth, its noise, gaps, outliers."""

from __future__ import annotations

import numpy as np
import pytest

from bayesdamp.estimators.regression.oscillation_spline import OscillationSpline

PERIOD = 1.3
W = 2 * np.pi / PERIOD


def swing(t, order=0):
    """0.2 + (1 − t/20) cos ωt + t/30 sin ωt and its derivatives: amplitude and phase change linearly."""
    c, s = np.cos(W * t), np.sin(W * t)
    a, b = 1 - t / 20, t / 30
    if order == 0:
        return 0.2 + a * c + b * s
    if order == 1:
        return -c / 20 + s / 30 + W * (b * c - a * s)
    return 2 * W * (s / 20 + c / 30) - W**2 * (a * c + b * s)


def noisy(t, sd, seed=1):
    return swing(t) + sd * np.random.default_rng(seed).normal(size=t.size)


def test_slowly_changing_oscillations_cost_five_degrees_of_freedom():
    """Five functions are not smoothed at all, so five degrees of freedom are left, and a few for noise."""
    t = np.linspace(0.0, 10.0, 1000)
    spline = OscillationSpline([t], noisy(t, 0.01), PERIOD)
    assert 4.5 < spline.freedom < 12
    for order in range(3):
        wrong = np.sqrt(np.mean((spline(order) - swing(t, order)) ** 2)) / W**order
        assert wrong < 5 * 0.01 * np.sqrt(12 / 1000)  # a chance below 10⁻⁶
    # Negative control: at another period the same record is rough.
    assert OscillationSpline([t], noisy(t, 0.01), 1.7 * PERIOD).freedom > 20


def test_the_adjoint_is_the_adjoint():
    t = np.linspace(0.0, 10.0, 300)
    y, weights = noisy(t, 0.05), np.random.default_rng(2).normal(size=300)
    spline = OscillationSpline([t], y, PERIOD)
    for order in range(3):
        assert spline.adjoint(weights, order) @ y == pytest.approx(weights @ spline(order), rel=1e-8)
    assert spline.smoothed(y) == pytest.approx(spline(0))
