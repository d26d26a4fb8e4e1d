"""Sparse regression of weak rows: correlated errors, and noise in the columns."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import product

import numpy as np
from scipy import sparse

from bayesdamp.estimators.regression.weak import whitener

FLOOR = 1e-6
"""A part of the inertia smaller than this share of it is no evidence for a term."""
NOISELESS = 1e-7
"""Noise below this share of the inertia, both in units of noise, biases nothing."""


@dataclass(frozen=True)
class Rows:
    """The weak form: inertia + columns x = noise, over m test functions.

    inertia (m,), columns (m, p); noise: per stretch the map of the samples' noise into inertia, and into each
    column, all (m_i, n_i).
    """

    inertia: np.ndarray
    columns: np.ndarray
    noise: list[tuple[sparse.csr_matrix, list[sparse.csr_matrix]]]

    def residual_noise(self, x: np.ndarray) -> list[sparse.csr_matrix]:
        """The map of the samples' noise into the residual at coefficients x (p,)."""
        return [
            sparse.csr_matrix(sum((c * b for c, b in zip(x, maps) if c != 0.0), first))
            for first, maps in self.noise
        ]


@dataclass(frozen=True)
class White:
    """Rows whose errors are independent and have the variance of a sample's noise, rotated onto the columns.

    inertia (p + 1,), columns (p + 1, p); count: rows before the rotation.
    moments (p + 1, p + 1): traces tr(C⁻¹B_k B_lᵀ) of the noise maps of all columns and, last, the inertia.
    """

    inertia: np.ndarray
    columns: np.ndarray
    count: int
    moments: np.ndarray


def whitened(rows: Rows, x: np.ndarray, sigma: float, wanted: np.ndarray | None = None) -> White:
    """Rows with independent errors, if the coefficients are x (p,).

    wanted (p,): the columns whose noise is to be known, all by default; none where there is no noise.
    """
    turn = whitener(rows.residual_noise(x))
    metric, start = turn.T @ turn, 0
    moments = np.zeros((x.size + 1, x.size + 1))
    of = np.r_[np.flatnonzero(np.ones(x.size, bool) if wanted is None else wanted), x.size]
    if sigma <= NOISELESS * float(np.linalg.norm(rows.inertia) / np.sqrt(max(np.trace(metric), 1e-300))):
        of = of[:0]
    for first, maps in rows.noise:
        part = slice(start, start := start + first.indptr.size - 1)
        every = [*maps, first]
        for place, i in enumerate(of):
            image = every[i].T @ metric[part, part]
            for j in of[: place + 1]:
                moments[i, j] += every[j].T.multiply(image).sum()
    moments = np.tril(moments) + np.tril(moments, -1).T
    small = np.asarray(np.linalg.qr(np.column_stack([turn @ rows.columns, turn @ rows.inertia]), mode="r"))
    return White(small[:, -1], small[:, :-1], turn.shape[0], moments)


@dataclass(frozen=True)
class Solution:
    """Coefficients (p,) and their standard errors (p,).

    left: the residual's sum of squares; expected: what the noise of inertia and columns would make of it.
    sound: whether the noise lets the terms be told apart; else its bias is still in the coefficients.
    """

    x: np.ndarray
    stderr: np.ndarray
    left: float
    expected: float
    sound: bool


def solved(white: White, support: np.ndarray, sigma: float) -> Solution:
    """The terms in `support`, freed of the bias that noise in their columns brings.

    A residual b + Gx with noise (A₀ + Σ x_l B_l) n, of covariance C, makes GᵀC⁻¹r have the mean
    σ² [tr(C⁻¹B_k A₀ᵀ) + Σ_l x_l tr(C⁻¹B_k B_lᵀ)], which is set against it.
    """
    kept = np.flatnonzero(support)
    scale = np.linalg.norm(white.columns[:, kept], axis=0)
    a, b = white.columns[:, kept] / scale, white.inertia
    own = sigma**2 * white.moments[np.ix_(kept, kept)] / np.outer(scale, scale)
    mixed = sigma**2 * white.moments[kept, -1] / scale
    gram = a.T @ a
    inverse = np.linalg.pinv(a, rcond=1e-12)
    plain = -inverse @ b
    free = gram - own
    sound = bool(np.linalg.eigvalsh(free)[0] > 0.5 * np.linalg.eigvalsh(gram)[0]) if kept.size else True
    # A step from the plain solution, so that nothing is lost where there is no noise.
    x = plain + (np.linalg.solve(free, mixed + own @ plain) if sound else 0.0)
    left = float(np.sum((b + a @ x) ** 2))
    sd = np.sqrt(left / max(white.count - kept.size, 1))
    full, stderr = np.zeros(support.size), np.zeros(support.size)
    full[kept], stderr[kept] = x / scale, sd * np.sqrt(np.sum(inverse**2, axis=1)) / scale
    one = np.r_[full, 1.0]
    return Solution(full, stderr, left, sigma**2 * float(one @ white.moments @ one), sound)


@dataclass(frozen=True)
class Sparse:
    """A sparse solution: its terms (p,) of bool, what solves for them, its score, and its least t-value."""

    support: np.ndarray
    solution: Solution
    score: float
    threshold: float


def sparse_path(white: White, dissipates: np.ndarray, sigma: float) -> list[Sparse]:
    """Sparse solutions: for every set of damping terms the others fall in the order of their t-values.

    score: the Bayesian information criterion for errors of known size. Solutions with negative damping are
    not admitted, nor those whose terms the noise does not tell apart.
    """
    floor = FLOOR * float(np.linalg.norm(white.inertia)) / np.sqrt(white.count)
    damping = np.flatnonzero(dissipates)
    found = []
    for chosen in product([False, True], repeat=damping.size):
        mask = ~dissipates
        mask[damping] = chosen
        while mask.any():
            one = solved(white, mask, sigma)
            t = np.where(mask, np.abs(one.x) / np.maximum(one.stderr, 1e-300), np.inf)
            if one.sound and np.all(one.x[dissipates] >= 0):
                variance = one.expected / white.count + floor**2
                score = one.left / variance + white.count * np.log(variance)
                score += mask.sum() * np.log(white.count)
                found.append(Sparse(mask.copy(), one, float(score), float(t.min())))
            others = np.flatnonzero(mask & ~dissipates)
            if others.size == 0:
                break
            mask[others[np.argmin(t[others])]] = False
    return found
