"""A quantity that was found on several records of one specimen: its mean, and how much records differ."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.special import ndtr

GRID = 400
"""Values of the spread between records over which is summed."""
WIDE = 2.0
"""Scale of the spread's half-Cauchy prior, in sds of the values' scatter (weakly informative; Gelman 2006)."""


@dataclass(frozen=True)
class Pooled:
    """Mean over records and its sd; spread between records (an sd) with its 95 % interval; 95 % interval of what one
    more record would give."""

    mean: float
    sd: float
    spread: float
    spread_low: float
    spread_high: float
    low: float
    high: float


def pooled(values: np.ndarray, sds: np.ndarray) -> Pooled:
    """Random effects: values (n,) with sds (n,) of records that differ by a normal with an unknown spread.

    The spread is summed over a grid under a half-Cauchy prior, the mean under a flat one. Of one value the spread is 0.
    """
    values, sds = np.asarray(values, float), np.maximum(np.asarray(sds, float), 1e-12 * np.abs(values).max())
    if values.size == 1:
        v, s = float(values[0]), float(sds[0])
        return Pooled(v, s, 0.0, 0.0, 0.0, v - 1.96 * s, v + 1.96 * s)
    scale = WIDE * max(float(np.std(values)), float(np.median(sds)))
    spreads = np.concatenate([[0.0], np.geomspace(1e-3, 20.0, GRID - 1) * scale])
    precision = 1.0 / (sds**2 + spreads[:, None] ** 2)
    total = precision.sum(axis=1)
    means = precision @ values / total
    log = 0.5 * np.log(precision).sum(axis=1) - 0.5 * np.log(total)
    log -= 0.5 * np.sum(precision * (values - means[:, None]) ** 2, axis=1)
    log -= np.log1p((spreads / scale) ** 2)
    weight = np.exp(log - log.max()) * np.gradient(spreads)
    weight /= weight.sum()
    mean = float(weight @ means)
    sd = float(np.sqrt(weight @ (1 / total + (means - mean) ** 2)))
    cumulative = np.cumsum(weight)
    spread, below, above = (float(np.interp(q, cumulative, spreads)) for q in (0.5, 0.025, 0.975))
    width = np.sqrt(1 / total + spreads**2 + np.median(sds) ** 2)
    low, high = (_quantile(q, means, width, weight) for q in (0.025, 0.975))
    return Pooled(mean, sd, spread, below, above, low, high)


def _quantile(q: float, means: np.ndarray, sds: np.ndarray, weight: np.ndarray) -> float:
    """Of a mixture of normals, by bisection."""
    low, high = float(np.min(means - 9 * sds)), float(np.max(means + 9 * sds))
    for _ in range(80):
        middle = 0.5 * (low + high)
        below = float(weight @ ndtr((middle - means) / sds))
        low, high = (middle, high) if below < q else (low, middle)
    return 0.5 * (low + high)
