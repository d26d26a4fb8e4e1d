"""What so many records can decide: the size of an effect that a test would find."""

from __future__ import annotations

import numpy as np
from scipy.stats import binom, binomtest, norm

POWER = 0.8
"""The probability with which an effect is to be found (conventional)."""


def rejected(n: int, level: float, alarm: float) -> np.ndarray:
    """Which counts (n + 1,) of n intervals that hold the truth a two-sided exact binomial test rejects."""
    return np.array([binomtest(k, n, level).pvalue < alarm for k in range(n + 1)])


def found(n: int, level: float, alarm: float, width: float) -> float:
    """Probability that n normal intervals, `width` times as wide as they should be, are rejected at `alarm`."""
    return _rejection(n, level, rejected(n, level, alarm), width)


def narrowest_passed(n: int, level: float, alarm: float) -> float:
    """The largest relative width below 1 of intervals that would be found with probability `POWER`; 0 where none is."""
    reject = rejected(n, level, alarm)
    for percent in range(99, 0, -1):
        if _rejection(n, level, reject, percent / 100) >= POWER:
            return percent / 100
    return 0.0


def _rejection(n: int, level: float, reject: np.ndarray, width: float) -> float:
    inside = 2 * norm.cdf(width * norm.ppf(0.5 + 0.5 * level)) - 1
    return float(binom.pmf(np.arange(n + 1), n, inside)[reject].sum())
