"""The window of a record that is no free decay of one oscillator: what stays of it is all that shows what it is."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from bayesdamp.records.decay.window import Window
from bayesdamp.records.oscillation.modes import damped_modes, few_samples
from bayesdamp.records.oscillation.one import excited, other_than_one, passing
from bayesdamp.records.oscillation.rough import roughness
from bayesdamp.records.oscillation.spectrum import coarse_period

LEAST = 0.05
"""Size of a second oscillation, relative to the first, from which a record is kept whole."""
ANYWHERE = ("steady", "excited")
"""What has no beginning in the record."""
LATE = 0.5
"""Share of the record from which its largest value comes too late for what follows to be all of it."""

SMOOTH = 1e-5
"""Noise from sample to sample, as a share of the range, below which a record was filtered."""


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


def without_ringing(
    t: np.ndarray, y: np.ndarray, window: Window, seek_start: bool, seek_stop: bool
) -> Window:
    """Return the window without the ringing of a filter at its ends, where the record was filtered.

    A filter rings about a hit and about the ends of the record. The ringing dies out within a few cycles and is not
    part of the decay.
    """
    first, last = window.first, window.last
    kept = slice(first, last + 1)
    period, _ = coarse_period(t[kept], y[kept])
    if last - first < 20 or roughness(t[kept], y[kept], period) > SMOOTH * float(np.ptp(y[kept])):
        return window
    if seek_start and (long := _ringing(t[kept] - t[first], y[kept], period)):
        first = int(np.searchsorted(t, t[first] + long))
    kept = slice(first, last + 1)
    if seek_stop and (long := _ringing(t[last] - t[kept][::-1], y[kept][::-1], period)):
        last = int(np.searchsorted(t, t[last] - long)) - 1
    if (first, last) == (window.first, window.last):
        return window
    note = f"The record was filtered; the filter's ringing is left out, and {t[first]:.6g} to {t[last]:.6g} s are used."
    return replace(window, first=first, last=last, notes=(*window.notes, note))


def _ringing(t: np.ndarray, y: np.ndarray, period: float) -> float:
    """Return for how long, in s, values y (n,) at times t (n,), from 0 on, begin with a second oscillation."""
    if t.size < 20:
        return 0.0
    two = damped_modes(*few_samples(t, y, period), 2)
    return 0.0 if two is None else passing(two, float(t[-1]) / 2)
