"""Whether what a fit leaves over is the record's noise."""

from __future__ import annotations

import numpy as np

from bayesdamp.estimators.shared import noise_level
from bayesdamp.records.oscillation.features import Features
from bayesdamp.types import Signal
from bayesdamp.units import quantity_unit

ROUGHER = 1.1
"""A residual of more than this many times the record's roughness, and five standard errors more, is told."""
CORRELATED = 0.1
"""So is one whose correlation over a twelfth of a period is above this and five standard errors from zero."""
SMALLEST = 1e-5
"""... if it is also more than this share of the amplitude: a trajectory's error is far below."""


def misfit(residual: np.ndarray, signal: Signal, seen: Features) -> str | None:
    """A sentence where the residual (n,) of a trajectory is more than noise, or None.

    White noise is mistaken for a misfit in less than one of 10⁶ records.
    """
    n = residual.size
    rms = float(np.sqrt(np.mean(residual**2)))
    size = float(np.abs(seen.turning_amplitudes).max())
    noise = max(noise_level(signal), seen.roughness)
    if rms <= SMALLEST * size:
        return None
    lag = min(max(1, round(seen.samples_per_cycle / 12)), n - 1)
    correlation = float(residual[lag:] @ residual[:-lag] / (residual @ residual))
    rougher = rms > (ROUGHER + 5 / np.sqrt(2 * n)) * noise
    if not rougher and correlation <= max(CORRELATED, 5 / np.sqrt(n)):
        return None
    times = f", {rms / noise:.3g} times the record's roughness" if noise > 1e-6 * size else ""
    return (
        f"the best fit leaves {rms:.2g} {quantity_unit(signal.unit, signal.quantity)}{times}: "
        "the model is not all of it, or the noise is correlated"
    )
