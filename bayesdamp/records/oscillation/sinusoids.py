"""Amplitude and phase of a decaying oscillation along a record, from sinusoids fitted in short windows.

A window of two periods or more, weighted by a raised cosine, sees the oscillation alone: a second mode or a harmonic
near twice its frequency or above hardly changes the fitted amplitude, where it changes turning points by its own size.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.ndimage import median_filter, uniform_filter1d

from bayesdamp.records.oscillation.features import Features
from bayesdamp.records.oscillation.spectrum import averaged
from bayesdamp.types import Refusal, Signal

SHORTEST, LONGEST, SHARE = 2.0, 8.0, 0.05
"""Shortest and longest window in periods, and its share of the record's cycles between these (conventional)."""
PER_WINDOW = 4
"""Windows that begin within the length of one."""
MOST, FEWEST = 100, 3
"""Most windows (in a longer record they lie further apart), and fewest."""
PER_CYCLE = 64
"""Samples a cycle above which neighbours are averaged, which makes every amplitude 0.04 % smaller."""
FEWEST_SAMPLES = 8
COVERED = 0.6
"""Share of a window's weight that samples must cover, so that windows over holes are left out."""
FAR = 6.0
"""Robust standard deviations from which a sample is left out of a window's fit."""
ROUNDING = 0.29
"""Standard deviation of a rounding error, in steps."""
LEAST_ERROR = 1e-5
"""Smallest relative error of an amplitude: below it the fit's own error rules."""
NUGGET = 1e-3
"""Share of the errors' variance that neighbouring windows do not share, which keeps the correlation matrix regular."""


@dataclass(frozen=True)
class Sinusoids:
    """Fits in k windows, in the order of time.

    times: middles of the windows in s, (k,). amplitudes: in the unit of the record, (k,). phases: in rad, continuous
    along the record, (k,). errors: standard errors of the phases, which are those of the amplitudes relative to
    themselves, (k,). correlation: of the errors of overlapping windows, (k, k). widths: of the windows in s, (k,).
    """

    times: np.ndarray
    amplitudes: np.ndarray
    phases: np.ndarray
    errors: np.ndarray
    correlation: np.ndarray
    widths: np.ndarray

    @property
    def covariance(self) -> np.ndarray:
        """Of the errors, (k, k)."""
        return self.errors[:, None] * self.errors * self.correlation

    @property
    def places(self) -> np.ndarray:
        """Times from −1 to 1 along the record, (k,)."""
        first, last = self.times[0], self.times[-1]
        return 2 * (self.times - first) / (last - first) - 1


def sinusoids(signal: Signal, seen: Features) -> Sinusoids:
    """Fit a sinusoid of linearly changing amplitude and midline in each of many overlapping windows.

    Raises Refusal where the record is too short for three windows.
    """
    block = max(int(seen.samples_per_cycle / PER_CYCLE), 1)
    t, y = (averaged(np.asarray(values, float), block) for values in (signal.t, signal.y))
    first = max(float(t[0]), float(seen.swing_times[0]) - 0.75 * seen.period)
    last = min(float(t[-1]), float(seen.swing_times[-1]) + 0.75 * seen.period)
    span = (last - first) / seen.period
    periods = max(min(float(np.clip(SHARE * seen.cycles, SHORTEST, LONGEST)), span - 1.5), 1.0)
    inside = last - first - periods * seen.period
    count = int(np.clip(PER_WINDOW * inside / (periods * seen.period) + 1, FEWEST, MOST))
    middles = first + 0.5 * periods * seen.period + np.linspace(0, 1, count) * max(inside, 0.0)
    # The phases tell the pace better than turning points, which a second mode shifts: fit again with theirs.
    rough = _fits(t, y, middles, 2 * np.pi / _periods(seen, middles), periods, seen)
    pace = np.interp(middles, rough[0], np.gradient(rough[2], rough[0]))
    pace = np.clip(pace, 0.8 * rough[4].min(), 1.25 * rough[4].max())
    times, amplitudes, phases, gains, used = _fits(t, y, middles, pace, periods, seen)
    widths = 2 * np.pi * periods / used
    noise = float(np.hypot(seen.roughness, ROUNDING * signal.step)) / np.sqrt(block)
    return Sinusoids(
        times,
        amplitudes,
        phases,
        np.maximum(noise * gains / amplitudes, LEAST_ERROR),
        _correlation(times, float(np.median(widths))),
        widths,
    )


