"""The weak form: smooth compact test functions against a record, and the sparse regression of its rows.

The rows have correlated errors, and there is noise in their columns.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import lru_cache
from itertools import product

import numpy as np
from scipy import sparse
from scipy.interpolate import make_interp_spline

POWER = 6
"""φ(s) = (1 − s²)^POWER on [−1, 1]: quadrature by the trapezoidal rule is then exact to rounding."""
OVERLAP = 8
"""Test functions in one width."""
LEAST_EIGENVALUE = 1e-7
"""Combinations of rows whose noise has less variance than this share of the noisiest do not count."""
FLOOR = 1e-6
"""A part of the inertia smaller than this share of it is no evidence for a term."""
NOISELESS = 1e-7
"""Noise below this share of the inertia, both in units of noise, biases nothing."""


@dataclass(frozen=True)
class Stretch:
    """One run of samples on a uniform clock.

    h: spacing in s. y (n,): the recorded quantity. theta, omega (n,): the state that nonlinear functions are
    evaluated at. velocity: the map from samples to omega, (n, n), if noise is known to pass through it, else empty.
    order: how often the recorded quantity is already differentiated, 0 to 2.
    """

    h: float
    y: np.ndarray
    theta: np.ndarray
    omega: np.ndarray
    velocity: sparse.csr_matrix
    order: int


def uniform(t: np.ndarray, *curves: np.ndarray) -> tuple[np.ndarray, ...]:
    """Return times and curves, each (n,), on a uniform clock: as they are, or by cubic interpolation."""
    gaps = np.diff(t)
    if np.all(np.abs(gaps - gaps.mean()) <= 1e-3 * gaps.mean()):
        return (t, *curves)
    even = np.linspace(t[0], t[-1], t.size)
    return (even, *(np.asarray(make_interp_spline(t, curve, k=3)(even)) for curve in curves))


def derivatives(s: np.ndarray, order: int) -> np.ndarray:
    """Return the order-th derivative by s of (1 − s²)^POWER, of the shape of s; 0 outside [−1, 1]."""
    bump = np.polynomial.Polynomial([1.0, 0.0, -1.0]) ** POWER
    return np.where(np.abs(s) < 1, bump.deriv(order)(s) if order else bump(s), 0.0)


def weights(n: int, h: float, width: float, order: int) -> sparse.csr_matrix:
    """Return weights (m, n) of n samples h apart; row j is (−1)^order h φ_j^(order).

    φ_j has unit integral and is `width` s wide.
    """
    half = max(int(width / h) // 2, POWER)
    step = max(2 * half // OVERLAP, 1)
    centres = np.arange(half, n - half, step)
    s = np.arange(-half, half + 1) / half
    norm = h * half * float(np.sum(derivatives(s, 0))) / half
    row = (-1) ** order * h * derivatives(s, order) / (h * half) ** order / norm
    columns = centres[:, None] + np.arange(-half, half + 1)
    starts = np.arange(centres.size + 1) * row.size
    return sparse.csr_matrix((np.tile(row, centres.size), columns.ravel(), starts), shape=(centres.size, n))


@lru_cache(maxsize=256)
def _kernel(half: int) -> np.ndarray:
    """Return weights of −ψ′ at −half … half samples, exact for polynomials up to degree six; unit spacing."""
    j = np.arange(-half, half + 1.0)
    s = j / (half + 1.0)
    basis = np.stack([s ** (2 * i + 1) * (1 - s**2) ** 3 for i in range(3)])
    moments = np.stack([basis @ s, basis @ s**3, basis @ s**5], axis=0)
    return np.linalg.solve(moments, [1.0 / (half + 1.0), 0.0, 0.0]) @ basis


def kernel_half_width(h: float, frequency: float, size: float, noise: float, most: int) -> int:
    """Return half the width in samples of the kernel whose velocity has the least mean square error.

    The velocity has amplitude `size` at `frequency` (rad/s), and a hundredth of it at three times that, as the flanks
    of friction cause; the displacement has white noise of standard deviation `noise`. most: the widest that is tried.
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
    """Return the map (n, n) from a record to its convolution with −ψ′; one-sided kernels near the ends."""
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


@dataclass(frozen=True)
class Rows:
    """The weak form: inertia + columns x = noise, over m test functions.

    inertia (m,), columns (m, p); noise: per stretch the map of the samples' noise into inertia, and into each
    column, all (m_i, n_i).
    """

    inertia: np.ndarray
    columns: np.ndarray
    noise: list[tuple[sparse.csr_matrix, list[sparse.csr_matrix]]]


@dataclass(frozen=True)
class WhiteRows:
    """Rows whose errors are independent and have the variance of a sample's noise, rotated onto the columns.

    inertia (p + 1,), columns (p + 1, p); count: rows before the rotation.
    moments (p + 1, p + 1): traces tr(C⁻¹B_k B_lᵀ) of the noise maps of all columns and, last, the inertia.
    """

    inertia: np.ndarray
    columns: np.ndarray
    count: int
    moments: np.ndarray


