"""Measure features of a decaying oscillation: period, amplitude, noise and turning points; find gaps in the samples."""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, field
from functools import wraps
from typing import Concatenate, ParamSpec, TypeVar

import numpy as np
from threadpoolctl import threadpool_limits

from bayesdamp.records.oscillation.noise import (
    LEAST_SHARE,
    coarse_period,
    coarse_periods,
    group_by_size,
    neighbourhoods,
    roughness,
)
from bayesdamp.types import DERIVATIVES, FeatureValues, Refusal, Signal

PER_CYCLE = 48
"""Largest number of samples a cycle to which a record is reduced for the first search of turning points. The turning
points are then refined with all samples."""
FEW_TURNS = 7
"""If fewer turning points than this are found, the search is repeated with a weaker condition: the values need to
return from an extremum by only half of the distance that was required before. Under heavy damping a half cycle may be
less than half of the one before."""
ENOUGH_TURNS, LEAST_RANGE = 5, 0.5
"""If the first of the possible periods gives fewer regular turning points than `ENOUGH_TURNS`, other periods are tried
too. One with more turning points is used if their range (maximum minus minimum) is at least `LEAST_RANGE` times that
with the first period (conventional)."""
LEAST_SAMPLES = 9
"""The window of samples around a turning point is widened, up to threefold, until it has this many samples, which are
enough to determine a sinusoid with changing amplitude, phase and midline."""
GRID_POINTS = 81
"""Number of points on a fitted curve between which its extremum is searched (conventional)."""


@dataclass(frozen=True)
class TurningPoints:
    """Turning points of a record: alternating maxima and minima.

    Attributes
    ----------
    times
        Times in s, (k,).
    values
        Values in the unit of the record, (k,).
    gain
        Noise gain: standard deviation of each value divided by that of the noise of a sample, (k,).
    """

    times: np.ndarray
    values: np.ndarray
    gain: np.ndarray

    def cut(self, first: int, last: int) -> TurningPoints:
        """Return the turning points with indices `first` to `last` − 1."""
        return TurningPoints(self.times[first:last], self.values[first:last], self.gain[first:last])


