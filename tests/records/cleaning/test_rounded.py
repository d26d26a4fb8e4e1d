"""Stamps written to few digits, against the step that they were written of."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest

from bayesdamp.records.cleaning.clean import clean
from bayesdamp.records.cleaning.clock import clock_times
from bayesdamp.records.cleaning.rounded import even
from bayesdamp.records.record import RawRecord

THIRTIETH = 1 / 30


def digits(t: np.ndarray, many: int) -> np.ndarray:
    return np.array([float(f"{x:.{many}g}") for x in t])


STAMPS = {
    "whole seconds, cut off": (np.floor(0.02 * np.arange(400) + 0.313), 0.02),
    "whole seconds, rounded": (np.round(np.arange(946) / 47.3 + 0.31), 1 / 47.3),
    "whole minutes": (60 * np.floor(np.arange(2600) / 4.3 / 60 + 0.31), 1 / 4.3),
    "two decimals": (np.round(THIRTIETH * np.arange(300), 2), THIRTIETH),
    "six digits": (digits(THIRTIETH * np.arange(20_000), 6), THIRTIETH),
    "long after midnight": (51_234.0 + np.round(THIRTIETH * np.arange(3_000), 3), THIRTIETH),
}


@pytest.mark.parametrize("name", STAMPS)
def test_the_sampling_is_found(name: str):
    """Within a step from end to end; a line by least squares is off by 1.6 % where eight stamps of seconds are."""
    t, step = STAMPS[name]
    found = even(np.arange(t.size), t)
    assert found is not None
    assert abs(found.step - step) * t.size < step
    assert found.off <= found.digit / 2 * (1 + 1e-5)


def test_rows_that_are_missing():
    rows = np.r_[0:1500, 1600:3000]
    found = even(rows, np.round(rows / 30.3, 2))
    assert found is not None
    assert found.step == pytest.approx(1 / 30.3, rel=1e-6)


def test_no_even_sampling():
    """The control: what rounding cannot have done."""
    i, rng = np.arange(3_000), np.random.default_rng(5)
    exact = THIRTIETH * i
    others = {
        "shaken": np.round(exact + 1e-3 * rng.standard_normal(i.size), 3),
        "drifting": np.round(exact * (1 + 1e-3 * i / i.size), 3),
        "with a pause": np.round(exact + 0.5 * (i > 1500), 2),
        "as many digits as a double has": exact,
        "a row that is missing": 0.01 * np.delete(i, 1_000),
        "a row that stands twice": 0.01 * np.insert(i, 1_000, 1_000),
    }
    assert [name for name, t in others.items() if even(np.arange(t.size), t) is not None] == []


def test_clocks():
    """Rebuilt where rounding shows; stamps that are exact, that are asked for as logged or are shaken stay."""
    i = np.arange(3_000)
    rounded, exact = np.round(THIRTIETH * i, 2), np.round(0.03 * i, 2)
    y = np.exp(-0.02 * THIRTIETH * i) * np.cos(3 * THIRTIETH * i)
    found = clock_times(RawRecord(rounded, y), "auto", "x")
    assert found.used == "uniform"
    assert np.abs(found.t - THIRTIETH * i).max() < 1e-3
    assert "written to 0.01 s" in found.notes[0]
    for t, clock in ((exact, "auto"), (rounded, "as_logged")):
        kept = clock_times(RawRecord(t, y), clock, "x")
        assert (kept.used, kept.notes) == ("as_logged", ())
        assert np.array_equal(kept.t, t)


def test_few_that_repeat():
    """Stamps of six digits that begin to repeat late in a record were refused."""
    t = digits(0.06 * np.arange(18_000), 5)
    share = np.mean([a == b for a, b in pairwise(t)])
    assert 0 < share < 0.05
    assert clock_times(RawRecord(t, t), "auto", "x").used == "uniform"


def test_no_scatter_is_left():
    """What is left of a record without noise: times to 0.01 s, as they are logged, are 2 % of its swing."""
    i = np.arange(2_000)
    y = np.exp(-0.02 * THIRTIETH * i) * np.cos(2 * np.pi * 1.1 * THIRTIETH * i)
    raw = RawRecord(np.round(THIRTIETH * i, 2), y)
    rough = [clean(raw, name="x", clock=c).provenance.more["roughness"] for c in ("auto", "as_logged")]
    assert rough[0] < 0.05 * rough[1]
