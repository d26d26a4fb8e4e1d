"""Rows of the weak form: smooth compact test functions against a record, and what noise does to each row."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from scipy import sparse
from scipy.interpolate import make_interp_spline

POWER = 6
"""φ(s) = (1 − s²)^POWER on [−1, 1]: quadrature by the trapezoidal rule is then exact to rounding."""
OVERLAP = 8
"""Test functions in one width."""
LEAST_EIGENVALUE = 1e-7
"""Combinations of rows whose noise has less variance than this share of the noisiest do not count."""


@dataclass(frozen=True)
class Stretch:
    """One run of samples on a uniform clock.

    h: spacing in s. t, y (n,): times and the recorded quantity. theta, omega (n,): the state that nonlinear
    functions are taken of. velocity: the map from samples to omega, (n, n), where noise is known to pass
    through it, else empty. order: how often the recorded quantity is already differentiated, 0 to 2.
    """

    h: float
    t: np.ndarray
    y: np.ndarray
    theta: np.ndarray
    omega: np.ndarray
    velocity: sparse.csr_matrix
    order: int


def uniform(t: np.ndarray, *curves: np.ndarray) -> tuple[np.ndarray, ...]:
    """Times and curves, each (n,), on a uniform clock: as they are, or by cubic interpolation."""
    gaps = np.diff(t)
    if np.all(np.abs(gaps - gaps.mean()) <= 1e-3 * gaps.mean()):
        return (t, *curves)
    even = np.linspace(t[0], t[-1], t.size)
    return (even, *(np.asarray(make_interp_spline(t, curve, k=3)(even)) for curve in curves))


def derivatives(s: np.ndarray, order: int) -> np.ndarray:
    """The order-th derivative by s of (1 − s²)^POWER, of the shape of s; 0 outside [−1, 1]."""
    bump = np.polynomial.Polynomial([1.0, 0.0, -1.0]) ** POWER
    return np.where(np.abs(s) < 1, bump.deriv(order)(s) if order else bump(s), 0.0)


def weights(n: int, h: float, width: float, order: int) -> sparse.csr_matrix:
    """(m, n): row j is (−1)^order h φ_j^(order) at n samples h apart, φ_j of unit integral, `width` s wide."""
    half = max(int(width / h) // 2, POWER)
    step = max(2 * half // OVERLAP, 1)
    centres = np.arange(half, n - half, step)
    s = np.arange(-half, half + 1) / half
    norm = h * half * float(np.sum(derivatives(s, 0))) / half
    row = (-1) ** order * h * derivatives(s, order) / (h * half) ** order / norm
    at = centres[:, None] + np.arange(-half, half + 1)
    starts = np.arange(centres.size + 1) * row.size
    return sparse.csr_matrix((np.tile(row, centres.size), at.ravel(), starts), shape=(centres.size, n))


@lru_cache(maxsize=256)
def _kernel(half: int) -> np.ndarray:
    """Weights of −ψ′ at −half … half samples, exact for polynomials up to the sixth degree; unit spacing."""
    j = np.arange(-half, half + 1.0)
    s = j / (half + 1.0)
    basis = np.stack([s ** (2 * i + 1) * (1 - s**2) ** 3 for i in range(3)])
    moments = np.stack([basis @ s, basis @ s**3, basis @ s**5], axis=0)
    return np.linalg.solve(moments, [1.0 / (half + 1.0), 0.0, 0.0]) @ basis


def kernel_half_width(h: float, frequency: float, size: float, noise: float, most: int) -> int:
    """Half the width in samples of the kernel whose velocity has the least mean square error.

    For a velocity of amplitude `size` at `frequency` (rad/s), with a hundredth of it at three times that, as
    the flanks of friction have it, and white noise of sd `noise` in the displacement.
    """
    best, least = 4, np.inf
    for half in range(4, max(most, 4) + 1, max(1, most // 60)):
        kernel, j = _kernel(half) / h, np.arange(-half, half + 1)
        wrong = 0.0
        for factor, share in ((1, 1.0), (3, 0.01)):
            w = factor * frequency
            wrong += (share * size * (float(kernel @ np.sin(w * j * h)) / w - 1.0)) ** 2 / 2
        wrong += noise**2 * float(kernel @ kernel)
        if wrong < least:
            best, least = half, wrong
    return best


def velocity_map(n: int, h: float, half: int) -> sparse.csr_matrix:
    """(n, n): velocity as the record's convolution with −ψ′; near the ends by one-sided kernels."""
    half = min(half, (n - 1) // 2)
    j = np.arange(-half, half + 1)
    inside = np.arange(half, n - half)
    data = [np.tile(_kernel(half) / h, inside.size)]
    rows, columns = [np.repeat(inside, j.size)], [(inside[:, None] + j).ravel()]
    s = j / half
    power = np.vander(s, 7, increasing=True)
    weight = np.sqrt((1 - (j / (half + 1.0)) ** 2) ** 3)
    inverse = np.linalg.pinv(power * weight[:, None]) * weight
    for i in range(half):
        slope = np.arange(1, 7) * s[i] ** np.arange(6)
        kernel = slope @ inverse[1:] / (half * h)
        for row, column, values in (
            (i, np.arange(j.size), kernel),
            (n - 1 - i, n - 1 - np.arange(j.size), -kernel),
        ):
            rows.append(np.full(j.size, row))
            columns.append(column)
            data.append(values)
    return sparse.csr_matrix(
        (np.concatenate(data), (np.concatenate(rows), np.concatenate(columns))), shape=(n, n)
    )


def whitener(noise: list[sparse.csr_matrix]) -> np.ndarray:
    """(r, m): rows become independent with the variance of one sample; noise maps (m_i, n_i), one a stretch."""
    covariance = sparse.block_diag([a @ a.T for a in noise]).toarray()
    values, vectors = np.linalg.eigh(covariance)
    kept = values > LEAST_EIGENVALUE * values[-1]
    return (vectors[:, kept] / np.sqrt(values[kept])).T
