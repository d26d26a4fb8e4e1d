"""Which methods' errors differ by more than the luck of the repeats: intervals, pairs, places."""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np
from scipy import stats

from bayesdamp.report.results.sweeping import Series

LEAST = 3
"""Repeats below which nothing is said of luck."""
SURE = 0.95


def interval(errors: Mapping[int, float]) -> tuple[float, float]:
    """95 % interval of the root mean square of errors by repeat; nan below three repeats.

    Jackknife of the log of the mean square with Student's t (Tukey 1958); exact for no law of errors, close for all
    that have a fourth moment.
    """
    squares = np.array([e * e for e in errors.values()])
    if squares.size < LEAST or not squares.any():
        return (math.nan, math.nan)
    centre, half = _jackknifed(np.log(_without_one(squares)), float(np.log(squares.mean())))
    return (float(np.exp((centre - half) / 2)), float(np.exp((centre + half) / 2)))


def ahead(one: Mapping[int, float], other: Mapping[int, float]) -> bool:
    """Whether errors are smaller than another method's on the repeats that both answered, beyond luck.

    The same jackknife, of the log ratio of the two mean squares: both saw the same records, so that what is common to
    their errors cancels. A chance of 2.5 % of being said where there is no difference.
    """
    common = sorted(set(one) & set(other))
    if len(common) < LEAST:
        return False
    a, b = (np.array([errors[i] ** 2 for i in common]) for errors in (one, other))
    if not b.any():
        return False
    if not a.any():
        return True
    left = np.log(_without_one(a)) - np.log(_without_one(b))
    centre, half = _jackknifed(left, float(np.log(a.mean() / b.mean())))
    return centre + half < 0


def places(found: Series, stage: str, level: int) -> dict[str, tuple[int, int]]:
    """The best and the worst place that each method may have by its errors at the level-th value of the factor.

    A method's best place is one behind those that are ahead of it beyond luck, its worst before those that it is
    ahead of.
    """
    errors = {m: each[level] for (m, s), each in found.each.items() if s == stage and each[level]}
    return {
        m: (
            1 + sum(ahead(other, own) for n, other in errors.items() if n != m),
            len(errors) - sum(ahead(own, other) for n, other in errors.items() if n != m),
        )
        for m, own in errors.items()
    }


def _without_one(squares: np.ndarray) -> np.ndarray:
    """Mean squares (n,) with each repeat left out in turn, never quite 0."""
    left = (squares.sum() - squares) / (squares.size - 1)
    return np.maximum(left, 1e-12 * squares.mean())


def _jackknifed(left: np.ndarray, whole: float) -> tuple[float, float]:
    """A statistic and the half width of its interval, from its values with each of n repeats left out."""
    n = left.size
    sd = math.sqrt((n - 1) * float(np.mean((left - left.mean()) ** 2)))
    return whole, float(stats.t.ppf((1 + SURE) / 2, n - 1)) * sd