def true_runs(flags: np.ndarray) -> list[tuple[int, int]]:
    """Return the index of the first true value, and that after the last, of each run of true values in flags (n,)."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], flags.astype(int), [0]])))
    return list(zip(edges[::2].tolist(), edges[1::2].tolist(), strict=True))


def local_median(values: np.ndarray) -> np.ndarray:
    """Return the medians (k,) of values (k,), each over the value and up to four neighbours on either side."""
    padded = np.pad(values.astype(float), 4, constant_values=np.nan)
    return np.nanmedian(np.lib.stride_tricks.sliding_window_view(padded, 9).copy(), axis=1)


def resample(
    t: np.ndarray, y: np.ndarray, period: float, smooth: bool = True
) -> tuple[np.ndarray, np.ndarray, int]:
    """Interpolate a record linearly on an equally spaced grid with at most PER_CYCLE samples a period.

    Samples that are much denser than the grid are averaged first.

    Parameters
    ----------
    t, y
        Times in s and values, each (n,).
    period
        Period of the oscillation, in s.
    smooth
        Whether to reduce spikes with a median filter, and noise with a weighted moving average. The filter is used for
        at least 24 grid points a period, the average for at least 10.

    Returns
    -------
    tuple
        Times in s and values on the grid, each (m,), and the number of grid points in a period, rounded, at least 3.
    """
    mean_gap = (t[-1] - t[0]) / (t.size - 1)
    gap = max(mean_gap, period / PER_CYCLE)
    if gap > 1.5 * mean_gap:
        bins = np.minimum(((t - t[0]) / gap).astype(int), int((t[-1] - t[0]) / gap))
        starts = np.flatnonzero(np.diff(bins, prepend=-1))
        counts = np.diff(np.append(starts, t.size))
        t, y = np.add.reduceat(t, starts) / counts, np.add.reduceat(y, starts) / counts
    grid = np.arange(t[0], t[-1] + gap / 2, gap)
    values = np.interp(grid, t, y)
    a_period = max(round(period / gap), 3)
    if not smooth:
        return grid, values, a_period
    if a_period >= 24:  # so that spikes do not count as turning points
        values = np.median(neighbourhoods(values, 5 if a_period >= 40 else 3), axis=1)
    half = a_period // 10
    if half:
        kernel = np.hanning(2 * half + 3)[1:-1]
        padded = np.pad(values, half, mode="reflect", reflect_type="odd")
        values = np.convolve(padded, kernel / kernel.sum(), mode="valid")
    return grid, values, a_period


def zigzag(y: np.ndarray, swing: np.ndarray) -> tuple[list[int], int]:
    """Find alternating maxima and minima; small ones, from which the values return by less than `swing`, do not count.

    The first extremum may be the first value. The last one is the extremum after the last counted return; it counts
    even if the values return from it by less, and it may be the last value.

    Parameters
    ----------
    y
        Values, (n,).
    swing
        Required return, in the unit of y, (n,): an extremum e counts as soon as a later value y_i differs from it by
        more than swing_i.

    Returns
    -------
    tuple
        Indices of the extrema, and 1 if the first is a maximum, −1 if it is a minimum, 0 if there are none.
    """
    extrema: list[int] = []
    kind = first = low = high = 0
    values, swings = y.tolist(), swing.tolist()
    for i in (np.flatnonzero(np.diff(y)) + 1).tolist():
        value = values[i]
        if value > values[i - 1]:
            high = i if value > values[high] else high
            if kind <= 0 and value - swings[i] > values[low]:
                extrema.append(low)
                first = first or -1
                kind, high = 1, i
        else:
            low = i if value < values[low] else low
            if kind >= 0 and value + swings[i] < values[high]:
                extrema.append(high)
                first = first or 1
                kind, low = -1, i
    if kind:
        extrema.append(high if kind > 0 else low)
    return extrema, first


def _basis(x: np.ndarray, order: int) -> np.ndarray:
    """Return the basis functions 1, cos x, sin x, x, x cos x, x sin x at phases x (...) in rad, (..., 6).

    order: 0 for the functions themselves, 1 or 2 for their first or second derivatives by x.
    """
    c, s, zero, unity = np.cos(x), np.sin(x), np.zeros_like(x), np.ones_like(x)
    if order == 0:
        columns = [unity, c, s, x, x * c, x * s]
    elif order == 1:
        columns = [zero, -s, c, unity, c - x * s, s + x * c]
    else:
        columns = [zero, -c, -s, zero, -2 * s - x * c, 2 * c - x * s]
    return np.stack(columns, axis=-1)


def _solve(columns: np.ndarray, values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Solve linear least squares in w windows; return the coefficients (w, 6) and the pseudo-inverses (w, 6, n).

    columns: design matrices with k ≤ 6 columns, (w, n, k). values: (w, n). Both results are 0 from index k to 5.
    """
    inverse = np.linalg.pinv(columns, rcond=1e-12)
    inverse = np.pad(inverse, ((0, 0), (0, 6 - columns.shape[2]), (0, 0)))
    return (inverse @ values[:, :, None])[:, :, 0], inverse


def refine(
    t: np.ndarray, y: np.ndarray, at: np.ndarray, kind: np.ndarray, period: np.ndarray, half: np.ndarray
) -> np.ndarray:
    """Return time (s), value and noise gain of the extremum nearest to each of the times `at` (k,); shape (k, 3).

    A sinusoid with slowly changing amplitude, phase and midline is fitted to the samples near each time, without
    outliers; with fewer than 9 samples, only the midline changes, and below 6 samples nothing. The noise gain is the
    standard deviation of the value for noise of standard deviation 1 in each sample. A row is NaN if there are fewer
    than five samples or the fit has no such extremum in the window.

    Parameters
    ----------
    t, y
        Times in s and values, each (n,).
    at
        Approximate times of the extrema, s, (k,).
    kind
        1 for a maximum, −1 for a minimum, (k,).
    period
        Period of the oscillation near each of these times, s, (k,).
    half
        Half width of the window of samples around each time, s, (k,). A window with fewer than `LEAST_SAMPLES` samples
        is widened, up to threefold.
    """
    out, width = np.full((at.size, 3), np.nan), half.copy()
    for wider in (1.5, 2.25, 3.0):
        few = np.searchsorted(t, at + width) - np.searchsorted(t, at - width) < LEAST_SAMPLES
        if wider > 2.5:  # at the ends of a record the window would become one-sided
            few &= (at - wider * half >= t[0]) & (at + wider * half <= t[-1])
        width[few] = wider * half[few]
    begins = np.searchsorted(t, at - width)
    for n, same in group_by_size(np.searchsorted(t, at + width) - begins, 5, GRID_POINTS):
        rows = begins[same][:, None] + np.arange(n)
        scale = 2 * np.pi / period[same]
        x = scale[:, None] * (t[rows] - at[same][:, None])
        out[same] = _fit_extrema(x, y[rows], kind[same].astype(float), scale * width[same])
        out[same, 0] = at[same] + out[same, 0] / scale
    return out


