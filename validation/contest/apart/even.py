"""A record on an even clock, and where its spectrum is largest."""

import numpy as np

PADDING = 8


def even(t, y):
    """The record on a clock of its median step, gaps bridged by straight lines."""
    step = float(np.median(np.diff(t)))
    grid = np.arange(t[0], t[-1] + 0.5 * step, step)
    return grid, np.interp(grid, t, y)


def spectral_peak(t, y):
    """Frequency in Hz of the largest line of evenly spaced samples."""
    n = PADDING * t.size
    power = np.abs(np.fft.rfft((y - y.mean()) * np.hanning(t.size), n))
    return float((np.argmax(power[PADDING:]) + PADDING) / (n * (t[1] - t[0])))