def whiten(rows: Rows, x: np.ndarray, sigma: float, wanted: np.ndarray) -> WhiteRows:
    """Return rows with independent errors, if the coefficients are x (p,).

    sigma: standard deviation of the samples' noise. wanted (p,): the columns whose noise is computed; none are if
    there is no noise.
    """
    maps = [sum((c * b for c, b in zip(x, columns) if c != 0.0), first) for first, columns in rows.noise]
    values, vectors = np.linalg.eigh(sparse.block_diag([a @ a.T for a in maps]).toarray())
    sound = values > LEAST_EIGENVALUE * values[-1]
    turn = (vectors[:, sound] / np.sqrt(values[sound])).T
    metric, start = turn.T @ turn, 0
    moments = np.zeros((x.size + 1, x.size + 1))
    if sigma > NOISELESS * float(np.linalg.norm(rows.inertia) / np.sqrt(max(np.trace(metric), 1e-300))):
        of = np.r_[np.flatnonzero(wanted), x.size]
        for first, columns in rows.noise:
            part = slice(start, start := start + first.indptr.size - 1)
            every = [*columns, first]
            for place, i in enumerate(of):
                image = every[i].T @ metric[part, part]
                for j in of[: place + 1]:
                    moments[i, j] += every[j].T.multiply(image).sum()
    moments = np.tril(moments) + np.tril(moments, -1).T
    small = np.asarray(np.linalg.qr(np.column_stack([turn @ rows.columns, turn @ rows.inertia]), mode="r"))
    return WhiteRows(small[:, -1], small[:, :-1], turn.shape[0], moments)


@dataclass(frozen=True)
class Solution:
    """Coefficients (p,) and their standard errors (p,).

    support (p,): the terms, of bool. left: the residual's sum of squares; expected: its expectation from the noise of
    inertia and columns. sound: whether the noise lets the terms be distinguished; otherwise its bias is still in the
    coefficients. score: see `sparse_path`. threshold: the least t-value.
    """

    support: np.ndarray
    x: np.ndarray
    stderr: np.ndarray
    left: float
    expected: float
    sound: bool
    score: float = np.inf
    threshold: float = np.inf


def solve_support(white: WhiteRows, support: np.ndarray, sigma: float) -> Solution:
    """Solve for the terms in `support` (p,), without the bias from noise in their columns.

    A residual b + Gx with noise (A₀ + Σ x_l B_l) n, of covariance C, gives GᵀC⁻¹r the mean
    σ² [tr(C⁻¹B_k A₀ᵀ) + Σ_l x_l tr(C⁻¹B_k B_lᵀ)], which is subtracted.
    """
    terms = np.flatnonzero(support)
    scale = np.linalg.norm(white.columns[:, terms], axis=0)
    a, b = white.columns[:, terms] / scale, white.inertia
    own = sigma**2 * white.moments[np.ix_(terms, terms)] / np.outer(scale, scale)
    mixed = sigma**2 * white.moments[terms, -1] / scale
    gram = a.T @ a
    inverse = np.linalg.pinv(a, rcond=1e-12)
    plain = -inverse @ b
    free = gram - own
    sound = bool(np.linalg.eigvalsh(free)[0] > 0.5 * np.linalg.eigvalsh(gram)[0]) if terms.size else True
    # A step from the plain solution, so that nothing is lost if there is no noise.
    x = plain + (np.linalg.solve(free, mixed + own @ plain) if sound else 0.0)
    left = float(np.sum((b + a @ x) ** 2))
    sd = np.sqrt(left / max(white.count - terms.size, 1))
    full, stderr = np.zeros(support.size), np.zeros(support.size)
    full[terms], stderr[terms] = x / scale, sd * np.sqrt(np.sum(inverse**2, axis=1)) / scale
    weights_of_noise = np.r_[full, 1.0]
    expected = sigma**2 * float(weights_of_noise @ white.moments @ weights_of_noise)
    return Solution(support, full, stderr, left, expected, sound)


def sparse_path(white: WhiteRows, dissipates: np.ndarray, sigma: float) -> list[Solution]:
    """Return sparse solutions: for every set of damping terms the others fall in the order of their t-values.

    The score is the Bayesian information criterion for errors of known size. Solutions with negative damping are
    excluded, and so are those whose terms the noise does not let be distinguished. dissipates (p,): which terms are
    damping.
    """
    floor = FLOOR * float(np.linalg.norm(white.inertia)) / np.sqrt(white.count)
    damping = np.flatnonzero(dissipates)
    path = []
    for chosen in product([False, True], repeat=damping.size):
        mask = ~dissipates
        mask[damping] = chosen
        while mask.any():
            solution = solve_support(white, mask.copy(), sigma)
            t = np.where(mask, np.abs(solution.x) / np.maximum(solution.stderr, 1e-300), np.inf)
            if solution.sound and np.all(solution.x[dissipates] >= 0):
                variance = solution.expected / white.count + floor**2
                score = solution.left / variance + white.count * np.log(variance)
                score += mask.sum() * np.log(white.count)
                path.append(replace(solution, score=float(score), threshold=float(t.min())))
            others = np.flatnonzero(mask & ~dissipates)
            if others.size == 0:
                break
            mask[others[np.argmin(t[others])]] = False
    return path
