"""Damping and frequency against amplitude, from the record alone: no law of damping or restoring force is assumed."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from bayesdamp.signals.features import Features, crossing_times, regular
from bayesdamp.signals.turning import midpoints, turning_points
from bayesdamp.types import Signal

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
    offset between rising and falling ones; errors are the larger of what the noise does to turning points and of the
    scatter about the fits.
    """
    t, y = np.asarray(signal.t, float), np.asarray(signal.y, float)
    turns = regular(turning_points(t, y, seen.period, seen.roughness), seen.roughness)
    middle = midpoints(turns.values)
    crossings, weights = crossing_times(t, y, turns, middle)
    ranges = np.abs(np.diff(turns.values))
    noise = seen.roughness * np.hypot(turns.gain[:-1], turns.gain[1:]) / ranges
    order = {"angle": 0, "velocity": 1, "acceleration": 2}[signal.quantity]
    rows = []
    for part in np.array_split(np.arange(ranges.size), max(1, min(MOST, ranges.size // LEAST))):
        n = part - part.mean()
        size, fall, fall_sd = _line(n, np.log(ranges[part]), noise[part])
        timing = 2.0 * noise[part] * seen.period / (2 * np.pi)
        gap, gap_sd = _spacing(n, crossings[part], np.where(weights[part] > 0, timing, 10 * timing))
        frequency = np.pi / gap
        scale = 0.5 / frequency**order
        rows.append(
            (scale * np.exp(size), -fall / np.pi, fall_sd / np.pi, frequency, frequency * gap_sd / gap)
        )
    return Curves(*np.array(rows).T)


def _line(n: np.ndarray, values: np.ndarray, sd: np.ndarray) -> tuple[float, float, float]:
    """(value, slope, sd of the slope) in the middle, n = 0, of a parabola; of a line through fewer than five."""
    columns = np.stack([np.ones_like(n), n, n**2], axis=1)[:, : 3 if n.size >= 5 else min(2, n.size)]
    c, error = _fitted(columns, values, sd)
    return (c[0], c[1], error[1]) if c.size > 1 else (c[0], np.nan, np.nan)


def _spacing(n: np.ndarray, times: np.ndarray, sd: np.ndarray) -> tuple[float, float]:
    """(time from a crossing to the next, its sd)."""
    alternate = (-1.0) ** np.round(n - n[0])
    columns = np.stack([np.ones_like(n), n, alternate], axis=1)[:, : 3 if n.size >= 4 else min(2, n.size)]
    c, error = _fitted(columns, times, sd)
    return (c[1], error[1]) if c.size > 1 else (np.nan, np.nan)


def _fitted(columns: np.ndarray, values: np.ndarray, sd: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Coefficients and their sds, by the given sds (n,) or by the scatter, whichever is larger."""
    sd = np.maximum(sd, 1e-12 * np.abs(values).max() + 1e-300)
    white = columns / sd[:, None]
    inverse = np.linalg.pinv(white)
    c = inverse @ (values / sd)
    left = values.size - columns.shape[1]
    scatter = float(np.sum(((values - columns @ c) / sd) ** 2)) / left if left > 0 else 1.0
    return c, np.sqrt(np.sum(inverse**2, axis=1) * max(scatter, 1.0))
