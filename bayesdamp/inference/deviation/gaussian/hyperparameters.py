"""Sizes and lengths of the deviations: a grid with prior masses, and the covariances of g and h at the knots."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from itertools import product

import numpy as np

EXACT = 0.8
"""Prior probability that a law holds exactly."""
MEAN_G, MEAN_H = 0.03, 0.01
"""Where it does not: means of the exponential priors of the relative deviations' sds, of damping and of frequency."""
SIZES_G = np.geomspace(0.002, 0.25, 9)
SIZES_H = np.geomspace(0.0003, 0.03, 6)
LENGTHS = (0.1, 0.3, 1.0)
"""Correlation lengths as shares of the record."""
WIDE = (0.1, 0.3, 1.0, 3.0)
"""Sizes of a log deviation that may be anything: up to a factor of 20 either way."""
WIDE_LENGTHS = (0.1, 0.3, 1.0)
JITTER = 1e-6
LEAST_KNOTS, MOST_KNOTS = 4, 16
Size = tuple[float, float, float]
"""Size and correlation length of a deviation, and the log prior mass of both."""
NONE: Size = (0.0, 1.0, 0.0)
"""No deviation, for certain."""


@dataclass(frozen=True)
class Grid:
    """Combinations of hyperparameters: log prior masses (c,), factors of the covariances of (g, h), (c, 2n, 2n)."""

    size_g: np.ndarray
    size_h: np.ndarray
    log_prior: np.ndarray
    factors: np.ndarray


def knots_of(duration: float, cycles: float) -> np.ndarray:
    """Return equidistant knots from 0 to the duration: one for every two cycles, 4 to 16 of them."""
    return np.linspace(0.0, duration, int(np.clip(round(cycles / 2) + 1, LEAST_KNOTS, MOST_KNOTS)))


@lru_cache(maxsize=32)
def grid_of(
    knots: int,
    exact: bool = False,
    coarse: bool = False,
    absorbed: tuple[bool, bool] = (False, False),
    phases: bool = True,
) -> Grid:
    """Return the grid for a number of knots.

    Parameters
    ----------
    knots : int
        Number of knots, n.
    exact : bool
        Only the combination in which both laws hold exactly.
    coarse : bool
        Every other size, and the shortest and the longest length.
    absorbed : tuple of bool
        Whether a parameter (a coefficient, the stiffness) already contains a constant deviation of the damping, and of
        the frequency. The deviation is then taken about its mean over the record: no record can separate the two, and
        both together would only stretch the posterior along a curve that its linear model leaves.
    phases : bool
        Whether the record has phases. Without them, the factors are those of g alone, (c, n, n).
    """
    step = 2 if coarse else 1
    of_g, of_h = [NONE], [NONE]
    if not exact:
        of_g = _with_none(SIZES_G[::step], MEAN_G, LENGTHS[::step])
        of_h = _with_none(SIZES_H[::step], MEAN_H, LENGTHS[::step])
    if phases:
        return _combine(knots, of_g, of_h, absorbed)
    grid = _combine(knots, of_g, [NONE], absorbed)
    return replace(grid, factors=grid.factors[:, :knots, :knots])


@lru_cache(maxsize=8)
def wide_grid(knots: int) -> Grid:
    """Return the grid of a damping that follows no law: g of any size, all equally probable; h on the coarse grid."""
    mass = -float(np.log(len(WIDE) * len(WIDE_LENGTHS)))
    of_g = [(size, length, mass) for size in WIDE for length in WIDE_LENGTHS]
    return _combine(knots, of_g, _with_none(SIZES_H[::2], MEAN_H, LENGTHS[::2]))


def _with_none(sizes: np.ndarray, mean: float, lengths: tuple[float, ...]) -> list[Size]:
    """Return no deviation, and each size with an exponential's mass about it and equally probable lengths."""
    edges = np.concatenate([[0.0], np.sqrt(sizes[1:] * sizes[:-1]), [np.inf]])
    mass = np.diff(-np.exp(-edges / mean))
    share = (1 - EXACT) / len(lengths)
    deviating = [
        (float(size), length, float(np.log(share * m)))
        for size, m in zip(sizes, mass, strict=True)
        for length in lengths
    ]
    return [(0.0, 1.0, float(np.log(EXACT))), *deviating]


def _combine(
    knots: int, of_g: Sequence[Size], of_h: Sequence[Size], absorbed: tuple[bool, bool] = (False, False)
) -> Grid:
    """Combine sizes of g and of h."""
    weights = np.ones(knots)
    weights[:1] = weights[-1:] = 0.5
    # Minus the mean over the record of what is linear between knots.
    centre = np.eye(knots) - np.tile(weights / np.sum(weights), (knots, 1))
    about_g, about_h = (centre if yes else np.eye(knots) for yes in absorbed)
    pairs = list(product(of_g, of_h))
    factors = np.zeros((len(pairs), 2 * knots, 2 * knots))
    for factor, ((g, length_g, _), (h, length_h, _)) in zip(factors, pairs, strict=True):
        factor[:knots, :knots] = g * about_g @ smooth_root(knots, length_g)
        factor[knots:, knots:] = h * about_h @ smooth_root(knots, length_h)
    size_g, size_h, log_prior = np.array([(g[0], h[0], g[2] + h[2]) for g, h in pairs]).T
    return Grid(size_g, size_h, log_prior, factors)


@lru_cache(maxsize=32)
def smooth_root(knots: int, length: float) -> np.ndarray:
    """Return the factor of the covariance of a deviation of size 1 at equidistant knots, (n, n)."""
    s = np.linspace(0.0, 1.0, knots)
    return np.linalg.cholesky(np.exp(-np.abs(s[:, None] - s) / length) + JITTER * np.eye(knots))
