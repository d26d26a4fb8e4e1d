"""A record whose sign was lost: it touches zero at each half-cycle and never crosses it."""

from __future__ import annotations

from itertools import pairwise

import numpy as np

FEWEST = 6
"""Half-cycles from which on it is told."""
LARGE = 0.3
"""Share of the largest peak down to which half-cycles are looked at: below are noise and offsets."""
TOUCHES = 0.15
"""Of a peak, how near to zero the record comes beside it: eleven samples a half-cycle or more do."""
FALLS = 0.8
"""Of the first peak the last one at most: what does not decay are pulses, or a counter."""
BETWEEN = 0.3
"""Of a peak the median of the values beside it at least: of |sin| it is 0.71, of sin² 0.5, of pulses near 0."""


def rectified(y: np.ndarray, half_cycle: float) -> bool:
    """Whether values y (n,) of one sign, in which a peak follows another after `half_cycle` samples, are those of a
    decaying oscillation without its sign, |y| or y²."""
    y = y[np.isfinite(y)]
    if not np.isfinite(half_cycle) or y.size < FEWEST * half_cycle or half_cycle < 2:
        return False
    y = y if abs(y.max()) >= abs(y.min()) else -y
    if y.min() < 0:
        return False
    edges = np.arange(0.0, y.size, half_cycle).astype(int)
    each = [y[begin:end] for begin, end in pairwise(edges)]
    peaks = np.array([one.max() for one in each])
    first = int(np.argmax(peaks))
    small = np.flatnonzero(peaks[first:] < LARGE * peaks[first])
    behind = first + int(small[0]) if small.size else peaks.size
    if behind - first < FEWEST:
        return False
    kept, peaks = each[first:behind], peaks[first:behind]
    lowest = np.array([one.min() for one in kept]) / peaks
    middle = np.array([float(np.median(one)) for one in kept]) / peaks
    falls = peaks[-1] < FALLS * peaks[0]
    return bool(falls and lowest.max() < TOUCHES and np.median(middle) > BETWEEN)
