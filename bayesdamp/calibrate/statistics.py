"""P values and bands for the ranks, the coverage and the probabilities of a calibration.

Simulation-based calibration (Talts, Betancourt, Simpson, Vehtari and Gelman, arXiv 1804.06788): parameters drawn from
the prior, and a record from these, make the rank of the truth among independent posterior draws uniform. The rank is
also uniform over any selection of records that depends on the record alone, because the posterior is conditional on it.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from scipy.stats import kstest


def thin(draws: np.ndarray, count: int) -> np.ndarray:
    """Return `count` draws, shape (count,), that are spread evenly over all chains of `draws`, shape (chain, draw).

    The chains are joined one after the other; the first and the last draw are included. Raises ValueError if there are
    fewer than `count` draws.
    """
    flat = draws.reshape(-1)
    if flat.size < count:
        raise ValueError(f"{count} thinned draws are needed, but there are only {flat.size} draws")
    return flat[np.round(np.linspace(0, flat.size - 1, count)).astype(int)]


def uniformity_test(ranks: np.ndarray, draws: int) -> tuple[float, float]:
    """Test ranks (n,), whole numbers from 0 to `draws`, against uniform ranks; return the statistic and the p value.

    The statistic is that of Kolmogorov and Smirnov: the largest difference, with its sign, of the ranks' distribution
    function from the uniform one. Its distribution is exact for any n, while that of χ² over bins needs several ranks
    in each bin. A rank counts as the middle of its 1/(draws + 1) of the interval from 0 to 1, which changes the
    statistic by at most half of that: 0.002 for 255 draws. Both values are nan if n is 0.
    """
    if not ranks.size:
        return math.nan, math.nan
    test = kstest((ranks + 0.5) / (draws + 1), "uniform")
    return float(test.statistic * test.statistic_sign), float(test.pvalue)


def holm(tests: Sequence[float]) -> np.ndarray:
    """Return the p values of k tests adjusted by Holm's method, (k,).

    They are in the order of the tests. If tests with adjusted p values below α are rejected, the probability of any
    false rejection is at most α. A test without a p value (nan) keeps nan and does not count.
    """
    p = np.asarray(tests, float)
    adjusted = np.full(p.size, np.nan)
    tested = np.flatnonzero(np.isfinite(p))
    order = tested[np.argsort(p[tested], kind="stable")]
    factors = np.arange(order.size, 0, -1)
    adjusted[order] = np.minimum(np.maximum.accumulate(factors * p[order]), 1.0)
    return adjusted


def hits_distribution(p: np.ndarray) -> np.ndarray:
    """Return the probabilities of 0 to n hits, (n + 1,), of independent events with probabilities p (n,)."""
    distribution = np.ones(1)
    for probability in np.clip(p, 0.0, 1.0):
        distribution = np.convolve(distribution, [1.0 - probability, probability])
    return distribution


def hits_p(hits: int, p: np.ndarray) -> float:
    """Return the two-sided p value of a number of hits among independent events with probabilities p (n,).

    nan if there are no events.
    """
    if not p.size:
        return float("nan")
    mass = hits_distribution(p)
    return float(min(1.0, 2 * min(mass[: hits + 1].sum(), mass[hits:].sum())))


def hits_band(p: np.ndarray, probability: float) -> tuple[int, int]:
    """Return the least and greatest number of hits of a range that has at least this probability.

    A hit is one of n independent events with probabilities p (n,). Fewer and more hits than in the range each have at
    most the probability (1 − probability)/2.
    """
    cumulative = np.cumsum(hits_distribution(p))
    tail = 0.5 * (1.0 - probability)
    return int(np.searchsorted(cumulative, tail, side="right")), int(np.searchsorted(cumulative, 1.0 - tail))
