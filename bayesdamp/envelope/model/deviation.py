"""A law that holds approximately: its rate is multiplied by 1 + g(s), s = t/T over the record.

g is piecewise linear on knots, normal with covariance τ² exp(-|Δs|/ℓ). An autonomous decay that is passed through
faster is the same decay on another clock, x(t) = X(t + ∫g dt), so that to first order ∂x/∂g_k = -rate(x) ∫ b_k dt.
"""

from __future__ import annotations

from functools import cache

import numpy as np

from bayesdamp.inference.deviation.gaussian.hyperparameters import EXACT, LENGTHS, MEAN_G, masses

KNOTS = 14
TAUS = np.array([1e-3, 2e-3, 4e-3, 8e-3, 0.015, 0.03, 0.06, 0.12, 0.25])


@cache
def knot_covariance(count: int, length: float) -> np.ndarray:
    """Correlation of g at equidistant knots on [0, 1], shape (count, count)."""
    s = np.linspace(0.0, 1.0, count)
    return np.exp(-np.abs(s[:, None] - s) / length)


@cache
def knot_precisions() -> tuple[np.ndarray, np.ndarray]:
    """Of g at the knots where τ is 1, for each pair of `weights`: (pairs, KNOTS, KNOTS), and their ln determinants."""
    found = np.stack([np.linalg.inv(knot_covariance(KNOTS, float(length))) for length in weights()[1]])
    return found, np.linalg.slogdet(found)[1]


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


@cache
def weights() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """(τ, ℓ, log prior probability) of each pair on the grid, shape (pairs,); the first is τ = 0."""
    tau, length, log_prior = np.array([(0.0, 1.0, np.log(EXACT)), *masses(TAUS, MEAN_G, LENGTHS)]).T
    return tau, length, log_prior
