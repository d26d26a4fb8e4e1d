"""Compute the equivalent damping ratio of a sum of terms by harmonic balance."""

import math
from typing import Any


def ratio(
    amplitude: Any, frequency: Any, viscous: Any = 0.0, coulomb: Any = 0.0, quadratic: Any = 0.0
) -> Any:
    """Return the ratio of 2 viscous v + coulomb sign(v) + quadratic v|v| (per inertia, SI); frequency in rad/s."""
    return (
        viscous / frequency
        + 2 * coulomb / (math.pi * frequency**2 * amplitude)
        + 4 * quadratic * amplitude / (3 * math.pi)
    )
