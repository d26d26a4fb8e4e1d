"""Sample a record evenly, and find the peak of its spectrum."""

import numpy as np

PADDING = 8


def even(t, y):
    """Sample a record at its median step, with straight lines across gaps."""
    step = float(np.median(np.diff(t)))
    grid = np.arange(t[0], t[-1] + 0.5 * step, step)
    return grid, np.interp(grid, t, y)


def spectral_peak(t, y):
    """Return the frequency in Hz of the largest spectral line of evenly spaced samples."""
    n = PADDING * t.size
    power = np.abs(np.fft.rfft((y - y.mean()) * np.hanning(t.size), n))
    return float((np.argmax(power[PADDING:]) + PADDING) / (n * (t[1] - t[0])))
