"""Arrays of real numbers out of what a user gives; NumPy makes numbers of much that is none."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from bayesdamp.types import InputError

_TEXT = "is text; give numbers, such as numpy.asarray(values, float) makes of it"
_DATES = "holds dates or spans of time; give seconds: (t - t[0]) / numpy.timedelta64(1, 's')"
_NO_NUMBERS = {
    "b": "holds true and false, which measure nothing; give the recorded numbers",
    "c": "holds complex numbers; give their real part, or another real quantity",
    "M": _DATES,
    "m": _DATES,
    "S": _TEXT,
    "U": _TEXT,
}
"""What is said of an array by its kind of elements, where NumPy would make numbers of them."""


def numbers_of(given: ArrayLike, what: str, where: str) -> NDArray[np.float64]:
    """An array of its own with the numbers that are given. what: its name; where: that of the signal.

    Raises InputError for elements that are no real numbers, and for masked ones.
    """
    try:
        found = np.asanyarray(given)
        kinds = {np.asarray(one).dtype.kind for one in found.flat} if found.dtype.kind == "O" else ()
        refused = next(
            (_NO_NUMBERS[kind] for kind in (found.dtype.kind, *kinds) if kind in _NO_NUMBERS), None
        )
        numbers = np.array(found, float) if refused is None else np.empty(0)
    except (TypeError, ValueError):
        refused, found, numbers = "must be an array of numbers", np.empty(0), np.empty(0)
    if refused is not None:
        raise InputError(f"{what} {refused}", where)
    masked = np.ma.getmaskarray(found) if isinstance(found, np.ma.MaskedArray) else np.zeros(0, bool)
    if masked.any():
        raise InputError(
            f"{what} has {np.count_nonzero(masked)} masked values; leave these samples out of t and y", where
        )
    return numbers
