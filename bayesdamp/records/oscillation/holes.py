"""Stretches of a record without a sample, and what stands beside them."""

from __future__ import annotations

import numpy as np

from bayesdamp.records.oscillation.turning import Turning

LEAST, USUAL, BESIDE = 0.5, 5.0, 0.25
"""Periods without a sample, and how many usual gaps, from which these are a hole; periods beside it in which a turning
point is not believed (conventional)."""


def holes(t: np.ndarray, period: float) -> np.ndarray:
    """Start and end, (h, 2), in s, of stretches of times t (n,) without a sample where others have many.

    period: of the oscillation, in s.
    """
    gaps = np.diff(t)
    at = np.flatnonzero((gaps > LEAST * period) & (gaps > USUAL * np.median(gaps)))
    return np.stack([t[at], t[at + 1]], axis=1)


def without_edges(turns: Turning, t: np.ndarray, period: float) -> Turning:
    """Turning points without those in and beside holes, which a line across the hole makes."""
    kept = np.ones(turns.times.size, bool)
    for a, b in holes(t, period):
        kept &= (turns.times < a - BESIDE * period) | (turns.times > b + BESIDE * period)
    return Turning(turns.times[kept], turns.values[kept], turns.gain[kept])
