"""The sampling of stamps written with few digits, against the step from which they were written."""

import numpy as np
import pytest

from bayesdamp.records.cleaning.clock import clock_times
from bayesdamp.records.record import RawRecord
from bayesdamp.types import InputError

THIRTIETH = 1 / 30
SIX_DIGITS = np.array([float(f"{x:.6g}") for x in THIRTIETH * np.arange(20_000)])

STAMPS = {
    "two decimals": (np.round(THIRTIETH * np.arange(300), 2), THIRTIETH),
    "cut off": (np.floor(1e3 * (np.arange(500) / 47.3 + 0.0017)) / 1e3, 1 / 47.3),
    "six digits": (SIX_DIGITS, THIRTIETH),
    "hundredths of a minute": (60 * np.round(np.arange(2600) / 1.3 / 60 + 0.31, 2), 1 / 1.3),
    "long after midnight": (51_234.0 + np.round(THIRTIETH * np.arange(3_000), 3), THIRTIETH),
}


def test_even_sampling_is_recovered_from_rounded_stamps():
    """Within a fiftieth of a step from end to end."""
    for name, (t, step) in STAMPS.items():
        times, notes = clock_times(RawRecord(t, np.sin(0.1 * np.arange(t.size))), "auto", "x")
        assert "times are rebuilt" in notes[0], name
        assert "written to" in notes[0], name
        assert abs(times[-1] - times[0] - (t.size - 1) * step) < 0.02 * step, name


def test_stamps_that_rounding_does_not_explain_are_not_changed():
    """Negative control."""
    i, rng = np.arange(3_000), np.random.default_rng(5)
    exact = THIRTIETH * i
    others = {
        "shaken": np.round(exact + 1e-3 * rng.standard_normal(i.size), 3),
        "drifting": np.round(exact * (1 + 1e-3 * i / i.size), 3),
        "with a pause": np.round(exact + 0.5 * (i > 1500), 2),
        "as many digits as a double has": exact,
    }
    for t, clock in (*((t, "auto") for t in others.values()), (np.round(exact, 2), "as_logged")):
        times, notes = clock_times(RawRecord(t, t), clock, "x")
        assert (times.tolist(), notes) == (t.tolist(), ())


def test_stamps_coarser_than_a_step_are_refused():
    """With eight different stamps, the step by least squares would be wrong by 1.6 %."""
    coarse = r"9\d.* % of the times repeat: they are written to 1 s, .* give the rate.*\(--clock, --rate\)"
    for t in (np.floor(0.02 * np.arange(400) + 0.313), np.round(np.arange(946) / 47.3 + 0.31)):
        with pytest.raises(InputError, match=coarse):
            clock_times(RawRecord(t, t), "auto", "x")
        assert "times are rebuilt" in str(clock_times(RawRecord(t, t), "uniform", "x")[1])
