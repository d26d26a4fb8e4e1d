"""The records of the contest have the properties of their groups."""

from dataclasses import replace

import numpy as np
import pytest

from tests.validation.answering import verdict_of
from validation.contest.__main__ import row
from validation.contest.peers import ROSTER
from validation.contest.records import GROUPS, LOST, simulate_record


def test_records_have_the_properties_of_their_group():
    for number in range(5):
        record = simulate_record(4, number)
        t, y = record.signal.t, record.signal.y
        gaps = np.diff(t)
        assert record.group == GROUPS[number]
        assert list(record.amplitudes) == sorted(record.amplitudes, reverse=True)
        assert min(map(record.ratio, record.amplitudes)) > 0
        lost = gaps[gaps > 1.5 * np.median(gaps)].sum() / t[-1]
        assert lost == (pytest.approx(LOST, abs=0.02) if record.group == "gappy" else 0.0)
        crossings = np.count_nonzero(np.diff(np.sign(y - np.median(y))))
        if record.group == "short":
            assert 5 <= crossings <= 14


def test_a_record_is_determined_by_its_seed():
    first, again, other = (simulate_record(seed, 2).signal.y for seed in (4, 4, 5))
    np.testing.assert_array_equal(first, again)
    assert first.size != other.size or not np.array_equal(first, other)


def test_all_peers_are_judged_at_the_requested_amplitudes(monkeypatch: pytest.MonkeyPatch) -> None:
    """Also a peer that answers at an amplitude outside the record, where there is no truth."""
    record = simulate_record(4, 0)
    verdict = replace(verdict_of([0.01] * 3), damping="viscous", probability=0.9)
    monkeypatch.setitem(ROSTER, "bayesdamp", lambda *_: verdict)
    answered = row(record, "bayesdamp")
    assert [answered[f"amplitude_{i}"] for i in (1, 2, 3)] == list(record.amplitudes)
    assert answered["true_1"] == record.ratio(record.amplitudes[0])
