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
JITTER = 1e-6
LEAST_KNOTS, MOST_KNOTS = 4, 16
Size = tuple[float, float, float]
"""Size and correlation length of a deviation, and the log prior mass of both."""


@dataclass(frozen=True)
class Grid:
    """Combinations of hyperparameters: log prior masses (c,), factors of the covariances of (g, h), (c, 2n, 2n)."""

    size_g: np.ndarray
    size_h: np.ndarray
    log_prior: np.ndarray
    factors: np.ndarray


def knots_of(duration: float, cycles: float) -> np.ndarray:
    """Equidistant knots from 0 to the duration, a knot for two cycles, 4 to 16 of them."""
    return np.linspace(0.0, duration, int(np.clip(round(cycles / 2) + 1, LEAST_KNOTS, MOST_KNOTS)))


@lru_cache(maxsize=32)
def grid_of(
    knots: int,
    exact: bool = False,
    coarse: bool = False,
    absorbed: tuple[bool, bool] = (False, False),
    phases: bool = True,
) -> Grid:
    """The grid for so many knots.

    phases: whether the record has any; without them, factors are those of g alone. exact: only that both laws hold
    exactly; coarse: every other size, and the shortest and the longest length.
    absorbed: whether a constant deviation of damping, and of frequency, is a parameter's already (a coefficient, the
    stiffness): then it is taken about its mean over the record. One that is in both is seen by no record, and would
    only stretch the posterior along a curve that its linear model leaves.
    """
    sizes_g, sizes_h = ((), ()) if exact else (SIZES_G[:: 2 if coarse else 1], SIZES_H[:: 2 if coarse else 1])
    lengths = LENGTHS[::2] if coarse else LENGTHS
    one = [(0.0, 1.0, 0.0 if exact else np.log(EXACT)), *masses(sizes_g, MEAN_G, lengths)]
    other = [(0.0, 1.0, 0.0 if exact else np.log(EXACT)), *masses(sizes_h, MEAN_H, lengths)]
    other = other if phases else [(0.0, 1.0, 0.0)]
    grid = _combined(knots, one, other, absorbed)
    return grid if phases else replace(grid, factors=grid.factors[:, :knots, :knots])


def _combined(
    knots: int, of_g: Sequence[Size], of_h: Sequence[Size], absorbed: tuple[bool, bool] = (False, False)
) -> Grid:
    """Combine sizes of g and of h."""
    weights = np.ones(knots)
    weights[:1] = weights[-1:] = 0.5
    # Less the mean over the record of what is linear between knots.
    centre = np.eye(knots) - np.tile(weights / np.sum(weights), (knots, 1))
    about_g, about_h = (centre if yes else np.eye(knots) for yes in absorbed)
    pairs = list(product(of_g, of_h))
    factors = np.zeros((len(pairs), 2 * knots, 2 * knots))
    for at, ((g, length_g, _), (h, length_h, _)) in zip(factors, pairs, strict=True):
        at[:knots, :knots] = g * about_g @ smooth_root(knots, length_g)
        at[knots:, knots:] = h * about_h @ smooth_root(knots, length_h)
    size_g, size_h, log_prior = np.array([(g[0], h[0], g[2] + h[2]) for g, h in pairs]).T
    return Grid(size_g, size_h, log_prior, factors)


@lru_cache(maxsize=32)
def smooth_root(knots: int, length: float) -> np.ndarray:
    """The factor of the covariance of a deviation of size 1 at equidistant knots, (n, n)."""
    s = np.linspace(0.0, 1.0, knots)
    return np.linalg.cholesky(np.exp(-np.abs(s[:, None] - s) / length) + JITTER * np.eye(knots))


WIDE = (0.1, 0.3, 1.0, 3.0)
"""Sizes of a log deviation that may be anything: up to a factor of 20 either way."""
WIDE_LENGTHS = (0.1, 0.3, 1.0)


@lru_cache(maxsize=8)
def wide_grid(knots: int) -> Grid:
    """The grid of a damping that follows no law: g of any size, all alike; h as it is elsewhere, coarsely."""
    mass = -float(np.log(len(WIDE) * len(WIDE_LENGTHS)))
    one = [(size, length, mass) for size in WIDE for length in WIDE_LENGTHS]
    return _combined(knots, one, [(0.0, 1.0, np.log(EXACT)), *masses(SIZES_H[::2], MEAN_H, LENGTHS[::2])])


def masses(sizes: np.ndarray | tuple[()], mean: float, lengths: tuple[float, ...]) -> list[Size]:
    """(size, length, log prior mass): an exponential's mass about each size, the lengths alike."""
    if len(sizes) == 0:
        return []
    edges = np.concatenate([[0.0], np.sqrt(np.asarray(sizes)[1:] * np.asarray(sizes)[:-1]), [np.inf]])
    mass = np.diff(-np.exp(-edges / mean))
    share = (1 - EXACT) / len(lengths)
    return [
        (float(size), length, float(np.log(share * m)))
        for size, m in zip(sizes, mass, strict=True)
        for length in lengths
    ]
