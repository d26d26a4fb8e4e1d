"""Define the textbook methods: logarithmic decrement, Hilbert envelope, decaying cosine."""

from __future__ import annotations

import warnings

import numpy as np
from scipy.optimize import OptimizeWarning, curve_fit
from scipy.signal import find_peaks, hilbert
from scipy.stats import norm

from bayesdamp.types import Refusal
from validation.contest.peers.shared import (
    about_rest,
    even,
    fit_sinusoid,
    is_recorded,
    one_number,
    spectral_peak,
)
from validation.scoring import Reply

APART = 0.7
"""Least distance between peaks in periods, so that noise adds no peaks."""
LEAST_PEAKS = 3
"""Least number of peaks for the logarithmic decrement; a record with fewer is refused."""
NEAR = 0.25
"""A line at an amplitude is fitted to the samples of ln(envelope) that differ from ln(amplitude) by at most this
fraction of the range of ln(envelope)."""
LEAST_SAMPLES = 8
"""Least number of samples of the envelope to which a line is fitted; with fewer, the record is refused."""
GUESS = 0.02
"""Damping ratio from which the fit of a decaying cosine starts."""


def decrement(t: np.ndarray, y: np.ndarray, amplitudes: tuple[float, ...]) -> Reply:
    """Return the damping ratio δ/√(4π² + δ²), the same for all amplitudes, from the logarithmic decrement δ.

    −δ is the slope of a straight line through the logarithms of the peaks against the number of the cycle. t, y: times
    in s and displacements in rad, (n,). Raises Refusal for fewer than three peaks.
    """
    grid, values = even(t, y)
    f = spectral_peak(grid, values)
    x = about_rest(grid, values, f)
    peaks = find_peaks(x, distance=max(APART / (f * (grid[1] - grid[0])), 1))[0]
    peaks = peaks[(x[peaks] > 0) & is_recorded(grid, t)[peaks]]
    if peaks.size < LEAST_PEAKS:
        raise Refusal("the record has fewer than three peaks")
    number = np.round((grid[peaks] - grid[peaks[0]]) * f)
    delta = -float(np.polyfit(number, np.log(x[peaks]), 1)[0])
    return one_number(delta / float(np.hypot(2 * np.pi, delta)), amplitudes)


def envelope(t: np.ndarray, y: np.ndarray, amplitudes: tuple[float, ...]) -> Reply:
    """Return damping ratios from a line through the log envelope near each amplitude (Feldman's FREEVIB, MSSP 8, 1994).

    Raises Refusal if the envelope has too few samples near an amplitude.
    """
    times, size, omega = _envelope(t, y)
    ratios = []
    for amplitude in amplitudes:
        near = np.abs(size - np.log(amplitude)) <= NEAR * np.ptp(size)
        if near.sum() < LEAST_SAMPLES:
            raise Refusal("the envelope has too few samples near an amplitude")
        ratios.append(_ratio(times[near], size[near], omega))
    if min(ratios) <= 0:
        raise Refusal("the estimated damping ratio is not positive at every amplitude")
    return Reply(tuple(ratios))


def _envelope(t: np.ndarray, y: np.ndarray) -> tuple[np.ndarray, np.ndarray, float]:
    """Return times, log Hilbert envelope and mean frequency (rad/s) of a record without its first and last cycle.

    Raises Refusal if fewer than `LEAST_SAMPLES` samples are left.
    """
    grid, values = even(t, y)
    f = spectral_peak(grid, values)
    analytic = np.asarray(hilbert(about_rest(grid, values, f)))
    inside = (grid >= grid[0] + 1 / f) & (grid <= grid[-1] - 1 / f)
    if inside.sum() < LEAST_SAMPLES:
        raise Refusal("the record is too short for an envelope without its first and last cycle")
    phase = np.unwrap(np.angle(analytic))[inside]
    return grid[inside], np.log(np.abs(analytic[inside])), float(np.polyfit(grid[inside], phase, 1)[0])


def _ratio(times: np.ndarray, size: np.ndarray, omega: float) -> float:
    """Return the damping ratio from the slope of a line through the log envelope `size`; omega: frequency in rad/s."""
    rate = -float(np.polyfit(times, size, 1)[0])
    return rate / float(np.hypot(rate, omega))


def decay(t: np.ndarray, size: float, ratio: float, omega: float, phase: float, rest: float) -> np.ndarray:
    """Return the displacement (n,) of a linear oscillator with viscous damping: a decaying cosine about `rest`.

    t: times in s, (n,). size, phase: amplitude and phase (rad) of the cosine at t = 0. ratio: damping ratio. omega:
    undamped frequency in rad/s.
    """
    ratio = float(np.clip(ratio, -1.0, 1.0))
    return size * np.exp(-ratio * omega * t) * np.cos(omega * np.sqrt(1 - ratio**2) * t + phase) + rest


def decaying_cosine(t: np.ndarray, y: np.ndarray, amplitudes: tuple[float, ...]) -> Reply:
    """Fit a decaying cosine by SciPy's `curve_fit`; return its damping ratio, with the interval from the covariance.

    Raises Refusal if the fit does not converge. The fit starts at the spectral frequency and the phase of the first
    cycle.
    """
    omega = 2 * np.pi * spectral_peak(*even(t, y))
    first = omega * (t - t[0]) <= 2 * np.pi
    c, s, rest = fit_sinusoid(omega * (t[first] - t[0]), y[first])
    guess = [float(np.hypot(c, s)), GUESS, omega, float(np.arctan2(-s, c)), float(rest)]
    with warnings.catch_warnings():
        warnings.simplefilter("error", OptimizeWarning)
        try:
            best, covariance = curve_fit(decay, t - t[0], y, guess)
        except (RuntimeError, OptimizeWarning) as fault:
            raise Refusal(" ".join(str(fault).split())) from None
    value, half = float(best[1]), float(norm.ppf(0.975) * np.sqrt(covariance[1, 1]))
    if not value > 0:
        raise Refusal("the estimated damping ratio is not positive")
    n = len(amplitudes)
    return Reply((value,) * n, (value - half,) * n, (value + half,) * n)
