"""The Hilbert envelope: a straight line through its logarithm, of the whole record or about each amplitude.

The second is Feldman's way to damping that depends on the amplitude (FREEVIB, Mech. Syst. Signal Process. 8, 1994).
"""

from __future__ import annotations

import numpy as np
from scipy.signal import hilbert

from bayesdamp.types import Refusal
from validation.contest.peers.shared import about_rest, even, frequency
from validation.contest.reply import Reply, one_number

NEAR = 0.25
"""Share of the range of ln(envelope) on either side of an amplitude that its line is of."""
LEAST = 8


def answer(t: np.ndarray, y: np.ndarray, amplitudes: tuple[float, ...]) -> Reply:
    """One line for the whole record."""
    times, size, omega = _envelope(t, y)
    return one_number(_ratio(times, size, omega), amplitudes)


def local(t: np.ndarray, y: np.ndarray, amplitudes: tuple[float, ...]) -> Reply:
    """A line for each amplitude. Raises Refusal where the envelope has too few samples about one."""
    times, size, omega = _envelope(t, y)
    found = []
    for amplitude in amplitudes:
        near = np.abs(size - np.log(amplitude)) <= NEAR * np.ptp(size)
        if near.sum() < LEAST:
            raise Refusal("the envelope does not pass an amplitude")
        found.append(_ratio(times[near], size[near], omega))
    if min(found) <= 0:
        raise Refusal("no damping is found")
    return Reply(tuple(found))


def _envelope(t: np.ndarray, y: np.ndarray) -> tuple[np.ndarray, np.ndarray, float]:
    """Times, logarithm of the envelope, and mean frequency in rad/s, without the first and the last cycle."""
    grid, values = even(t, y)
    f = frequency(grid, values)
    analytic = np.asarray(hilbert(about_rest(grid, values, f)))
    inside = (grid >= grid[0] + 1 / f) & (grid <= grid[-1] - 1 / f)
    if inside.sum() < LEAST:
        raise Refusal("nothing is left between the ends of the envelope")
    phase = np.unwrap(np.angle(analytic))[inside]
    return grid[inside], np.log(np.abs(analytic[inside])), float(np.polyfit(grid[inside], phase, 1)[0])


def _ratio(times: np.ndarray, size: np.ndarray, omega: float) -> float:
    rate = -float(np.polyfit(times, size, 1)[0])
    return rate / float(np.hypot(rate, omega))
