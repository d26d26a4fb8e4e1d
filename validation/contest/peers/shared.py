"""What a user does by eye or by habit before any of the methods: rest, frequency, an even clock."""

from __future__ import annotations

import numpy as np

from bayesdamp.types import Refusal

PADDING = 8
GAP = 1.5
"""Samples further apart than so many steps have a gap between them."""


def even(t: np.ndarray, y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The record on an even clock of its median step, gaps bridged by straight lines."""
    step = float(np.median(np.diff(t)))
    grid = np.arange(t[0], t[-1] + 0.5 * step, step)
    return grid, np.interp(grid, t, y)


def frequency(t: np.ndarray, y: np.ndarray) -> float:
    """Where the spectrum is largest, Hz; t even."""
    n = PADDING * t.size
    size = np.abs(np.fft.rfft((y - y.mean()) * np.hanning(t.size), n))
    return float((np.argmax(size[PADDING:]) + PADDING) / (n * (t[1] - t[0])))


def about_rest(t: np.ndarray, y: np.ndarray, f: float) -> np.ndarray:
    """The displacement from rest, which is the mean of the last whole cycles, at most five; t even, f in Hz."""
    cycles = min(int((t[-1] - t[0]) * f), 5)
    if cycles < 1:
        raise Refusal("less than one cycle")
    return y - y[t >= t[-1] - cycles / f].mean()


def segments(t: np.ndarray, y: np.ndarray) -> list[tuple[np.ndarray, np.ndarray]]:
    """The record cut at its gaps."""
    cuts = np.flatnonzero(np.diff(t) > GAP * np.median(np.diff(t))) + 1
    return list(zip(np.split(t, cuts), np.split(y, cuts), strict=True))


def recorded(grid: np.ndarray, t: np.ndarray) -> np.ndarray:
    """Which times of an even clock are within a step of a sample, booleans of grid's shape."""
    after = np.clip(np.searchsorted(t, grid), 1, t.size - 1)
    nearest = np.minimum(np.abs(grid - t[after - 1]), np.abs(grid - t[after]))
    return nearest <= np.median(np.diff(t))
