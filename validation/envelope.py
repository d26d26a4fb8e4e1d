"""The range of amplitudes of a measured record, roughly, from its samples alone."""

from __future__ import annotations

import numpy as np

from bayesdamp.types import Refusal, Signal

PADDING = 8
CYCLES = 3.0
"""Least number of periods of which a range of amplitudes is told."""


def amplitude_range(signal: Signal) -> tuple[float, float]:
    """Amplitudes (unit of the record) half a period within its start and its end, the first first.

    Each is that of a sinusoid and a constant fitted to one period by least squares; the period is where the spectrum
    is largest. Raises Refusal on fewer than three periods.
    """
    t, y = signal.t, signal.y
    period = _period(t, y)
    if t[-1] - t[0] < CYCLES * period:
        raise Refusal(f"the record has fewer than {CYCLES:g} periods")
    return _size(t, y, t[0], period), _size(t, y, t[-1] - period, period)


def _period(t: np.ndarray, y: np.ndarray) -> float:
    grid = np.linspace(t[0], t[-1], t.size)
    values = np.interp(grid, t, y)
    values = (values - values.mean()) * np.hanning(values.size)
    power = np.abs(np.fft.rfft(values, PADDING * values.size)) ** 2
    peak = int(np.argmax(power[PADDING:])) + PADDING
    return PADDING * values.size * float(grid[1] - grid[0]) / peak


def _size(t: np.ndarray, y: np.ndarray, begin: float, period: float) -> float:
    inside = (t >= begin) & (t <= begin + period)
    phase = 2 * np.pi * (t[inside] - begin) / period
    columns = np.column_stack([np.cos(phase), np.sin(phase), np.ones_like(phase)])
    c, s, _ = np.linalg.lstsq(columns, y[inside], rcond=None)[0]
    return float(np.hypot(c, s))