def _fit_extrema(x: np.ndarray, values: np.ndarray, kind: np.ndarray, width: np.ndarray) -> np.ndarray:
    """Return phase, value and noise gain of the extremum nearest to phase 0 in each window, (w, 3).

    The extremum is that of a sinusoid fitted to the samples (`refine`); a row is NaN if there is none. The noise gain
    is the standard deviation of the value for noise of standard deviation 1 in each sample. x: phases of the samples in
    rad, (w, n). values: (w, n). kind: 1 for a maximum, −1 for a minimum, (w,). width: half width of the window as a
    phase in rad, (w,).
    """
    n = x.shape[1]
    columns = _basis(x, 0)[:, :, : 6 if n >= 9 else 4 if n >= 6 else 3]
    c, inverse = _solve(columns, values)
    # Fit again without outliers.
    off = np.abs(values - (columns @ c[:, : columns.shape[2], None])[:, :, 0])
    good = off <= 6 * 1.4826 * np.median(off, axis=1, keepdims=True) + 1e-300
    count = good.sum(axis=1)
    again = np.flatnonzero((count >= 2 * columns.shape[2]) & (count < n))
    if again.size:
        good_columns, good_values = columns[again] * good[again][:, :, None], values[again] * good[again]
        c[again], inverse[again] = _solve(good_columns, good_values)
    # Find the sign change of the slope nearest to phase 0, then refine it by Newton's method.
    far = np.minimum(width, 2.0)
    edges = np.stack([np.maximum(x[:, 0], -far) - 0.06, np.minimum(x[:, -1], far) + 0.06])
    grid = np.linspace(edges[0], edges[1], GRID_POINTS, axis=1)
    slope = (_basis(grid, 1) @ c[:, :, None])[:, :, 0]
    here = (slope[:, :-1] * kind[:, None] >= 0) & (slope[:, 1:] * kind[:, None] < 0)
    best = np.argmin(np.where(here, np.abs(grid[:, :-1]), np.inf), axis=1)
    row = np.arange(kind.size)
    step, before, after = grid[:, 1] - grid[:, 0], slope[row, best], slope[row, best + 1]
    fall = before - after
    z = grid[row, best] + np.where(fall != 0, step * before / np.where(fall != 0, fall, 1.0), 0.0)
    for _ in range(3):
        second = np.sum(_basis(z, 2) * c, axis=1)
        turns = second * kind < 0
        move = np.sum(_basis(z, 1) * c, axis=1) / np.where(turns, second, 1.0)
        z = z - np.where(turns, np.clip(move, -0.02, 0.02), 0.0)
    basis = _basis(z, 0)
    gain = np.linalg.norm((basis[:, None, :] @ inverse)[:, 0, :], axis=1)
    extrema = np.stack([z, np.sum(basis * c, axis=1), gain], axis=1)
    extrema[~here.any(axis=1)] = np.nan
    return extrema


