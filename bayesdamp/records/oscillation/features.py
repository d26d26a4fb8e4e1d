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

from bayesdamp.records.oscillation.noise import group_by_size, roughness
from bayesdamp.records.oscillation.spectrum import LEAST_SHARE, coarse_period
from bayesdamp.records.oscillation.turning import (
    TurningPoints,
    local_median,
    midpoints,
    true_runs,
    turning_points,
)
from bayesdamp.types import DERIVATIVES, FeatureValues, Refusal, Signal

MAX_CHANGE_RATIO = 0.7
"""A record does not oscillate if the variance of the changes of its values over a period is larger than this fraction
of that over half a period. The fraction is 2 for a random walk, 1 for noise, 0.4 for an oscillation with a damping
ratio of 0.3, and 2/3 for two equal modes whose frequencies differ by a fifth."""
HOLE_IN_LAG = 0.25
"""To test whether a record oscillates, changes of the values from each time t to t + lag are compared. A change is not
used if t + lag is in a gap of the samples that is longer than this fraction of the lag."""
GAP_PERIODS, GAP_INTERVALS, GAP_MARGIN = 0.5, 5.0, 0.25
"""Samples are missing (a gap) where the time between two samples is longer than `GAP_PERIODS` periods and longer than
`GAP_INTERVALS` median sampling intervals. Turning points within `GAP_MARGIN` periods of a gap are not used
(conventional)."""
TESTED_MARGIN = 1.5
"""The test whether a record oscillates (`reason_not_oscillating`) uses the samples between the first and the last
turning point, and up to this many periods before and after these."""


MAX_CACHED = 16
"""Number of results of a function that are cached, one for each record and set of options; the oldest are dropped
(conventional)."""
Options = ParamSpec("Options")
Result = TypeVar("Result")


def once_per_record(
    compute: Callable[Concatenate[Signal, Options], Result],
) -> Callable[Concatenate[Signal, Options], Result]:
    """Decorate a function of a signal so that its last `MAX_CACHED` results are cached.

    The key of a result consists of the samples, quantity, unit and recording step of the signal and of the other
    arguments, but not of the signal's name, because the same record occurs under several names. The function runs with
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

    They do not if the variance of their changes over a period is more than `MAX_CHANGE_RATIO` times that over half a
    period, each without the contribution of noise. The result is "" also if too few values can be compared.

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
        """Return the variance of the changes y(t + lag) − y(t); lag in s.

        Changes with t + lag in a gap are left out. The result is NaN if fewer than three changes remain.
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
    """Return the gaps in the samples: longer than `GAP_PERIODS` periods and `GAP_INTERVALS` median sampling intervals.

    Parameters
    ----------
    t
        Times of the samples in s, (n,).
    period
        Period of the oscillation, in s.

    Returns
    -------
    np.ndarray
        Start and end of each gap, in s, (h, 2).
    """
    gaps = np.diff(t)
    at = np.flatnonzero((gaps > GAP_PERIODS * period) & (gaps > GAP_INTERVALS * np.median(gaps)))
    return np.stack([t[at], t[at + 1]], axis=1)


def without_gap_edges(turns: TurningPoints, t: np.ndarray, period: float) -> TurningPoints:
    """Return the turning points without those in a gap of the samples (`holes`) or within `GAP_MARGIN` periods of one.

    Interpolation across a gap would create false ones. t: times of the samples in s, (n,). period: period of the
    oscillation in s.
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
        Times in s and values (in the unit of the record) of the turning points (alternating maxima and minima) in the
        longest regular run (`regular_runs`), each (k,).
    turning_amplitudes
        Distance of the turning values from the midline, (k,).
    crossing_times
        Times in s at which the record crosses its midline, between successive turning points, (k − 1,); the middle
        between these where no crossing is found.
    swing_times, swing_sizes
        Middle time in s and half of the range (maximum minus minimum) of each half cycle, each (m,); of the longest
        regular run, and of runs that only gaps in the samples separate from it.
    """

    turning_times: np.ndarray
    turning_values: np.ndarray
    turning_amplitudes: np.ndarray
    crossing_times: np.ndarray
    swing_times: np.ndarray = field(default_factory=lambda: np.empty(0))
    swing_sizes: np.ndarray = field(default_factory=lambda: np.empty(0))


