"""Provide what the peers share: even sampling, the spectral peak, the fit of a sinusoid, the ratio of a damping sum."""

import math
from typing import Any

import numpy as np

PADDING = 8


def even(t, y):
    """Return times and values of a record resampled at its median step by linear interpolation, also across gaps."""
    step = float(np.median(np.diff(t)))
    grid = np.arange(t[0], t[-1] + 0.5 * step, step)
    return grid, np.interp(grid, t, y)


def spectral_peak(t, y):
    """Return the frequency in Hz of the largest spectral line of evenly spaced samples."""
    n = PADDING * t.size
    power = np.abs(np.fft.rfft((y - y.mean()) * np.hanning(t.size), n))
    return float((np.argmax(power[PADDING:]) + PADDING) / (n * (t[1] - t[0])))


def fit_sinusoid(phase, y):
    """Fit a cos(phase) + b sin(phase) + c to samples y (n,) by least squares; return the array (a, b, c).

    phase: in rad, (n,).
    """
    columns = np.column_stack([np.cos(phase), np.sin(phase), np.ones_like(phase)])
    return np.linalg.lstsq(columns, y, rcond=None)[0]


def ratio(
    amplitude: Any, frequency: Any, viscous: Any = 0.0, coulomb: Any = 0.0, quadratic: Any = 0.0
) -> Any:
    """Return the equivalent damping ratio of the force 2 viscous v + coulomb sign(v) + quadratic v|v| at an amplitude.

    The force is per unit of inertia, in SI units; `amplitude` is in rad, and `frequency` in rad/s.
    """
    return (
        viscous / frequency
        + 2 * coulomb / (math.pi * frequency**2 * amplitude)
        + 4 * quadratic * amplitude / (3 * math.pi)
    )
