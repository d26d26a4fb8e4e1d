"""The half-power bandwidth of the record's spectrum, over twice its frequency."""

from __future__ import annotations

import numpy as np

from bayesdamp.types import Refusal
from validation.contest.peers.shared import about_rest, even, frequency
from validation.contest.reply import Reply, one_number

PADDING = 16
"""Times by which the record is lengthened with zeros, so that the peak has points on it."""


def answer(t: np.ndarray, y: np.ndarray, amplitudes: tuple[float, ...]) -> Reply:
    """No window but the record's own. Raises Refusal where the peak does not fall to its half on both sides."""
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