def turning_points(t: np.ndarray, y: np.ndarray, period: float, roughness: float = 0.0) -> TurningPoints:
    """Return the turning points of a record, in time order; none (k = 0) if nothing turns.

    An extremum counts if the values then move away from it by half of their range within about a period.
    If this gives fewer than `FEW_TURNS` turning points, a quarter is enough. Each is refined by a local fit (`refine`);
    where this fails, the smoothed value is used, with a noise gain of 1. An end of the record counts as a turning point
    if the fitted curve has its extremum there.

    Parameters
    ----------
    t, y
        Times in s and values, each (n,).
    period
        Approximate period in s.
    roughness
        Standard deviation of the noise of a sample, in the unit of y; if it is small, the fits use narrower windows.
    """
    grid, smooth, a_period = resample(t, y, period)
    swing = 0.5 * np.ptp(neighbourhoods(smooth, int(1.2 * a_period) | 1), axis=1)
    extrema, first = zigzag(smooth, swing)
    if len(extrema) < FEW_TURNS:  # heavy damping: each half cycle is less than half of the one before
        extrema, first = zigzag(smooth, 0.5 * swing)
    if not extrema:
        return TurningPoints(*np.empty((3, 0)))
    spacing = (t[-1] - t[0]) / (t.size - 1)
    index = np.array(extrema)
    at, kind = grid[index], first * (-1.0) ** np.arange(index.size)
    gaps, local = np.diff(at), np.full(at.size, period)
    if gaps.size:  # local period: twice the mean distance to the neighbours
        near = np.concatenate([gaps[:1], 0.5 * (gaps[1:] + gaps[:-1]), gaps[-1:]])
        local = np.clip(2 * near, 0.5 * period, 2 * period)
    # Use the narrowest windows with which noise changes a turning value by less than 0.1 % of the amplitude.
    half = local / 4
    for share in (1 / 6, 1 / 8, 1 / 12):
        samples = 2 * share * local / spacing
        fine = (samples >= 12) & (2.5 * roughness <= 1e-3 * swing[index] * np.sqrt(samples))
        half = np.where(fine, share * local, half)
    points = refine(t, y, at, kind, local, half)
    inside = (at > t[0] + 0.1 * local) & (at < t[-1] - 0.1 * local)
    none = np.isnan(points[:, 0])
    points[none] = np.stack([at, smooth[index], np.ones(at.size)], axis=1)[none]
    times = points[:, 0]
    good = inside | (~none & (times >= t[0] - 0.02 * local) & (times <= t[-1] + 0.02 * local))
    points[:, 0] = np.where(none, times, np.clip(times, t[0], t[-1]))
    return TurningPoints(*points[good].T)


def midpoints(values: np.ndarray) -> np.ndarray:
    """Return the midline of the oscillation at each of k ≥ 3 successive turning values (maxima and minima), (k,).

    It follows from a turning value and its two neighbours by Aitken's formula, which is exact for a geometric decay.
    The first and the last turning value get the midline of their neighbour.
    """
    before, here, after = values[:-2], values[1:-1], values[2:]
    second_difference = before + after - 2 * here
    inner = np.divide(
        before * after - here**2,
        second_difference,
        out=(before + 2 * here + after) / 4,
        where=second_difference != 0,
    )
    return np.concatenate([inner[:1], inner, inner[-1:]])


MAX_CHANGE_RATIO = 0.7
"""A record does not oscillate with a given period if the changes y(t + period) − y(t) have a variance larger than this
multiple of the variance of the changes over half a period. The multiple is 2 for a random walk, 1 for noise, 0.4 for an
oscillation with a damping ratio of 0.3, and 2/3 for two equal modes whose frequencies differ by a fifth."""
HOLE_IN_LAG = 0.25
"""The test whether a record oscillates compares values at the times t and t + lag. A pair is not used if t + lag is in
a gap of the samples that is longer than this fraction of the lag and than 2.5 sampling intervals."""
GAP_PERIODS, GAP_INTERVALS, GAP_MARGIN = 0.5, 5.0, 0.25
"""The samples have a gap where two successive samples are further apart than `GAP_PERIODS` periods and than
`GAP_INTERVALS` median sampling intervals. Turning points within `GAP_MARGIN` periods of a gap are not used
(conventional)."""
TESTED_MARGIN = 1.5
"""The test whether a record oscillates (`reason_not_oscillating`) uses the samples from this many periods before the
first turning point to this many periods after the last one."""


MAX_CACHED = 16
"""Largest number of cached results of a function by `once_per_record`; each is for one record and one set of options.
The oldest results are dropped (conventional)."""
Options = ParamSpec("Options")
Result = TypeVar("Result")


