"""Whether a record comes back to where it was a period ago, as an oscillation does, or wanders."""

from __future__ import annotations

import numpy as np

NO_NEARER = 0.7
"""Mean square of changes over a period, as a share of those over half of one, from which nothing comes back: 2 of a
random walk, 1 of noise, 0.4 of an oscillation with a damping ratio of 0.3, 2/3 of two equal modes a fifth apart."""
HOLE = 0.25
"""Share of a time without samples that is a hole in it."""


def wandering(t: np.ndarray, y: np.ndarray, period: float, noise: float) -> str:
    """Words on what values y (n,) at times t (n,), s, do in place of oscillating with this period in s; empty where
    they do. noise: standard deviation of a sample's."""
    shared = _changes(t, y, period) - 2 * noise**2
    half = _changes(t, y, 0.5 * period) - 2 * noise**2
    if not (np.isfinite(shared) and np.isfinite(half)) or half <= 0:
        return ""
    if shared > NO_NEARER * half:
        return "after a period it is no nearer to where it was than after half of one"
    return ""


def _changes(t: np.ndarray, y: np.ndarray, lag: float) -> float:
    """Variance of what changes over a time, not into a hole; nan where the record is hardly longer."""
    after = t + lag
    place = np.clip(np.searchsorted(t, after), 1, t.size - 1)
    hole = max(HOLE * lag, 2.5 * float(np.median(np.diff(t))))
    first = (after <= t[-1]) & (t[place] - t[place - 1] < hole)
    change = np.interp(after[first], t, y) - y[first]
    return float(np.var(change)) if change.size > 2 else float("nan")
