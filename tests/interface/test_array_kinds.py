"""Arrays that are no real numbers, of which NumPy would make some: refused, each in one line."""

from __future__ import annotations

from decimal import Decimal
from functools import partial

import numpy as np

import bayesdamp as bd
from tests.interface.problems import TIMES, TRUTH, closed_form, not_refused

Y = closed_form(TIMES, TRUTH)
STAMPS = np.datetime64("2024-05-01") + (TIMES * 1e9).astype("timedelta64[ns]")
REFUSED = {
    "y > 0": (TIMES, Y > 0, "y contains true and false"),
    "times that are true or false": (TIMES > 3, Y, "t contains true and false"),
    "complex": (TIMES, Y + 1j, "y contains complex numbers"),
    "text as objects": (TIMES, Y.astype(str).astype(object), "y contains text"),
    "bytes": (TIMES.astype("S"), Y, "t contains text"),
    "dates": (STAMPS, Y, "t contains dates; give real numbers, and times in s"),
    "masked": (TIMES, np.ma.masked_greater(Y, 0.2), "y has .* masked values"),
    "a table": ({}, Y, "t must be an array of numbers"),
}
READ = {
    "numbers": Y,
    "decimal numbers": [Decimal(repr(v)) for v in Y.tolist()],
    "a mask of nothing": np.ma.masked_greater(Y, 9.0),
}


def test_no_numbers_are_refused() -> None:
    """The negative control is the same values in other forms, which are read."""
    for cleaned in (True, False):
        calls = (
            (partial(bd.signal, t, y, cleaned=cleaned), f"^signal: {line}") for t, y, line in REFUSED.values()
        )
        assert not_refused(calls) == []
    for kind, y in READ.items():
        assert np.array_equal(bd.signal(TIMES, y, cleaned=False).y, Y), kind
