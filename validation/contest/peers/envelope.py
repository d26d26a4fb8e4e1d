"""Hilbert envelope: a straight line through its logarithm, for the whole record or near each amplitude.

The second is Feldman's method for damping that depends on the amplitude (FREEVIB, Mech. Syst. Signal Process. 8, 1994).
"""

from __future__ import annotations

import numpy as np
from scipy.signal import hilbert

from bayesdamp.types import Refusal
from validation.contest.peers.shared import about_rest, even, frequency
from validation.contest.reply import Reply, one_number

NEAR = 0.25
"""Half width of the line at an amplitude, as a share of the range of ln(envelope)."""
LEAST = 8


def answer(t: np.ndarray, y: np.ndarray, amplitudes: tuple[float, ...]) -> Reply:
    """Fit one line to the whole record."""
    times, size, omega = _envelope(t, y)
    return one_number(_ratio(times, size, omega), amplitudes)


def local(t: np.ndarray, y: np.ndarray, amplitudes: tuple[float, ...]) -> Reply:
    """Fit a line near each amplitude. Raises Refusal if the envelope has too few samples near an amplitude."""
    times, size, omega = _envelope(t, y)
    ratios = []
    for amplitude in amplitudes:
        near = np.abs(size - np.log(amplitude)) <= NEAR * np.ptp(size)
        if near.sum() < LEAST:
            raise Refusal("the envelope has too few samples near an amplitude")
        ratios.append(_ratio(times[near], size[near], omega))
    if min(ratios) <= 0:
        raise Refusal("no damping is found")
    return Reply(tuple(ratios))


def _envelope(t: np.ndarray, y: np.ndarray) -> tuple[np.ndarray, np.ndarray, float]:
    """Return times, log envelope and mean frequency (rad/s), without the first and the last cycle."""
    grid, values = even(t, y)
    f = frequency(grid, values)
    analytic = np.asarray(hilbert(about_rest(grid, values, f)))
    inside = (grid >= grid[0] + 1 / f) & (grid <= grid[-1] - 1 / f)
    if inside.sum() < LEAST:
        raise Refusal("the record is too short for an envelope without its first and last cycle")
    phase = np.unwrap(np.angle(analytic))[inside]
    return grid[inside], np.log(np.abs(analytic[inside])), float(np.polyfit(grid[inside], phase, 1)[0])


def _ratio(times: np.ndarray, size: np.ndarray, omega: float) -> float:
    rate = -float(np.polyfit(times, size, 1)[0])
    return rate / float(np.hypot(rate, omega))