def once_per_record(
    compute: Callable[Concatenate[Signal, Options], Result],
) -> Callable[Concatenate[Signal, Options], Result]:
    """Decorate a function of a signal so that it is computed once; the last `MAX_CACHED` results are cached.

    A cached result is used if the samples, quantity, unit and recording step of the signal and all other arguments are
    equal. The name of the signal may differ, because the same record occurs under several names. The function runs with
    one BLAS thread, which is fastest for its small matrices.
    """
    cache: dict[tuple[object, ...], Result] = {}

    @wraps(compute)
    def of_signal(signal: Signal, *options: Options.args, **named: Options.kwargs) -> Result:
        samples = hashlib.blake2b(np.stack([signal.t, signal.y]).tobytes()).digest()
        key = (samples, signal.quantity, signal.unit, signal.step, *options, *named.items())
        with suppress(KeyError):
            return cache[key]
        with threadpool_limits(1, "blas"):
            result = compute(signal, *options, **named)
        # Remove the oldest results; another thread may have removed one already.
        for oldest in list(cache)[: 1 - MAX_CACHED]:
            cache.pop(oldest, None)
        cache[key] = result
        return result

    return of_signal


def reason_not_oscillating(t: np.ndarray, y: np.ndarray, period: float, noise: float) -> str:
    """Return why values do not oscillate with a given period, as a clause for a message; "" if they do.

    They do not oscillate if their changes over a period have a variance of more than `MAX_CHANGE_RATIO` times that of
    their changes over half a period. The contribution of noise to both variances is subtracted. The result is "" also
    if too few values can be compared.

    Parameters
    ----------
    t, y
        Times in s and values, each (n,).
    period
        Period of the presumed oscillation, s.
    noise
        Standard deviation of the noise of a sample, in the unit of y.
    """
    usual = 2.5 * float(np.median(np.diff(t)))

    def variance_of_changes(lag: float) -> float:
        """Return the variance of the changes y(t + lag) − y(t) of the record's values; lag in s.

        A change is left out if t + lag is in a gap. The result is NaN if fewer than three changes remain.
        """
        after = t + lag
        place = np.clip(np.searchsorted(t, after), 1, t.size - 1)
        first = (after <= t[-1]) & (t[place] - t[place - 1] < max(HOLE_IN_LAG * lag, usual))
        change = np.interp(after[first], t, y) - y[first]
        return float(np.var(change)) if change.size > 2 else float("nan")

    whole = variance_of_changes(period) - 2 * noise**2
    half = variance_of_changes(0.5 * period) - 2 * noise**2
    if np.isfinite(whole) and half > 0 and whole > MAX_CHANGE_RATIO * half:
        return "after a whole period the record is no closer to its earlier values than after half a period"
    return ""


def holes(t: np.ndarray, period: float) -> np.ndarray:
    """Return the gaps in the samples: longer than `GAP_PERIODS` periods, and than `GAP_INTERVALS` sampling intervals.

    Parameters
    ----------
    t
        Times of the samples in s, (n,).
    period
        Period of the oscillation, in s.

    Returns
    -------
    np.ndarray
        Times of the last sample before and of the first sample after each of h gaps, in s, (h, 2).
    """
    gaps = np.diff(t)
    at = np.flatnonzero((gaps > GAP_PERIODS * period) & (gaps > GAP_INTERVALS * np.median(gaps)))
    return np.stack([t[at], t[at + 1]], axis=1)


def without_gap_edges(turns: TurningPoints, t: np.ndarray, period: float) -> TurningPoints:
    """Return the turning points without those in or near a gap of the samples (`holes`).

    Near means within `GAP_MARGIN` periods. There, interpolation across the gap may create turning points that do not
    exist. t: times of the samples in s, (n,). period: period of the oscillation in s.
    """
    good = np.ones(turns.times.size, bool)
    for a, b in holes(t, period):
        good &= (turns.times < a - GAP_MARGIN * period) | (turns.times > b + GAP_MARGIN * period)
    return TurningPoints(turns.times[good], turns.values[good], turns.gain[good])


@dataclass(frozen=True)
class Features(FeatureValues):
    """Features of a record, with its turning points. The scalar features are those of `FeatureValues`.

    Attributes
    ----------
    turning_times, turning_values
        Times in s and values (in the unit of the record) of the turning points (maxima and minima), each (k,). Only the
        longest run of regular turning points is used (`regular_runs`).
    turning_amplitudes
        Distance of the turning values from the midline, in the unit of the record, (k,).
    swing_times, swing_sizes
        Middle time in s and half of the range (maximum minus minimum, in the unit of the record) of each half cycle,
        each (m,). In addition to the longest run, runs that are separated from it only by gaps in the samples are used.
    """

    turning_times: np.ndarray
    turning_values: np.ndarray
    turning_amplitudes: np.ndarray
    swing_times: np.ndarray = field(default_factory=lambda: np.empty(0))
    swing_sizes: np.ndarray = field(default_factory=lambda: np.empty(0))


