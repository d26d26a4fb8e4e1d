"""A decay by one power: its derivatives against differences."""

from __future__ import annotations

import numpy as np
import pytest

from bayesdamp.physics.amplitude.laws import NEAR_VISCOUS, power_decay, power_slopes

STEP = 1e-4


@pytest.mark.parametrize(
    "exponent", [-0.5, 0.3, 1.0, 1.0 + 0.3 * NEAR_VISCOUS, 1.0 - 3 * NEAR_VISCOUS, 1.7, 3.0]
)
def test_derivatives_of_a_decay(exponent):
    t = np.linspace(0.0, 1.2, 13)
    p = np.array([0.2, -0.9, exponent])

    def decay(p: np.ndarray) -> np.ndarray:
        return power_decay(t, p[0], p[1] - (p[2] - 1.0) * p[0], p[2])

    expected = np.column_stack([(decay(p + STEP * e) - decay(p - STEP * e)) / (2 * STEP) for e in np.eye(3)])
    np.testing.assert_allclose(power_slopes(t, p), expected, atol=2e-7)
    assert not np.allclose(power_slopes(t, p), 1.001 * expected, atol=2e-7)  # control
