"""SciPy's `curve_fit` of an exponentially decaying cosine, with the interval from its covariance."""

from __future__ import annotations

import warnings

import numpy as np
from scipy.optimize import OptimizeWarning, curve_fit
from scipy.stats import norm

from bayesdamp.types import Refusal
from validation.contest.peers.shared import even, frequency
from validation.contest.reply import Reply

GUESS = 0.02


def decay(t: np.ndarray, size: float, ratio: float, omega: float, phase: float, rest: float) -> np.ndarray:
    """Return the textbook decay of a linear oscillator with viscous damping."""
    ratio = float(np.clip(ratio, -1.0, 1.0))
    return size * np.exp(-ratio * omega * t) * np.cos(omega * np.sqrt(1 - ratio**2) * t + phase) + rest


def answer(t: np.ndarray, y: np.ndarray, amplitudes: tuple[float, ...]) -> Reply:
    """Start at the spectral frequency and the phase of the first cycle. Raises Refusal if the fit does not converge."""
    omega = 2 * np.pi * frequency(*even(t, y))
    first = omega * (t - t[0]) <= 2 * np.pi
    phase = omega * (t[first] - t[0])
    columns = np.column_stack([np.cos(phase), -np.sin(phase), np.ones_like(phase)])
    c, s, rest = np.linalg.lstsq(columns, y[first], rcond=None)[0]
    guess = [float(np.hypot(c, s)), GUESS, omega, float(np.arctan2(s, c)), float(rest)]
    with warnings.catch_warnings():
        warnings.simplefilter("error", OptimizeWarning)
        try:
            best, covariance = curve_fit(decay, t - t[0], y, guess)
        except (RuntimeError, OptimizeWarning) as fault:
            raise Refusal(" ".join(str(fault).split())) from None
    value, half = float(best[1]), float(norm.ppf(0.975) * np.sqrt(covariance[1, 1]))
    if not value > 0:
        raise Refusal("no damping is found")
    n = len(amplitudes)
    return Reply((value,) * n, (value - half,) * n, (value + half,) * n)