@once_per_record
def features(signal: Signal) -> Features:
    """Return the features of a signal: period, amplitude, noise, turning points and others.

    Raises Refusal with a reason if the signal has fewer than ten samples or does not oscillate.
    """
    t, y = np.asarray(signal.t, float), np.asarray(signal.y, float)
    if t.size < 10:
        raise Refusal(f"the record has {t.size} samples; at least 10 are needed")
    if np.ptp(y) == 0:
        raise Refusal("the record is constant: nothing oscillates")
    # Rough period and noise, with which the turning points are found.
    period, share = coarse_period(t, y)
    if share < LEAST_SHARE:
        raise Refusal("no oscillation stands out of the noise")
    noise = roughness(t, y, period)
    runs = regular_runs(without_gap_edges(turning_points(t, y, period, noise), t, period), noise)
    turns = max(runs, key=lambda run: run.times.size, default=TurningPoints(*np.empty((3, 0))))
    if turns.times.size < 3:
        raise Refusal("no oscillation is found: fewer than three turning points stand out of the noise")
    middle = midpoints(turns.values)
    sizes = _sizes(turns)
    crossings, sharp = crossing_times(t, y, turns, middle)
    # The final period and noise.
    period = mean_period(crossings, sharp, turns.times)
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
        crossing_times=crossings,
        swing_times=np.concatenate([0.5 * (p.times[:-1] + p.times[1:]) for p in pieces]),
        swing_sizes=np.concatenate([0.5 * np.abs(np.diff(p.values)) for p in pieces]),
    )


def regular_runs(turns: TurningPoints, noise: float) -> list[TurningPoints]:
    """Return the runs of turning points that are regular in time and stand out of the noise, in time order.

    In a run, the times between successive turning points are 0.7 (0.85 at the ends of the record) to 1.5 times their
    local median, and the differences of their values exceed four standard deviations. noise: standard deviation of a
    sample, in the unit of the values. Fewer than three turning points are returned as one run, untested.
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
    """Return `turns` and the runs before and after it that are separated only by gaps in the samples, in time order.

    turns: one of the runs. t, period: times of the samples, (n,), and the period, in s. Runs of fewer than three
    turning points are left out.
    """
    missing = holes(t, period)
    pieces = [turns]

    def follows(a: TurningPoints, b: TurningPoints) -> bool:
        """Return whether run b follows run a and, except for gaps, less than two periods are between them."""
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


def _half_cycle_basis(x: np.ndarray) -> np.ndarray:
    """Return the basis 1, sin πx, cos πx − 1, x of a half cycle at x (...), as an array (..., 4).

    x is −1/2 at the turning point before and 1/2 at that after the half cycle.
    """
    return np.stack([np.ones_like(x), np.sin(np.pi * x), np.cos(np.pi * x) - 1, x], axis=-1)


def crossing_times(
    t: np.ndarray, y: np.ndarray, turns: TurningPoints, middle: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return the times at which a record crosses its midline, between successive turning points.

    A sinusoid with a slow drift is fitted to the samples in the middle half of each half cycle.

    Parameters
    ----------
    t, y
        Times in s and values, each (n,).
    turns
        The k turning points.
    middle
        Midline at each of them, (k,).

    Returns
    -------
    tuple of np.ndarray
        Times in s, and their weights (squared range of the half cycle times the number of samples), each (k − 1,).
        Where no crossing is found, the time is the middle of the half cycle, and the weight 0.
    """
    gaps, weights = np.diff(turns.times), np.zeros(turns.times.size - 1)
    centres = (turns.times[:-1] + turns.times[1:]) / 2
    levels = (middle[:-1] + middle[1:]) / 2
    half = 0.25 * gaps
    # Use wider windows where there are few samples.
    few = np.searchsorted(t, centres + half) - np.searchsorted(t, centres - half) < 4
    half = np.where(few, 0.6 * gaps, half)
    begins = np.searchsorted(t, centres - half)
    sizes = np.searchsorted(t, centres + half) - begins
    times = centres.copy()
    grid = np.linspace(-0.4, 0.4, 801)
    for n, same in group_by_size(sizes, 3, grid.size):
        rows = begins[same][:, None] + np.arange(n)
        x = (t[rows] - centres[same][:, None]) / gaps[same][:, None]
        columns = _half_cycle_basis(x)[:, :, : 4 if n > 5 else 2]
        values = (y[rows] - levels[same][:, None])[:, :, None]
        c = (np.linalg.pinv(columns, rcond=1e-10) @ values)[:, :, 0]
        curve = c @ _half_cycle_basis(grid)[:, : c.shape[1]].T
        # The sign change of the fitted curve that is nearest to the middle, by linear interpolation on the grid.
        changes = np.signbit(curve[:, 1:]) != np.signbit(curve[:, :-1])
        crosses = np.flatnonzero(changes.any(axis=1))
        j = np.argmin(np.where(changes[crosses], np.abs(grid[:-1]), np.inf), axis=1)
        before, after = curve[crosses, j], curve[crosses, j + 1]
        z = grid[j] - before * (grid[1] - grid[0]) / (after - before)
        which = same[crosses]
        times[which] += z * gaps[which]
        weights[which] = np.diff(turns.values)[which] ** 2 * n
    return times, weights


