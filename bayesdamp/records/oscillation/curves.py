"""Damping and frequency against amplitude, from the record alone: no law of damping or restoring force is assumed."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.linalg import cholesky_banded, solve_banded

from bayesdamp.records.oscillation.features import Features, crossing_times, regular
from bayesdamp.records.oscillation.turning import midpoints, turning_points
from bayesdamp.types import Refusal, Signal

MOST = 12
"""Points of a curve."""
LEAST = 5
"""Swings behind a point, where the record has as many."""


@dataclass(frozen=True)
class Curves:
    """At amplitudes (rad or m), shape (k,), from the largest on: the damping ratio, which is the fall of the log
    amplitude a cycle over 2π, the angular frequency (rad/s), and the standard deviation of each."""

    amplitude: np.ndarray
    ratio: np.ndarray
    ratio_sd: np.ndarray
    frequency: np.ndarray
    frequency_sd: np.ndarray


def amplitude_curves(signal: Signal, seen: Features) -> Curves:
    """The curves of a record from its swings (half-cycles between turning points).

    Over stretches of swings the log range is fitted by a parabola and the crossings of the midline by a line with an
    offset between rising and falling ones; errors are the larger of what the noise does to them and of the scatter
    about the fits. Neighbouring ranges share a turning point, and its error. Raises Refusal where there is no swing.
    """
    t, y = np.asarray(signal.t, float), np.asarray(signal.y, float)
    turns = regular(turning_points(t, y, seen.period, seen.roughness), seen.roughness)
    if turns.values.size < 2 or not np.all(np.diff(turns.values)):
        raise Refusal("there are no swings to read damping and frequency from")
    middle = midpoints(turns.values)
    crossings, weights = crossing_times(t, y, turns, middle)
    ranges = np.abs(np.diff(turns.values))
    ends = seen.roughness * turns.gain
    # A crossing is where a sinusoid fitted to half a swing's n samples meets the midline: by least squares its error is
    # 3/2 σ/√n over the slope.
    timing = 1.5 * seen.roughness * seen.period / np.pi / np.sqrt(np.maximum(weights, 1e-300))
    timing = np.where(weights > 0, timing, seen.period)
    order = {"angle": 0, "velocity": 1, "acceleration": 2}[signal.quantity]
    rows = []
    for part in np.array_split(np.arange(ranges.size), max(1, min(MOST, ranges.size // LEAST))):
        n = part - part.mean()
        size, fall, fall_sd = _line(
            n, np.log(ranges[part]), _shared(ends[part[0] : part[-1] + 2], ranges[part])
        )
        gap, gap_sd = _spacing(n, crossings[part], _Banded(timing[part] ** 2, np.zeros(part.size - 1)))
        frequency = np.pi / gap
        scale = 0.5 / frequency**order
        rows.append(
            (scale * np.exp(size), -fall / np.pi, fall_sd / np.pi, frequency, frequency * gap_sd / gap)
        )
    return Curves(*np.array(rows).T)


@dataclass(frozen=True)
class _Banded:
    """A covariance of neighbours alone: its diagonal, (k,), and what stands beside it, (k − 1,)."""

    diagonal: np.ndarray
    beside: np.ndarray

    def whitened(self, values: np.ndarray, least: float) -> np.ndarray:
        """Values (k, ...) times the inverse of its Cholesky factor, `least` added to its diagonal."""
        lower = np.vstack([self.diagonal + least, np.append(self.beside, 0.0)])
        return solve_banded((1, 0), cholesky_banded(lower, lower=True), values)


def _shared(ends: np.ndarray, ranges: np.ndarray) -> _Banded:
    """Covariance of log ranges (k,) between turning points with these errors, (k + 1,)."""
    squares = ends**2
    return _Banded((squares[:-1] + squares[1:]) / ranges**2, squares[1:-1] / (ranges[:-1] * ranges[1:]))


def _line(n: np.ndarray, values: np.ndarray, covariance: _Banded) -> tuple[float, float, float]:
    """(value, slope, sd of the slope) in the middle, n = 0, of a parabola; of a line through fewer than five."""
    columns = np.stack([np.ones_like(n), n, n**2], axis=1)[:, : 3 if n.size >= 5 else min(2, n.size)]
    c, error = _fitted(columns, values, covariance)
    return (c[0], c[1], error[1]) if c.size > 1 else (c[0], np.nan, np.nan)


def _spacing(n: np.ndarray, times: np.ndarray, covariance: _Banded) -> tuple[float, float]:
    """(time from a crossing to the next, its sd)."""
    alternate = (-1.0) ** np.round(n - n[0])
    columns = np.stack([np.ones_like(n), n, alternate], axis=1)[:, : 3 if n.size >= 4 else min(2, n.size)]
    c, error = _fitted(columns, times, covariance)
    return (c[1], error[1]) if c.size > 1 else (np.nan, np.nan)


def _fitted(columns: np.ndarray, values: np.ndarray, covariance: _Banded) -> tuple[np.ndarray, np.ndarray]:
    """Coefficients and their sds, by the given covariance or by the scatter, whichever is larger."""
    least = (1e-12 * np.abs(values).max() + 1e-150) ** 2
    white, scores = covariance.whitened(columns, least), covariance.whitened(values, least)
    inverse = np.linalg.pinv(white)
    c = inverse @ scores
    left = values.size - columns.shape[1]
    scatter = float(np.sum((scores - white @ c) ** 2)) / left if left > 0 else 1.0
    return c, np.sqrt(np.sum(inverse**2, axis=1) * max(scatter, 1.0))