def _fits(
    t: np.ndarray, y: np.ndarray, middles: np.ndarray, pace: np.ndarray, periods: float, seen: Features
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Fit windows at `middles` (m,) with sinusoids of a pace (m,), in rad/s.

    Return times, amplitudes, continuous phases, noise gains and pace of the windows that have samples, (k,) each.
    Raises Refusal where these are too few.
    """
    rows = [
        (middle, *fitted, omega)
        for middle, omega in zip(middles.tolist(), pace.tolist(), strict=True)
        if (fitted := _fitted(t, y, middle, omega, periods)) is not None
    ]
    if len(rows) < FEWEST:
        raise Refusal("the record has too few cycles to read damping and frequency from")
    times, amplitudes, phases, gains, used = np.array(rows).T
    return times, amplitudes, _continuous(times, phases, used, seen), gains, used


def _periods(seen: Features, at: np.ndarray) -> np.ndarray:
    """Periods in s at times `at`, from neighbouring turning points; smooth, so that one spoilt point does no harm."""
    turns = seen.turning_times
    if turns.size < 3:
        return np.full(at.size, seen.period)
    periods, times = turns[2:] - turns[:-2], turns[1:-1]
    if periods.size >= 5:
        periods = uniform_filter1d(median_filter(periods, 5, mode="nearest"), 5, mode="nearest")
    return np.interp(at, times, periods)


def _fitted(
    t: np.ndarray, y: np.ndarray, middle: float, pace: float, periods: float
) -> tuple[float, float, float] | None:
    """Fit one window of so many periods.

    Return its amplitude, phase at the middle and noise gain, or None where samples are missing.
    """
    width = periods * 2 * np.pi / pace
    a, b = np.searchsorted(t, [middle - 0.5 * width, middle + 0.5 * width])
    if b - a < FEWEST_SAMPLES:
        return None
    u, values = t[a:b] - middle, y[a:b]
    angle = pace * u
    wave = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    place = (u / width)[:, None]
    columns = np.hstack([wave, np.ones_like(place), place, place * wave])
    weight = np.cos(np.pi * u / width) ** 2
    spacing = float(t[-1] - t[0]) / (t.size - 1)
    c, inverse = _weighted(columns, values, weight)
    off = np.abs(values - columns @ c)
    far = off > FAR * 1.4826 * float(np.median(off))
    if np.any(far) and np.count_nonzero(~far) >= FEWEST_SAMPLES:
        weight = np.where(far, 0.0, weight)
        c, inverse = _weighted(columns, values, weight)
    size = float(np.hypot(c[0], c[1]))
    if size == 0 or weight.sum() * spacing < COVERED * 0.5 * width:
        return None
    gain = float(np.linalg.norm((c[0] * inverse[0] + c[1] * inverse[1]) / size))
    return size, float(np.arctan2(-c[1], c[0])), gain


def _weighted(columns: np.ndarray, values: np.ndarray, weight: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Weighted least squares: coefficients (6,) and the matrix (6, n) that gives them."""
    weighted = columns * weight[:, None]
    inverse = np.linalg.pinv(weighted.T @ columns, hermitian=True) @ weighted.T
    return inverse @ values, inverse


def _continuous(times: np.ndarray, phases: np.ndarray, pace: np.ndarray, seen: Features) -> np.ndarray:
    """Add whole turns to phases (k,), so that they advance as the crossings of the midline count them."""
    ahead = np.diff(times) * 0.5 * (pace[1:] + pace[:-1])
    crossings = seen.crossing_times
    if crossings.size > 1:
        counted = np.diff(np.interp(times, crossings, np.pi * np.arange(crossings.size)))
        within = (times[:-1] >= crossings[0]) & (times[1:] <= crossings[-1])
        ahead = np.where(within, counted, ahead)
    steps = np.diff(phases)
    steps = steps + 2 * np.pi * np.round((ahead - steps) / (2 * np.pi))
    return phases[0] + np.concatenate([[0.0], np.cumsum(steps)])


def _correlation(times: np.ndarray, width: float) -> np.ndarray:
    """Correlate estimates from overlapping raised cosines by these windows' autocorrelation at their distance.

    One width (s) for all keeps the matrix positive definite.
    """
    lag = np.abs(times[:, None] - times) / width
    lag = np.minimum(lag, 1.0)
    turn = 2 * np.pi * lag
    overlap = (1 - lag) * (2 + np.cos(turn)) / 3 + np.sin(turn) / (2 * np.pi)
    return (1 - NUGGET) * overlap + NUGGET * np.eye(times.size)
