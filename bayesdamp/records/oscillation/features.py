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

from bayesdamp.records.oscillation.noise import roughness
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
    swing_times, swing_sizes
        Middle time in s and half of the range (maximum minus minimum) of each half cycle, each (m,); of the longest
        regular run, and of runs that only gaps in the samples separate from it.
    """

    turning_times: np.ndarray
    turning_values: np.ndarray
    turning_amplitudes: np.ndarray
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


def mean_period(turns: TurningPoints, sizes: np.ndarray) -> float:
    """Return the period in s, from a weighted line through the times of the turning points against their number.

    An offset of the record does not shift its turning points. The first and the last of five or more are left out,
    because they may be at an end of the record.

    Parameters
    ----------
    turns
        The k turning points.
    sizes
        Distance of each from the midline, in the unit of their values, (k,). A turning point far from the midline and
        with a small noise gain has the most weight.
    """
    used = slice(1, -1) if sizes.size >= 5 else slice(None)
    number, weights = np.arange(sizes.size), sizes / turns.gain
    return 2 * float(np.polyfit(number[used], turns.times[used], 1, w=weights[used])[0])


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
