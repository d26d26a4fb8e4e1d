"""Provide what the peers share: even sampling, spectral peak, rest position, fit of a sinusoid."""

from __future__ import annotations

import numpy as np

from bayesdamp.types import Refusal
from validation.scoring import Reply

PADDING = 8
"""Factor by which padding with zeros lengthens the record before its spectral peak is searched."""
GAP = 1.5
"""Two samples that are more than this many median steps apart have a gap between them."""


def one_number(value: float, amplitudes: tuple[float, ...]) -> Reply:
    """Return a reply with the same damping ratio `value` at every amplitude. Raises Refusal if it is not positive."""
    if not value > 0:
        raise Refusal("the estimated damping ratio is not positive")
    return Reply((value,) * len(amplitudes))


def about_rest(t: np.ndarray, y: np.ndarray, f: float) -> np.ndarray:
    """Return the displacement from the rest position, which is the mean of the last whole cycles, at most five.

    Raises Refusal if the record is shorter than a cycle.

    Parameters
    ----------
    t, y : (n,) arrays
        Evenly sampled times in s, and displacements in rad.
    f : float
        Frequency in Hz.
    """
    cycles = min(int((t[-1] - t[0]) * f), 5)
    if cycles < 1:
        raise Refusal("the record has less than one cycle")
    return y - y[t >= t[-1] - cycles / f].mean()


def segments(t: np.ndarray, y: np.ndarray) -> list[tuple[np.ndarray, np.ndarray]]:
    """Return times and displacements of each piece of a record between its gaps."""
    cuts = np.flatnonzero(np.diff(t) > GAP * np.median(np.diff(t))) + 1
    return list(zip(np.split(t, cuts), np.split(y, cuts), strict=True))


def is_recorded(grid: np.ndarray, t: np.ndarray) -> np.ndarray:
    """Return for each time of a uniform grid, (m,), whether a sample is within one median sampling step of it, (m,).

    t: times of the samples, (n,). The result is false inside gaps of the record.
    """
    after = np.clip(np.searchsorted(t, grid), 1, t.size - 1)
    nearest = np.minimum(np.abs(grid - t[after - 1]), np.abs(grid - t[after]))
    return nearest <= np.median(np.diff(t))


def even(t, y):
    """Resample a record uniformly at its median time step by linear interpolation, also across gaps.

    t, y: times in s and values, (n,). Return the uniform times and the values there, (m,) each.
    """
    step = float(np.median(np.diff(t)))
    grid = np.arange(t[0], t[-1] + 0.5 * step, step)
    return grid, np.interp(grid, t, y)


def spectral_peak(t, y):
    """Return the frequency in Hz of the largest spectral line of evenly spaced samples.

    t, y: times in s and values, (n,). The mean is subtracted, and a Hann window is applied.
    """
    n = PADDING * t.size
    power = np.abs(np.fft.rfft((y - y.mean()) * np.hanning(t.size), n))
    return float((np.argmax(power[PADDING:]) + PADDING) / (n * (t[1] - t[0])))


def fit_sinusoid(phase, y):
    """Fit a cos(phase) + b sin(phase) + c to samples y (n,) by least squares; return the array (a, b, c).

    phase: in rad, (n,).
    """
    columns = np.column_stack([np.cos(phase), np.sin(phase), np.ones_like(phase)])
    return np.linalg.lstsq(columns, y, rcond=None)[0]
