"""How much larger the noise is near the oscillation than over all frequencies."""

from __future__ import annotations

import numpy as np

BAND = (0.3, 2.0)
"""Frequencies that count, in units of the oscillation's."""


def inflation(
    t: np.ndarray, left: np.ndarray, frequency: float, taken: int, variance: float | None = None
) -> float:
    """Return κ ≥ 1: the mean power of the residual near the oscillation over that of white noise.

    Parameters
    ----------
    t : ndarray, shape (n,)
        Times in s.
    left : ndarray, shape (n,)
        What a fit leaves.
    frequency : float
        Of the oscillation, in rad/s.
    taken : int
        Directions that the fit has taken out of the record, nearly all of them near the oscillation.
    variance : float, optional
        Of the white noise; by default that of the residual.
    """
    n = left.size
    grid = np.linspace(t[0], t[-1], n)
    even = np.interp(grid, t, left)
    power = np.abs(np.fft.rfft(even)) ** 2 / n
    omega = 2 * np.pi * np.fft.rfftfreq(n, (t[-1] - t[0]) / (n - 1))
    band = (omega > BAND[0] * frequency) & (omega < BAND[1] * frequency)
    modes = 2 * int(band.sum())
    # What the fit took out, spread over the band, but never more than half of it.
    kept = max(modes - taken, 0.5 * modes)
    if variance is None:
        variance = float(left @ left) / max(n - taken, 1)
    if modes < 6 or variance <= 0:
        return 1.0
    return max(1.0, 2 * float(power[band].sum()) / kept / variance)
