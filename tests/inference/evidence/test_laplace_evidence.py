"""Laplace's evidence against closed forms and quadrature."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import dblquad

from bayesdamp.inference.mode import log_integral


def test_the_integral_of_a_cut_normal_is_exact() -> None:
    information, gradient = np.array([[3.0, 0.8], [0.8, 2.0]]), np.array([-1.5, 0.4])
    at = np.array([0.05, 0.3])

    def density(b: float, a: float) -> float:
        away = np.array([a, b]) - at
        return float(np.exp(gradient @ away - 0.5 * away @ information @ away))

    whole = dblquad(density, 0.0, 12.0, -12.0, 12.0)[0]
    result = log_integral(0.0, gradient, information, at, np.array([0]))
    assert np.exp(result) == pytest.approx(2 * whole, rel=1e-7)
