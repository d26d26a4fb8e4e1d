"""Logarithmic decrement: a straight line through the logarithms of the peaks as a function of their numbers."""

from __future__ import annotations

import numpy as np
from scipy.signal import find_peaks

from bayesdamp.types import Refusal
from validation.contest.peers.shared import about_rest, even, frequency, recorded
from validation.contest.reply import Reply, one_number

APART = 0.7
"""Least distance between peaks in periods, so that noise adds no peaks."""
LEAST = 3


def answer(t: np.ndarray, y: np.ndarray, amplitudes: tuple[float, ...]) -> Reply:
    """Return δ/√(4π² + δ²). Raises Refusal if there are fewer than three peaks."""
    grid, values = even(t, y)
    f = frequency(grid, values)
    x = about_rest(grid, values, f)
    peaks = find_peaks(x, distance=max(APART / (f * (grid[1] - grid[0])), 1))[0]
    peaks = peaks[(x[peaks] > 0) & recorded(grid, t)[peaks]]
    if peaks.size < LEAST:
        raise Refusal("fewer than three peaks")
    number = np.round((grid[peaks] - grid[peaks[0]]) * f)
    delta = -float(np.polyfit(number, np.log(x[peaks]), 1)[0])
    return one_number(delta / float(np.hypot(2 * np.pi, delta)), amplitudes)
