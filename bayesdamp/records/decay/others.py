"""The window of a record that is no free decay of one oscillator: what stays of it is all that shows what it is."""

from __future__ import annotations

import numpy as np

from bayesdamp.records.decay.window import Window
from bayesdamp.records.oscillation.modes import few_samples
from bayesdamp.records.oscillation.one import excited, other_than_one
from bayesdamp.records.oscillation.spectrum import coarse_period

LEAST = 0.05
"""Size of a second oscillation, relative to the first, from which a record is kept whole."""
ANYWHERE = ("steady", "excited")
"""What has no beginning in the record."""
LATE = 0.5
"""Share of the record from which its largest value comes too late for what follows to be all of it."""


def no_free_decay(t: np.ndarray, y: np.ndarray, seek_start: bool, seek_stop: bool) -> Window | None:
    """The whole of a record t (s), y, shape (n,), from its largest value on, where that shows two oscillations, or one
    that grows, stays, or is excited all along; None elsewhere, and where the user gave an end."""
    if not (seek_start and seek_stop):
        return None
    period, _ = coarse_period(t, y, float(t[-1] - t[0]))
    largest = int(np.argmax(np.abs(y - np.median(y))))
    first = largest if largest < LATE * t.size else 0
    if t.size - first < 20:
        return None
    found = other_than_one(t[first:], y[first:], period)
    if found is None or found.seen in ANYWHERE:
        # Its largest value is anywhere.
        whole = excited(*few_samples(t, y, period), period) if found is None else other_than_one(t, y, period)
        first, found = (0, whole) if whole is not None and whole.seen in ANYWHERE else (first, found)
    if found is None or found.size < LEAST:
        return None
    return Window(first, t.size - 1, ("It is no free decay of one oscillator, and is kept whole.",))
