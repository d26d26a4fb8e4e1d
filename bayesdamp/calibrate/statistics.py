"""Exact p values and bands for the ranks, the coverage and the probabilities of a calibration.

Simulation-based calibration (Talts, Betancourt, Simpson, Vehtari and Gelman, arXiv 1804.06788): parameters drawn from
the prior, and a record from these, make the rank of the truth among independent posterior draws uniform. The rank is
also uniform over any selection of records that depends on the record alone, because the posterior is conditional on it.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache

import numpy as np
from scipy.stats import binom


def thin(draws: np.ndarray, count: int) -> np.ndarray:
    """Return `count` draws, shape (count,), that are spread evenly over all chains of `draws`, shape (chain, draw).

    The chains are joined one after the other; the first and the last draw are included. Raises ValueError if there are
    fewer than `count` draws.
    """
    flat = draws.reshape(-1)
    if flat.size < count:
        raise ValueError(f"{count} thinned draws are needed, but there are only {flat.size} draws")
    return flat[np.round(np.linspace(0, flat.size - 1, count)).astype(int)]


def histogram(ranks: np.ndarray, draws: int, bins: int) -> np.ndarray:
    """Count ranks (n,) in bins of equal size; return the counts, (bins,).

    The ranks are whole numbers from 0 to `draws`, the number of draws. bins must divide draws + 1.
    """
    return np.bincount(np.asarray(ranks, int) * bins // (draws + 1), minlength=bins)


def uniformity_p(counts: np.ndarray) -> float:
    """Return the p value of the counts (k,) of n ranks in k bins of equal size, against uniform ranks; nan if n is 0.

    The statistic is that of Säilynoja, Bürkner and Vehtari (Statistics and Computing 32, 2022): the smallest two-sided
    binomial tail of the distribution function over the ends of the bins. Its distribution is not simulated: the p value
    is exact. A small one contradicts uniform ranks.
    """
    cumulative, n = np.cumsum(counts)[:-1], int(np.sum(counts))
    if n == 0:
        return float("nan")
    ends = np.arange(1, counts.size) / counts.size
    return _p_of_tail(float(_tails(cumulative, n, ends).min()), n, counts.size)


@lru_cache(maxsize=256)
def uniformity_band(n: int, bins: int, probability: float) -> tuple[np.ndarray, np.ndarray]:
    """Return a band for the cumulative counts of n uniform ranks in bins: least and greatest, (bins − 1,) each.

    The k-th is the number of ranks in the first k bins. The probability that all cumulative counts are in the band is
    at least `probability`.
    """
    low, high = 0.0, 1.0 - probability
    for _ in range(20):  # bisection: the band changes in steps with the tail, and the wider one is used
        middle = 0.5 * (low + high)
        low, high = (middle, high) if _p_of_tail(middle, n, bins) <= 1.0 - probability else (low, middle)
    return _range_inside(low, n, bins)


def _tails(counts: np.ndarray, n: int, p: np.ndarray) -> np.ndarray:
    """Return the two-sided tail probability of each count of n events with probability p; `counts` and `p` broadcast.

    A tail is twice the smaller of P(X ≤ count) and P(X ≥ count); it can be above 1.
    """
    return 2 * np.minimum(binom.cdf(counts, n, p), binom.sf(np.asarray(counts) - 1, n, p))


def _range_inside(tail: float, n: int, bins: int) -> tuple[np.ndarray, np.ndarray]:
    """Return least and greatest cumulative counts, (bins − 1,) each, with two-sided tails above `tail`.

    The k-th is the number of n uniform ranks in the first k bins. If no count has such a tail, least > greatest.
    """
    good = _tails(np.arange(n + 1)[:, None], n, np.arange(1, bins) / bins) > tail
    least, greatest = np.argmax(good, axis=0), n - np.argmax(good[::-1], axis=0)
    return np.where(good.any(axis=0), least, n + 1), greatest


@lru_cache(maxsize=4096)
def _p_of_tail(tail: float, n: int, bins: int) -> float:
    """Return the probability that n uniform ranks have a two-sided tail of at most `tail` at the end of some bin."""
    # A tail that equals the limit apart from rounding is not beyond it.
    low, high = _range_inside(tail * (1 + 1e-9), n, bins)
    if np.any(low > high):
        return 1.0
    counts, mass = np.array([0]), np.ones(1)
    for k in range(bins - 1):
        # A rank that is in none of the first k bins is in the next one with probability 1/(bins − k).
        new = np.arange(low[k], high[k] + 1)
        counts, mass = new, binom.pmf(new[:, None] - counts, n - counts, 1.0 / (bins - k)) @ mass
    return float(np.clip(1.0 - mass.sum(), 0.0, 1.0))


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
