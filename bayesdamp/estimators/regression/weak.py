"""Provide the weak form of the equation of motion: test functions, and sparse regression with correlated errors.

Each row of the regression is the equation of motion times one test function φ (zero outside a short interval),
integrated over time. The inertia of a row is ∫φ θ̈ dt plus the integral of the known force, and its columns are the
integrals of the candidate terms. The rows have correlated errors, and their columns have noise.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import product

import numpy as np
from scipy import sparse
from scipy.interpolate import make_interp_spline
from scipy.signal import savgol_coeffs, savgol_filter

POWER = 6
"""Power of the test function φ(s) = (1 − s²)^POWER on [−1, 1]; the trapezoidal rule is then exact to rounding."""
DEGREE = 6
"""Degree of the polynomials whose derivatives are the velocities."""
OVERLAP = 8
"""Number of test functions that begin within the width of one of them."""
LEAST_EIGENVALUE = 1e-7
"""Eigenvectors of the rows' covariance with an eigenvalue below this fraction of the largest are left out."""
FLOOR = 1e-6
"""Smallest rms residual that is distinguished from zero, as a fraction of the rms inertia (∫φ θ̈ dt) of all rows."""
NOISELESS = 1e-7
"""If the noise of a row with whitened errors is below this fraction of its inertia (∫φ θ̈ dt), the bias that noise
causes is not computed."""


@dataclass(frozen=True)
class Stretch:
    """The record before its first gap, with uniformly spaced samples.

    h: sampling interval in s. y (n,): the recorded quantity. theta, omega (n,): the state, at which functions of the
    library are evaluated. velocity (n, n): the matrix from samples to omega; zero for a recorded velocity or
    acceleration. order: order of the recorded derivative of the displacement, 0 to 2.
    """

    h: float
    y: np.ndarray
    theta: np.ndarray
    omega: np.ndarray
    velocity: sparse.csr_matrix
    order: int


def to_even_clock(t: np.ndarray, h: float, *curves: np.ndarray) -> tuple[np.ndarray, ...]:
    """Return uniform times with the interval h (s), and curves at these times, from their values at the times t (n,).

    The curves are interpolated by cubic splines if an interval of t differs from h by more than a thousandth of h; the
    number of values may then differ from n. Otherwise t and the curves are returned unchanged.
    """
    if np.all(np.abs(np.diff(t) - h) <= 1e-3 * h):
        return (t, *curves)
    even = t[0] + h * np.arange(int((t[-1] - t[0]) / h + 1e-6) + 1)
    return (even, *(np.asarray(make_interp_spline(t, curve, k=3)(even)) for curve in curves))


def derivatives(s: np.ndarray, order: int) -> np.ndarray:
    """Return the derivative of an order of (1 − s²)^POWER by s; 0 outside [−1, 1]. The shape is that of s."""
    bump = np.polynomial.Polynomial([1.0, 0.0, -1.0]) ** POWER
    return np.where(np.abs(s) < 1, bump.deriv(order)(s) if order else bump(s), 0.0)


