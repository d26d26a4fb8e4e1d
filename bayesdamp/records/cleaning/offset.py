"""The zero of a sensor of velocity or acceleration: over whole cycles of a free decay both are zero on the mean."""

from __future__ import annotations

import numpy as np

from bayesdamp.records.oscillation.features import Features
from bayesdamp.types import Signal

CLEAR = 3.0
"""Standard errors from which an offset is one."""
HARMONICS = 3
MOST = 6
"""Highest power of time in the amplitude of the oscillation; a power for every two cycles up to that."""


def sensor_offset(signal: Signal, seen: Features) -> float:
    """The constant that is added to a recorded velocity or acceleration, in its unit; 0 where none is clear.

    Least squares over a constant and an oscillation, its overtones among it, whose amplitude and phase are polynomials
    of time. A force that is not symmetric moves the midline of turning points; the mean over a cycle it leaves at zero.
    Of a displacement nothing is known: it rests where it rests.
    """
    if signal.quantity == "angle" or seen.crossing_times.size < 3:
        return 0.0
    x = 2 * (signal.t - signal.t[0]) / (signal.t[-1] - signal.t[0]) - 1
    degree = int(np.clip(seen.cycles / 2, 1, MOST))
    half = _half_cycles(signal.t, seen.crossing_times)
    columns = [np.ones((x.size, 1))]
    for k in range(1, HARMONICS + 1):
        powers = np.polynomial.chebyshev.chebvander(x, max(degree - k + 1, 0))
        columns += [np.cos(k * np.pi * half)[:, None] * powers, np.sin(k * np.pi * half)[:, None] * powers]
    design = np.hstack(columns)
    if x.size < 2 * design.shape[1]:
        return 0.0
    inverse = np.linalg.pinv(design)
    c = inverse @ signal.y
    left = signal.y - design @ c
    scatter = float(np.sqrt(np.sum(left**2) / (x.size - design.shape[1])))
    error = scatter * float(np.linalg.norm(inverse[0]))
    return float(c[0]) if abs(c[0]) > CLEAR * error else 0.0


def _half_cycles(t: np.ndarray, crossings: np.ndarray) -> np.ndarray:
    """Half-cycles at times t, (n,), smooth through crossings (k,): those up may lie off the middle of those down."""
    middle, width = 0.5 * (t[-1] + t[0]), 0.5 * (t[-1] - t[0])
    degree = int(np.clip(crossings.size // 4, 1, 4))
    number = np.arange(crossings.size)
    alternate = (-1.0) ** number[:, None] if crossings.size > 3 else np.empty((crossings.size, 0))
    powers = np.polynomial.chebyshev.chebvander((crossings - middle) / width, degree)
    c = np.linalg.lstsq(np.hstack([powers, alternate]), number, rcond=None)[0]
    return np.polynomial.chebyshev.chebval((t - middle) / width, c[: degree + 1])
