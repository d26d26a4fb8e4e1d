"""Tests of uniform ranks and of numbers of hits, and Holm's correction, against enumeration and simulation."""

import itertools
import math

import numpy as np
import pytest
from scipy.stats import binom, norm

from bayesdamp.calibrate.tables import hits_band, hits_distribution, hits_p, holm, uniformity_test


def test_p_values_of_uniformity_have_their_stated_false_alarm_rate():
    """For few and many ranks, within four standard errors (a false alarm in 16,000 seeds). Control: the ranks of
    intervals that are 30 % too narrow are detected, and those on one side have the sign of their difference."""
    rng = np.random.default_rng(1)
    for n in (12, 64):
        p = [uniformity_test(rng.integers(256, size=n), 255)[1] for _ in range(4000)]
        for level in (0.01, 0.05, 0.5):
            assert abs(np.mean(np.array(p) <= level) - level) < 4 * math.sqrt(level * (1 - level) / 4000)
    narrow = np.floor(256 * norm.cdf(rng.standard_normal(500) / 0.7))
    assert uniformity_test(narrow, 255)[1] < 1e-3
    low, high = (uniformity_test(np.full(12, rank), 255) for rank in (0, 255))
    assert low[0] == pytest.approx(1 - 0.5 / 256) == -high[0]
    assert max(low[1], high[1]) < 1e-20
    assert all(map(math.isnan, uniformity_test(np.empty(0), 255)))


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