def test_function_weights(n: int, h: float, width: float, order: int) -> sparse.csr_matrix:
    """Return the weights (m, n) by which n samples, h (s) apart, are integrated against derivatives of test functions.

    Row j is (−1)^order h φ_j^(order), where φ_j has unit integral, is `width` (s) wide (or more, if that is too few
    samples), and is entirely within the samples. Each function begins an eighth of the width (`OVERLAP`) after the one
    before.
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


def kernel_half_width(h: float, frequency: float, size: float, noise: float, most: int) -> int:
    """Return the half width (samples) of the derivative kernel whose velocity has the smallest mean square error.

    The assumed velocity has amplitude `size` at `frequency` (rad/s) and a third harmonic of one hundredth of it, as dry
    friction causes; the displacement has white noise of standard deviation `noise`. size: in rad/s or m/s; noise: in
    rad or m. h: sampling interval in s. most: largest half width in samples.
    """
    best, least = 4, np.inf
    for half in range(4, max(most, 4) + 1, max(1, most // 60)):
        j = np.arange(-half, half + 1)
        kernel = savgol_coeffs(j.size, DEGREE, deriv=1, delta=h, use="dot")
        wrong = 0.0
        for factor, fraction in ((1, 1.0), (3, 0.01)):
            w = factor * frequency
            wrong += (fraction * size * (float(kernel @ np.sin(w * j * h)) / w - 1.0)) ** 2 / 2
        wrong += noise**2 * float(kernel @ kernel)
        if wrong < least:
            best, least = half, wrong
    return best


def velocity_map(n: int, h: float, half: int) -> sparse.csr_matrix:
    """Return the matrix (n, n) that computes velocities from n displacements, h (s) apart.

    Row i has the weights of Savitzky and Golay: the derivative at sample i of a polynomial of degree `DEGREE` (less if
    n is small) that is fitted to the 2 half + 1 nearest samples.
    """
    half = min(half, (n - 1) // 2)
    width = 2 * half + 1
    degree = min(DEGREE, 2 * half)
    window = np.asarray(savgol_filter(np.eye(width), width, degree, deriv=1, delta=h, axis=0))
    middle = np.tile(window[half], (n - 2 * half, 1))
    columns = np.clip(np.arange(n) - half, 0, n - width)[:, None] + np.arange(width)
    values = np.vstack([window[:half], middle, window[half + 1 :]])
    return sparse.csr_matrix((values.ravel(), columns.ravel(), width * np.arange(n + 1)), shape=(n, n))


@dataclass(frozen=True)
class Rows:
    """The weak form, inertia + columns · x = 0 apart from noise, for m test functions φ and p terms f, coefficients x.

    inertia (m,): ∫φ θ̈ dt plus the integral of the known force. columns (m, p): ∫φ f dt for each term f.
    inertia_slopes, columns_slopes: the derivatives by the n samples of the inertia and of each column, (m, n) each.
    """

    inertia: np.ndarray
    columns: np.ndarray
    inertia_slopes: sparse.csr_matrix
    columns_slopes: list[sparse.csr_matrix]


@dataclass(frozen=True)
class WhiteRows:
    """The weak form (`Rows`), transformed so that its errors are independent and have the variance of a sample's noise.

    inertia (p + 1,), columns (p + 1, p): after a further orthogonal transformation that reduces the rows to p + 1.
    count: number of rows before this reduction. moments (p + 1, p + 1): traces tr(C⁻¹B_k B_lᵀ), with the covariance C
    of the rows for unit noise of the samples, and the derivatives B_k by the samples of each column and, last, of the
    inertia.
    """

    inertia: np.ndarray
    columns: np.ndarray
    count: int
    moments: np.ndarray


def whiten(rows: Rows, x: np.ndarray, sigma: float, wanted: np.ndarray) -> WhiteRows:
    """Return the rows, transformed so that their errors are independent if the coefficients are x (p,).

    sigma: standard deviation of the samples' noise, in the unit of the record. wanted (p,) of bool: the columns whose
    moments are computed; the others are 0, and all are 0 if the noise is negligible (`NOISELESS`).
    """
    slopes = [*rows.columns_slopes, rows.inertia_slopes]
    of_rows = sum((c * b for c, b in zip(x, slopes) if c != 0.0), rows.inertia_slopes)
    values, vectors = np.linalg.eigh((of_rows @ of_rows.T).toarray())
    sound = values > LEAST_EIGENVALUE * values[-1]
    turn = (vectors[:, sound] / np.sqrt(values[sound])).T
    metric = turn.T @ turn
    moments = np.zeros((x.size + 1, x.size + 1))
    if sigma > NOISELESS * float(np.linalg.norm(rows.inertia) / np.sqrt(max(np.trace(metric), 1e-300))):
        of = np.r_[np.flatnonzero(wanted), x.size]
        for place, i in enumerate(of):
            image = slopes[i].T @ metric
            for j in of[: place + 1]:
                moments[i, j] = slopes[j].T.multiply(image).sum()
    moments = np.tril(moments) + np.tril(moments, -1).T
    small = np.asarray(np.linalg.qr(np.column_stack([turn @ rows.columns, turn @ rows.inertia]), mode="r"))
    return WhiteRows(small[:, -1], small[:, :-1], turn.shape[0], moments)


@dataclass(frozen=True)
class Solution:
    """A sparse solution: coefficients x (p,) and their standard errors (p,).

    support (p,): whether each term is used. left: residual sum of squares. expected: its expectation from the noise of
    inertia and columns. sound: whether the terms can be distinguished despite the noise; otherwise the coefficients are
    not corrected for bias. score: Bayesian information criterion for errors of known size; the smallest is best.
    """

    support: np.ndarray
    x: np.ndarray
    stderr: np.ndarray
    left: float
    expected: float
    sound: bool
    score: float = np.inf


def solve_support(white: WhiteRows, support: np.ndarray, sigma: float) -> Solution:
    """Return the solution with the terms in `support` (p,), corrected for the bias from noise in their columns.

    white: the weak form with independent errors. support: mask of the terms that are used. sigma: standard deviation σ
    of the samples' noise n. The residual r = b + Gx, with the inertia b and the columns G,
    has the noise (A₀ + Σ x_l B_l) n, where A₀ and B_l are the derivatives of b and of column l by the samples. With its
    covariance C for σ = 1, the mean of (GᵀC⁻¹r)_k is σ² [tr(C⁻¹B_k A₀ᵀ) + Σ_l x_l tr(C⁻¹B_k B_lᵀ)], which is
    subtracted.
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
    # The correction is added to the plain solution, so that there is no loss of digits without noise.
    x = plain + (np.linalg.solve(free, mixed + own @ plain) if sound else 0.0)
    left = float(np.sum((b + a @ x) ** 2))
    sd = np.sqrt(left / max(white.count - terms.size, 1))
    full, stderr = np.zeros(support.size), np.zeros(support.size)
    full[terms], stderr[terms] = x / scale, sd * np.sqrt(np.sum(inverse**2, axis=1)) / scale
    weights_of_noise = np.r_[full, 1.0]
    expected = sigma**2 * float(weights_of_noise @ white.moments @ weights_of_noise)
    return Solution(support, full, stderr, left, expected, sound)


def sparse_path(white: WhiteRows, dissipates: np.ndarray, sigma: float) -> list[Solution]:
    """Return sparse solutions: for every set of damping terms, other terms are removed in the order of their t-values.

    The score is the Bayesian information criterion for errors of known size. Solutions with negative damping, and those
    whose terms cannot be distinguished despite the noise, are excluded. The list is not sorted by the score, and can be
    empty. white: the weak form with independent errors. dissipates (p,): which terms are damping. sigma: standard
    deviation of the samples' noise, in the unit of the record.
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
                path.append(replace(solution, score=float(score)))
            others = np.flatnonzero(mask & ~dissipates)
            if others.size == 0:
                break
            mask[others[np.argmin(t[others])]] = False
    return path
