"""Tests of uniform ranks and of numbers of hits, and Holm's correction, against enumeration and simulation."""

from __future__ import annotations

import itertools
import math

import numpy as np
import pytest
from scipy.stats import binom

from bayesdamp.calibrate.statistics import (
    hits_band,
    hits_distribution,
    hits_p,
    holm,
    uniformity_band,
    uniformity_p,
)


def least_tail(counts: np.ndarray) -> float:
    """Return the smallest two-sided binomial tail of the cumulative counts."""
    cumulative, n = np.cumsum(counts)[:-1], counts.sum()
    at = np.arange(1, counts.size) / counts.size
    return float(np.min(2 * np.minimum(binom.cdf(cumulative, n, at), binom.sf(cumulative - 1, n, at))))


def test_p_values_of_uniformity_are_those_of_all_outcomes():
    """Five ranks in four bins: a p value is the probability of all outcomes with tails that are not larger."""
    outcomes: dict[tuple[int, ...], float] = {}
    for places in itertools.product(range(4), repeat=5):
        counts = tuple(np.bincount(places, minlength=4).tolist())
        outcomes[counts] = outcomes.get(counts, 0.0) + 4.0**-5
    tails = {counts: least_tail(np.array(counts)) for counts in outcomes}
    for counts, tail in tails.items():
        expected = sum(p for c, p in outcomes.items() if tails[c] <= tail * (1 + 1e-12))
        assert uniformity_p(np.array(counts)) == pytest.approx(expected, abs=1e-12)


def test_the_band_contains_its_share_of_uniform_ranks():
    """Of 20,000 sets of 200 ranks, within four standard errors (a false alarm in 16,000 seeds). The distribution is
    discrete and has not exactly 95 %. A set is outside the band if its p value is at most 0.05."""
    low, high = uniformity_band(200, 16, 0.95)
    counts = np.random.default_rng(1).multinomial(200, np.full(16, 1 / 16), size=20_000)
    cumulative = np.cumsum(counts, axis=1)[:, :-1]
    inside = np.mean(np.all((cumulative >= low) & (cumulative <= high), axis=1))
    assert inside > 0.95 - 4 * math.sqrt(0.95 * 0.05 / 20_000)
    assert inside < 0.965
    p = [uniformity_p(c) for c in counts[:300]]
    assert [x <= 0.05 for x in p] == [not (np.all(c >= low) and np.all(c <= high)) for c in cumulative[:300]]


def test_p_values_by_holm_are_those_worked_out_by_hand():
    assert holm([0.01, 0.04, 0.03]).tolist() == pytest.approx([0.03, 0.06, 0.06])
    with_gap = holm([0.02, math.nan, 0.9])
    assert with_gap[0] == pytest.approx(0.04)
    assert math.isnan(with_gap[1])
    assert with_gap[2] == pytest.approx(0.9)


def test_numbers_of_hits_are_those_of_independent_events():
    p = np.array([0.1, 0.5, 0.7, 0.95])
    expected = np.zeros(5)
    for outcome in itertools.product((0, 1), repeat=4):
        expected[sum(outcome)] += np.prod(np.where(outcome, p, 1 - p))
    np.testing.assert_allclose(hits_distribution(p), expected, atol=1e-15)
    same = np.full(300, 0.3)
    assert hits_p(70, same) == pytest.approx(2 * binom.cdf(70, 300, 0.3))
    low, high = hits_band(same, 0.99)
    assert binom.cdf(low - 1, 300, 0.3) <= 0.005 < binom.cdf(low, 300, 0.3)
    assert binom.sf(high, 300, 0.3) <= 0.005 < binom.sf(high - 1, 300, 0.3)
