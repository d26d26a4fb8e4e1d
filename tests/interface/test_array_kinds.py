"""Arrays that NumPy would convert to real numbers although they are not: refused, each in one line."""

from decimal import Decimal
from functools import partial

import numpy as np

import bayesdamp as bd
from tests.interface.problems import TIMES, TRUTH, closed_form, not_refused

Y = closed_form(TIMES, TRUTH)
STAMPS = np.datetime64("2024-05-01") + (TIMES * 1e9).astype("timedelta64[ns]")
REFUSED = {
    "true and false": (TIMES, Y > 0, "y contains bool"),
    "complex": (TIMES, Y + 1j, "y contains complex128"),
    "text as objects": (TIMES, Y.astype(str).astype(object), "y contains text"),
    "bytes": (TIMES.astype("S"), Y, "t contains text"),
    "dates": (STAMPS, Y, "t contains dates; give real numbers, and times in s"),
    "masked": (TIMES, np.ma.masked_greater(Y, 0.2), "y has .* masked values"),
    "a table": ({}, Y, "t must be an array of numbers"),
}
READ = {
    "numbers": Y,
    "decimal numbers": [Decimal(repr(v)) for v in Y.tolist()],
    "a mask that hides nothing": np.ma.masked_greater(Y, 9.0),
}


def test_arrays_that_are_not_real_numbers_are_refused() -> None:
    """Control: the same values in other forms are read."""
    cases = ((partial(bd.signal, t, y), f"^signal: {line}") for t, y, line in REFUSED.values())
    assert not_refused(cases) == []
    for kind, y in READ.items():
        assert np.array_equal(bd.signal(TIMES, y, cleaned=False).y, Y), kind
