"""What the contest's records are."""

from __future__ import annotations

import numpy as np
import pytest

from bayesdamp.types import Signal
from validation.contest.measured import half_cycles
from validation.contest.records import GROUPS, LOST, closed_form, simulate_record


def test_a_group_is_what_it_says():
    for number in range(5):
        record = simulate_record(4, number)
        gaps = np.diff(record.t)
        assert record.group == GROUPS[number]
        assert list(record.amplitudes) == sorted(record.amplitudes, reverse=True)
        assert min(record.ratios) > 0
        lost = gaps[gaps > 1.5 * np.median(gaps)].sum() / record.t[-1]
        assert lost == (pytest.approx(LOST, abs=0.02) if record.group == "gappy" else 0.0)
        crossings = np.count_nonzero(np.diff(np.sign(record.y - np.median(record.y))))
        if record.group == "short":
            assert 5 <= crossings <= 14


def test_a_record_is_the_same_again_and_another_with_another_seed():
    first, again, other = simulate_record(4, 2), simulate_record(4, 2), simulate_record(5, 2)
    np.testing.assert_array_equal(first.y, again.y)
    assert first.y.size != other.y.size or not np.array_equal(first.y, other.y)


def test_half_cycles_of_a_closed_form():
    record = closed_form(0.03, cycles=8.0)
    found = half_cycles(Signal(record.t, record.y))
    np.testing.assert_allclose(found[:, 1], 0.03, rtol=0.03)
    np.testing.assert_allclose(found[0, 0], 0.5 * np.exp(-0.03 * 2 * np.pi * 1.0), rtol=0.1)
