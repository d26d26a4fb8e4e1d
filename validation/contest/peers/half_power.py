"""Half-power bandwidth of the spectrum of the record, over twice its frequency."""

from __future__ import annotations

import numpy as np

from bayesdamp.types import Refusal
from validation.contest.peers.shared import about_rest, even, frequency
from validation.contest.reply import Reply, one_number

PADDING = 16
"""Factor by which zeros lengthen the record, so that the peak has several points."""


def answer(t: np.ndarray, y: np.ndarray, amplitudes: tuple[float, ...]) -> Reply:
    """Measure the bandwidth without a window. Raises Refusal if the peak does not fall to half power on both sides."""
    grid, values = even(t, y)
    x = about_rest(grid, values, frequency(grid, values))
    size = np.abs(np.fft.rfft(x, PADDING * x.size))
    top = int(np.argmax(size[PADDING:])) + PADDING
    level = size[top] / np.sqrt(2)
    low, high = np.flatnonzero(size[:top] < level), np.flatnonzero(size[top:] < level)
    if not (low.size and high.size):
        raise Refusal("the spectrum's peak does not fall to half its power")
    a, b = int(low[-1]), top + int(high[0])
    left = a + (level - size[a]) / (size[a + 1] - size[a])
    right = b - (level - size[b]) / (size[b - 1] - size[b])
    return one_number(float(0.5 * (right - left) / top), amplitudes)