def mean_period(crossings: np.ndarray, weights: np.ndarray, turning_times: np.ndarray) -> float:
    """Return the period in s, from a weighted line through the crossings against their number.

    Upward crossings may have a constant delay against downward ones, because the midline is not known exactly. With
    fewer than four positive weights, it is twice the mean distance of the crossings (or of the turning points, if there
    are fewer than three crossings).

    Parameters
    ----------
    crossings, weights
        Times in s at which the record crosses its midline, and their weights, each (k,).
    turning_times
        Times in s of the turning points, (k + 1,).
    """
    if np.count_nonzero(weights) < 4:
        ready = crossings if crossings.size >= 3 else turning_times
        return float(2 * (ready[-1] - ready[0]) / (ready.size - 1))
    k = np.arange(crossings.size)
    columns = np.stack([np.ones(k.size), k / 2, (-1.0) ** k], axis=1)
    root = np.sqrt(weights / weights.max())
    return float(np.linalg.lstsq(columns * root[:, None], crossings * root, rcond=None)[0][1])


def extrapolate_to_start(times: np.ndarray, sizes: np.ndarray) -> float:
    """Extrapolate amplitudes to time 0, by a polynomial fitted to the logarithms of the first eight or fewer.

    Its degree is 1 for up to five amplitudes, else 2.

    Parameters
    ----------
    times, sizes
        Times in s and amplitudes at successive turning points, each (k,). If k < 3, or if the first time is ≤ 0 or
        later than 0.7 periods (times[2] − times[0]), the first amplitude is returned.

    Returns
    -------
    float
        The amplitude at time 0, limited to half and twice the first amplitude.
    """
    if sizes.size < 3 or times[0] <= 0 or times[0] > 0.7 * (times[2] - times[0]):
        return float(sizes[0])
    n = min(sizes.size, 8)
    line = np.polynomial.Polynomial.fit(times[:n], np.log(np.maximum(sizes[:n], 1e-300)), 1 if n < 6 else 2)
    return float(np.clip(np.exp(line(0.0)), 0.5 * sizes[0], 2.0 * sizes[0]))
