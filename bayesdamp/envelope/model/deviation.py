"""A law that holds approximately: its rate is multiplied by 1 + g(s), s = t/T over the record.

g is piecewise linear on knots, normal with covariance τ² exp(-|Δs|/ℓ). An autonomous decay that is passed through
faster is the same decay on another clock, x(t) = X(t + ∫g dt), so that to first order ∂x/∂g_k = -rate(x) ∫ b_k dt.
"""

from __future__ import annotations

import numpy as np

KNOTS = 14


def hats(s: np.ndarray, count: int) -> np.ndarray:
    """Piecewise linear basis at s in [0, 1], shape (n, count)."""
    at = np.clip(s, 0.0, 1.0) * (count - 1)
    return np.clip(1.0 - np.abs(at[:, None] - np.arange(count)), 0.0, None)


def warp_integrals(s: np.ndarray, count: int) -> np.ndarray:
    """∫ from 0 to s of the basis, shape (n, count), exactly."""
    at = np.clip(s, 0.0, 1.0) * (count - 1)
    u = at[:, None] - np.arange(count)
    rising = np.clip(u + 1.0, 0.0, 1.0)
    falling = np.clip(u, 0.0, 1.0)
    found = 0.5 * rising**2 + falling - 0.5 * falling**2
    found[:, 0] -= 0.5  # the first hat has no rising half
    return found / (count - 1)