def _longest(runs: list[TurningPoints]) -> TurningPoints:
    return max(runs, key=lambda run: run.times.size, default=TurningPoints(*np.empty((3, 0))))


def _regular_runs(t: np.ndarray, y: np.ndarray, period: float) -> list[TurningPoints]:
    """Return the runs of regular turning points (`regular_runs`) of an oscillation with about this period in s."""
    noise = roughness(t, y, period)
    return regular_runs(without_gap_edges(turning_points(t, y, period, noise), t, period), noise)


@once_per_record
def features(signal: Signal) -> Features:
    """Measure the features of a signal: period, amplitude, noise, turning points and others.

    The amplitudes at the first and at the last sample are those of the displacement, also for a recorded velocity or
    acceleration; turning points, swings and noise are those of the recorded quantity. Raises Refusal, with the reason,
    if the signal has fewer than ten samples or does not oscillate.
    """
    t, y = np.asarray(signal.t, float), np.asarray(signal.y, float)
    if t.size < 10:
        raise Refusal(f"the record has {t.size} samples; at least 10 are needed")
    if np.ptp(y) == 0:
        raise Refusal("the record is constant: nothing oscillates")
    # Rough period, with which the turning points are found.
    period, share = coarse_period(t, y)
    runs = _regular_runs(t, y, period)
    turns = _longest(runs)
    if turns.times.size < ENOUGH_TURNS:  # this period may be wrong
        for other, other_share in coarse_periods(t, y)[1:]:
            others = _regular_runs(t, y, other)
            longest = _longest(others)
            if other_share < LEAST_SHARE or longest.times.size <= turns.times.size:
                continue
            if turns.times.size < 3 or np.ptp(longest.values) > LEAST_RANGE * np.ptp(turns.values):
                period, share, runs, turns = other, other_share, others, longest
    if share < LEAST_SHARE:
        raise Refusal("no oscillation stands out of the noise")
    if turns.times.size < 3:
        raise Refusal("fewer than three turning points between its ends are regular and above the noise")
    middle, sizes = midpoints(turns.values), _sizes(turns)
    # The final period and noise.
    period = mean_period(turns, sizes)
    noise = roughness(t, y, period)
    near = TESTED_MARGIN * period
    inside = (t >= turns.times[0] - near) & (t <= turns.times[-1] + near)
    if reason := reason_not_oscillating(t[inside], y[inside], period, noise):
        raise Refusal(f"no oscillation is found: {reason}")
    pieces = _join_across_holes(runs, turns, t, period)
    first, last = pieces[0], pieces[-1]
    # Fractions of a cycle before the first and after the last turning point, at most half a cycle each.
    before = min((first.times[0] - t[0]) / (2 * (first.times[1] - first.times[0])), 0.5)
    after = min((t[-1] - last.times[-1]) / (2 * (last.times[-1] - last.times[-2])), 0.5)
    cycles = (turns.times.size - 1) / 2 if first is last else (last.times[-1] - first.times[0]) / period
    frequency = 2 * np.pi / period
    order = DERIVATIVES[signal.quantity]
    return Features(
        rest=float(np.median(middle[middle.size // 2 :])) if order == 0 else 0.0,
        amplitude=extrapolate_to_start(first.times - t[0], _sizes(first)) / frequency**order,
        final_amplitude=extrapolate_to_start((t[-1] - last.times)[::-1], _sizes(last)[::-1])
        / frequency**order,
        frequency=frequency,
        period=period,
        cycles=float(cycles + before + after),
        samples_per_cycle=float(period * (t.size - 1) / (t[-1] - t[0])),
        roughness=noise,
        turning_times=turns.times,
        turning_values=turns.values,
        turning_amplitudes=sizes,
        swing_times=np.concatenate([0.5 * (p.times[:-1] + p.times[1:]) for p in pieces]),
        swing_sizes=np.concatenate([0.5 * np.abs(np.diff(p.values)) for p in pieces]),
    )


def regular_runs(turns: TurningPoints, noise: float) -> list[TurningPoints]:
    """Return the runs of successive turning points that are regular in time and stand out of the noise, in time order.

    In a run, the time between two successive turning points is 0.7 (at the ends of the record 0.85) to 1.5 times its
    local median. Their values differ by more than four standard deviations of the noise. noise: standard deviation of
    the noise of a sample, in the unit of the values. Fewer than three turning points are returned as one run, untested.
    """
    if turns.times.size < 3:
        return [turns]
    gaps = np.diff(turns.times)
    ranges = np.abs(np.diff(turns.values))
    typical = local_median(gaps)
    clear = ranges > 4 * noise * np.hypot(turns.gain[:-1], turns.gain[1:])
    least = np.full(gaps.size, 0.7)
    least[[0, -1]] = 0.85  # noise often turns at the very end of a record
    good = (gaps > least * typical) & (gaps < 1.5 * typical) & clear
    return [turns.cut(a, b + 1) for a, b in true_runs(good)]


def _join_across_holes(
    runs: list[TurningPoints], turns: TurningPoints, t: np.ndarray, period: float
) -> list[TurningPoints]:
    """Return the run `turns` and the runs before and after it that are separated only by gaps in the samples.

    runs: all runs of regular turning points, in time order, as is the result. turns: one of these runs. t, period:
    times of the samples, (n,), and period of the oscillation, in s. Runs of fewer than three turning points are left
    out.
    """
    missing, pieces = holes(t, period), [turns]

    def follows(a: TurningPoints, b: TurningPoints) -> bool:
        """Return whether run b follows run a, with less than two periods between them that are not in gaps."""
        inside = missing[(missing[:, 0] > a.times[-1]) & (missing[:, 1] < b.times[0])]
        gap = b.times[0] - a.times[-1]
        return bool(gap > 0 and np.sum(inside[:, 1] - inside[:, 0]) > gap - 2 * period)

    runs = [run for run in runs if run.times.size >= 3]
    for run in runs[::-1]:
        if follows(run, pieces[0]):
            pieces.insert(0, run)
    for run in runs:
        if follows(pieces[-1], run):
            pieces.append(run)
    return pieces


def _sizes(turns: TurningPoints) -> np.ndarray:
    return np.abs(turns.values - midpoints(turns.values))


def mean_period(turns: TurningPoints, sizes: np.ndarray) -> float:
    """Return the mean period in s, from a weighted line through the times of the turning points against their number.

    This period does not depend on an offset of the record. The first and the last of five or more turning points are
    left out, because they may be at an end of the record.

    Parameters
    ----------
    turns
        The k turning points.
    sizes
        Distance of each turning point from the midline, in the unit of the values, (k,). The weight is this distance
        divided by the noise gain.
    """
    used = slice(1, -1) if sizes.size >= 5 else slice(None)
    number, weights = np.arange(sizes.size), sizes / turns.gain
    return 2 * float(np.polyfit(number[used], turns.times[used], 1, w=weights[used])[0])


def extrapolate_to_start(times: np.ndarray, sizes: np.ndarray) -> float:
    """Extrapolate amplitudes to time 0, by a polynomial fitted to the logarithms of the first eight (or fewer) of them.

    The degree of the polynomial is 1 for up to five amplitudes, else 2.

    Parameters
    ----------
    times, sizes
        Times in s and amplitudes at successive turning points, each (k,). If k < 3, or if the first time is ≤ 0 or
        later than 0.7 periods (times[2] − times[0]), the first amplitude is returned.

    Returns
    -------
    float
        The amplitude at time 0, limited to the range from half of to twice the first amplitude.
    """
    if sizes.size < 3 or times[0] <= 0 or times[0] > 0.7 * (times[2] - times[0]):
        return float(sizes[0])
    n = min(sizes.size, 8)
    line = np.polynomial.Polynomial.fit(times[:n], np.log(np.maximum(sizes[:n], 1e-300)), 1 if n < 6 else 2)
    return float(np.clip(np.exp(line(0.0)), 0.5 * sizes[0], 2.0 * sizes[0]))
