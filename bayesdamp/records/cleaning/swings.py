"""Find the stretches of swings that may be one free decay, and test whether a swing continues the later ones.

A swing is the motion from one turning point to the next. A stretch is in phase, clear of the noise, and without a jump
of the amplitude. No damping law is assumed.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field
from itertools import pairwise
from typing import Literal

import numpy as np
import scipy  # loads its modules when they are used
from scipy.ndimage import median_filter, uniform_filter1d
from scipy.special import stdtrit

from bayesdamp.records.oscillation.turning import Turning, local_median, true_runs
from bayesdamp.types import InputError

Reason = Literal["period", "amplitude", "midline", "shape"]

RISE = 0.25
"""Share by which a range must grow within a cycle to be a second release or a push; a beat grows as it fell."""
FALL = 0.35
"""Share by which a range must fall within a cycle to be a hand that stops it, unless it fell so before."""
JUMP = 3.0
"""How many times larger than in the cycles before it such a step must be."""
HALF = 4
"""Swings on either side of a break in the rate of decay, twice."""
BREAK = 0.4
"""Share by which the rate of decay must change at a break beyond what any power of the amplitude explains."""
POWER = 1.2
"""The rate of decay varies at most with this power of the amplitude, up or down: −1 is dry friction, 1 is drag."""
LATER = 10
"""Later swings with which a swing is compared."""
CHANCE = 1e-3
"""Probability that chance alone puts a swing off the curve of the later ones."""
TIMES = 5.0
"""Largest misfit of a swing, in usual misfits of the later swings."""
PERIOD, MIDLINE, SHAPE = 0.02, 0.03, 0.01
"""What a swing may be off where the later ones do not scatter: shares of the period, of the range, of the amplitude."""
ALIKE = 0.9
"""Largest fall of the log range within which the rate of decay still predicts that of the largest swings: with dry
friction it grows without bound towards the end."""
STILL = 0.02
"""Share of the first swing by which a record that a hand moves changes at least."""
ERRORS = 4.0
"""Standard errors below which a movement or a turning value may be noise, which itself turns at one or two."""
TEMPLATE = 0.02
"""Share of the range by which a swing may differ from a later one that is scaled to its size and period."""


def stretches(t: np.ndarray, turns: Turning, floor: float) -> list[tuple[int, int]]:
    """Find the stretches of swings that may be a free decay.

    Parameters
    ----------
    t
        Times of the samples in s, (n,).
    turns
        The turning points.
    floor
        What the distance of a turning point from the midline must exceed.

    Returns
    -------
    list of tuple
        First turning point and last + 1 of stretches of three or more, in their order in time.
    """
    spans: list[tuple[int, int]] = []
    for first, last in _runs_in_phase(t, turns, floor):  # swings first .. last - 1
        # A spike or a gap spoils one turning point, and with it two ranges.
        ranges = median_filter(np.abs(np.diff(turns.values[first : last + 1])), 5, mode="nearest")
        # Swings between turning points that span others, of which there is no sample.
        gaps = np.diff(turns.times[first : last + 1])
        across = np.flatnonzero(gaps > 1.6 * np.median(gaps))

        for a, b in pairwise([0, *_without_holes(_jumps(ranges, floor), across), ranges.size]):
            breaks = (a + c for c in _breaks(ranges[a:b], floor) if a + c < b)
            cuts = [a, *_without_holes(breaks, across), b]
            cuts = sorted({c + e for c, d in pairwise(cuts) for e in _ends_of_fall(ranges[c:d], floor)})
            spans += [(first + c, first + d + 1) for c, d in pairwise(cuts) if d - c >= 2]
    return spans


def _without_holes(marks: Iterable[int], across: np.ndarray) -> list[int]:
    """Return the marks that no hole explains: across it the range falls by what the swings in it lose."""
    return [m for m in marks if not np.any(np.abs(across - m) <= 2 * HALF)]


def worth(turns: Turning, stretch: tuple[int, int]) -> float:
    """Return how informative a stretch is about the damping.

    This is its number of swings times the log of the ratio of amplitudes that it spans.
    """
    ranges = np.abs(np.diff(turns.values[slice(*stretch)]))
    few = min(2, ranges.size)
    fallen = np.log(max(float(ranges[:few].max() / ranges[-few:].min()), 1.0))
    return ranges.size * (0.02 + float(fallen))


def _runs_in_phase(t: np.ndarray, turns: Turning, floor: float) -> list[tuple[int, int]]:
    """Return (first, last + 1) swings of runs that are in phase and clear of the noise.

    A run continues across what a spike or a gap spoils.
    """
    gaps, ranges = np.diff(turns.times), np.abs(np.diff(turns.values))
    if gaps.size == 0:
        return []
    typical = local_median(gaps)
    width = np.concatenate([typical[:1], typical]) / 4
    begin, end = np.maximum(turns.times - width, t[0]), np.minimum(turns.times + width, t[-1])
    samples = np.searchsorted(t, end, side="right") - np.searchsorted(t, begin)
    sampled = samples >= 0.75 * (end - begin) / float(np.median(np.diff(t))) - 1
    clear = (ranges > 2 * floor) & (median_filter(ranges, 3, mode="nearest") > 2 * floor)
    good = (gaps > 0.7 * typical) & (gaps < 1.6 * typical) & clear & sampled[1:] & sampled[:-1]
    runs: list[tuple[int, int]] = []

    def continues(stop: int, a: int, b: int) -> bool:
        """Return whether swings a to b - 1 continue the run up to `stop`: a spoiled turning point, or a hole."""
        before, after = float(ranges[stop - 1]), float(ranges[a])
        begin, end = float(turns.times[stop]), float(turns.times[a])
        swing = float(turns.times[stop] - turns.times[stop - 1])
        samples = np.searchsorted(t, end) - np.searchsorted(t, begin)
        if samples < 0.7 * (end - begin) * (t.size - 1) / (t[-1] - t[0]) and end - begin > 1.2 * swing:
            return after <= 1.05 * before + 2 * floor
        swings = (end - begin) / swing
        in_phase = abs(swings - round(swings)) < 0.3 and swings < 4.5
        near = 0.6 * before - 2 * floor <= after <= 1.25 * before + 2 * floor
        return b - a >= 3 and a - stop <= 3 and in_phase and near

    for a, b in true_runs(good):
        if runs and b - a >= 2 and continues(runs[-1][1], a, b):
            runs[-1] = (runs[-1][0], b)
        else:
            runs.append((a, b))
    return runs


def _ends_of_fall(ranges: np.ndarray, floor: float) -> list[int]:
    """Return 0, the number of swings (k,), and between them where their ranges begin to fall or rise again.

    A free decay neither begins nor ends with swings that grow; the ringing of a filter about a hit does.
    """
    if ranges.size == 0:
        return [0]
    top = int(np.argmax(ranges))
    low = top + int(np.argmin(ranges[top:]))
    marks = [0]
    if ranges[top] - ranges[0] > max(RISE * ranges[0], 4 * floor):
        marks.append(top)
    if ranges[-1] - ranges[low] > max(RISE * ranges[low], 4 * floor):
        marks.append(low + 1)
    return [*marks, ranges.size]


def _jumps(ranges: np.ndarray, floor: float) -> list[int]:
    """Return the swings at which a new stretch begins because the range (k,) jumps."""
    change = ranges[2:] - ranges[:-2]
    rises = change > np.maximum(RISE * ranges[:-2], 4 * floor)
    falls = -change > np.maximum(FALL * ranges[:-2], 4 * floor)
    marks: list[int] = []
    for i in np.flatnonzero(rises | falls).tolist():
        usual = np.abs(change[max(i - 4, 0) : max(i - 1, 0)])
        if usual.size == 0 and change[i] < 0:
            continue
        if abs(change[i]) > JUMP * float(usual.max(initial=0.0)):
            at = i + 2 if change[i] > 0 else i + 1
            if not marks or at - marks[-1] > 1:
                marks.append(at)
            elif change[i] > 0:
                marks[-1] = at
    return marks


def _breaks(ranges: np.ndarray, floor: float) -> list[int]:
    """Return the swings at which the rate of decay changes suddenly, by more than the fall of the amplitude explains.

    The slopes of the log range in two halves before and two after are compared: in a beat they change equally.
    """
    if ranges.size < 4 * HALF:
        return []
    logs, n = np.log(ranges), np.arange(HALF) - (HALF - 1) / 2
    windows = np.lib.stride_tricks.sliding_window_view(logs, HALF)
    size = windows.mean(axis=1)
    rate = -(windows @ n) / np.sum(n**2)
    scatter = np.sqrt(np.mean((windows - size[:, None] + rate[:, None] * n) ** 2, axis=1))
    blur = np.hypot(scatter, 0.5 * floor / ranges[: size.size]) / np.sqrt(np.sum(n**2))
    k = np.arange(HALF, ranges.size - 3 * HALF + 1)
    parts = (
        k + np.arange(-HALF, 3 * HALF, HALF)[:, None]
    )  # the halves begin at k - HALF, k, k + HALF, k + 2 HALF
    rates, sizes = rate[parts], size[parts]
    sd = np.sqrt(np.mean(blur[parts] ** 2, axis=0))

    def unexplained(i: int, j: int) -> np.ndarray:
        """Return what the fall of the amplitude does not explain of the change of the rate from part i to part j."""
        factor = np.exp(POWER * np.abs(sizes[i] - sizes[j]))
        low, high = np.sort([rates[j] / factor, rates[j] * factor], axis=0)
        return np.maximum(np.maximum(low - rates[i], rates[i] - high), 0.0)

    def misfit(part: np.ndarray, degree: int) -> float:
        columns = np.arange(part.size)[:, None] ** np.arange(degree + 1)
        return float(np.sum((part - columns @ np.linalg.lstsq(columns, part, rcond=None)[0]) ** 2))

    def corner(a: int, b: int) -> int:
        """Return the first swing after a break between swings a and b: where a line and a parabola fit best."""
        corners = range(a + HALF + 1, b - HALF)
        return min(corners, key=lambda m: misfit(logs[a:m], 1) + misfit(logs[m:b], 2))

    inner = np.maximum(unexplained(0, 1), unexplained(2, 3))
    clear = ranges[k + 3 * HALF - 1] > 16 * floor
    limit = np.maximum.reduce([BREAK * np.maximum(np.abs(rates[1]), np.abs(rates[2])), 6 * sd, 2.5 * inner])
    # A spoiled turning point bends the curve for a few swings; a break lasts.
    excess = np.where(clear, np.minimum(unexplained(1, 2), unexplained(0, 3)) - limit, -1.0)
    marks: list[int] = []
    while (best := int(np.argmax(excess))) >= 0 and excess[best] > 0:
        marks.append(corner(int(k[best]) - HALF, int(k[best]) + 3 * HALF) + 1)
        excess[max(best - 2 * HALF, 0) : best + 2 * HALF + 1] = -1.0
    return sorted(marks)


@dataclass
class Swings:
    """The swings of a stretch of turning points (k,): ranges and gaps (k − 1,), midlines (k − 2,).

    Attributes
    ----------
    t, y
        Times in s and values of the samples, each (n,).
    turns
        The turning points.
    floor
        What noise and rounding can do to one swing, in the unit of y.
    """

    t: np.ndarray
    y: np.ndarray
    turns: Turning
    floor: float
    _misfits: dict[int, tuple[float, float]] = field(default_factory=dict)

    def __post_init__(self) -> None:
        self.gaps = np.diff(self.turns.times)
        self.ranges = np.abs(np.diff(self.turns.values))
        values = self.turns.values
        self.midlines = (values[:-2] + 2 * values[1:-1] + values[2:]) / 4

    def breaks(self, i: int) -> Reason | None:
        """Return in what swing i does not continue the later ones.

        None where it does, or where they are too few to tell.
        """
        later = self.gaps[i + 1 : i + 1 + LATER]
        if later.size >= 2:  # a swing that a hand ends does not last as long as the later ones predict
            predicted, slack = _predict_before(later)
            usual = float(np.median(later))
            blur = 0.3 * self.floor / self.ranges[i] * usual
            share = PERIOD if later.size >= 6 else 2.5 * PERIOD
            if not abs(self.gaps[i] - predicted) <= max(share * usual, blur) + slack:
                return "period"
        later = self.midlines[i + 1 : i + 1 + LATER]
        if later.size >= 3:
            predicted, slack = _predict_before(later)
            if not abs(self.midlines[i] - predicted) <= max(MIDLINE * self.ranges[i], self.floor) + slack:
                return "midline"
        return None if self._is_like_later(i, self.misfit(i)) else "shape"

    def opens_like_later(self, begin: float) -> bool:
        """Return whether the samples from begin (s) to the first turning point have no more misfit than the swings."""
        end = float(self.turns.times[0])
        samples = int(np.count_nonzero((self.t >= begin) & (self.t <= end)))
        if samples < 8 or end - begin < 0.3 * float(self.gaps[0]):
            return True
        return self._is_like_later(-1, self._fit_misfit(begin, end, self.gaps[0]))

    def _is_like_later(self, i: int, misfit: tuple[float, float]) -> bool:
        later = np.array([self.misfit(j) for j in range(i + 1, min(i + 1 + LATER, self.gaps.size))])
        usual = np.median(later, axis=0) if later.size else np.zeros(2)
        limit = np.maximum(TIMES * usual, np.array([1, 2]) * SHAPE * 0.5 * self.ranges[max(i, 0)])
        return bool(np.all(misfit <= np.maximum(limit, np.array([0.3, 0.6]) * self.floor)))

    def misfit(self, i: int) -> tuple[float, float]:
        """Return (rms, largest) distance of the samples of swing i from a slowly changing sinusoid and overtone."""
        if i not in self._misfits:
            begin, end = self.turns.times[i : i + 2].tolist()
            self._misfits[i] = self._fit_misfit(begin, end, self.gaps[i])
        return self._misfits[i]

    def _fit_misfit(self, begin: float, end: float, half: float) -> tuple[float, float]:
        a, b = np.searchsorted(self.t, (begin - 1e-12, end + 1e-12))
        every = max(int(b - a) // 200, 1)
        t, y = self.t[a:b:every], self.y[a:b:every]
        if t.size < 3:
            return 0.0, 0.0
        x = np.pi * (t - (begin + end) / 2) / half
        c, s = np.cos(x), np.sin(x)
        columns = np.stack([np.ones_like(x), c, s, x, x * c, x * s, np.cos(2 * x), np.sin(2 * x)], axis=1)
        columns = columns[:, : max(min(8, t.size // 2), 1)]
        rest = y - columns @ np.linalg.lstsq(columns, y, rcond=1e-8)[0]
        free = max(t.size - columns.shape[1], 1)
        return float(np.sqrt(np.sum(rest**2) / free)), float(np.abs(rest).max())


def _predict_before(later: np.ndarray) -> tuple[float, float]:
    """Predict the value before the first of later ones (k ≥ 2,) by a smooth curve through these.

    Swings up and down may differ. Return the value, and the half width of the prediction interval of least squares
    outside of which a value is with probability CHANCE.
    """
    x = np.arange(later.size + 1.0)
    columns = x[:, None] ** np.arange(3 if later.size >= 6 else 2 if later.size >= 3 else 1)
    if later.size >= 8:
        columns = np.hstack([columns, (-1.0) ** x[:, None]])
    inverse = np.linalg.pinv(columns[1:])
    c = inverse @ later
    free = later.size - columns.shape[1]
    variance = float(np.sum((later - columns[1:] @ c) ** 2)) / free
    weights = columns[0] @ inverse
    slack = float(stdtrit(free, 1 - CHANCE / 2)) * np.sqrt(variance * (1 + float(weights @ weights)))
    return float(columns[0] @ c), min(slack, 2 * float(np.ptp(later))) if free < 2 else slack


@dataclass(frozen=True)
class Reach:
    """How far samples before a turning point agree with a later swing that is scaled to the one before it.

    Attributes
    ----------
    at
        The earliest time in s up to which they agree.
    share
        The share of a swing that this is.
    whole
        Whether it is all of the swing, or all that was recorded.
    """

    at: float
    share: float
    whole: bool


@dataclass(frozen=True)
class Series:
    """A record on an equally spaced grid.

    Attributes
    ----------
    t
        The record's own times in s, (n,).
    grid, values
        Equally spaced times in s and values, each (m,).
    step, noise
        The recording step and the standard deviation of the noise, in the unit of the values.
    """

    t: np.ndarray
    grid: np.ndarray
    values: np.ndarray
    step: float
    noise: float

    @property
    def spacing(self) -> float:
        """Return the time in s between neighbours on the grid."""
        return float(self.grid[1] - self.grid[0])

    def moves(self, begin: float, end: float, swing: float) -> bool:
        """Return whether it moves from begin to end, s, by more than noise, rounding and a small share of a swing."""
        part = self.values[(self.grid >= begin) & (self.grid <= end)]
        return part.size > 1 and float(np.ptp(part)) > STILL * swing + 2 * self.step + ERRORS * self.noise

    def reach(self, turns: Turning) -> Reach:
        """Return how far the samples before the first of three or more turning points agree with the swings after it.

        The swing between the second and third turning point goes the same way as the one before the first; its size and
        period are extrapolated.
        """
        times = turns.times
        gaps, ranges = np.diff(times), np.abs(np.diff(turns.values))
        fall, unsure = _predict_fall(np.log(ranges[: LATER + 2]))
        unsure = min(unsure, 0.03 + 0.1 * abs(fall))
        same = gaps[1:8:2]  # swings in the same direction: those up may last longer than those down
        trend = float(same[0] - same[-1]) / (same.size - 1) if same.size > 1 else 0.0
        pace = float(np.clip(same[0] + trend, 0.9 * same[0], 1.1 * same[0]))
        late = min(0.01 * pace + 0.5 * float(np.abs(np.diff(same[:2])).sum()), 0.02 * pace)
        # The last swing before the first turning point and a little more, and a cycle later, what it should be like.
        earliest = times[0] - 1.15 * pace
        a, b = np.searchsorted(self.grid, (earliest - 1e-12, times[0]))
        if b <= a:
            return Reach(float(times[0]), 0.0, True)
        back = times[0] - self.grid[a:b]
        scale = float(np.exp(fall))
        curve = scipy.interpolate.CubicSpline(self.grid, self.values)
        later = curve(times[2] - back * gaps[1] / pace) - turns.values[2]
        off = self.values[a:b] - turns.values[0] - later * scale
        width = max(int(0.1 * gaps[0] / self.spacing), 0) | 1
        share = np.minimum(back / pace, 1.0)
        speed = np.abs(np.gradient(self.values[a:b], self.spacing)) if b - a > 1 else np.zeros(1)
        allowed = (1 + scale) * (0.5 * self.step) + (TEMPLATE + unsure * share) * ranges[0]
        allowed = allowed + np.minimum(speed, 2 * ranges[0] / pace) * late * share
        blur = 4.5 * self.noise * np.sqrt(1 + scale**2)
        smooth = uniform_filter1d(off, width, mode="nearest")
        agrees = (np.abs(smooth) <= allowed + blur / np.sqrt(width)) & (np.abs(off) <= allowed + blur)
        wrong = np.flatnonzero(~agrees)
        first = int(wrong[-1]) + 1 if wrong.size else 0
        at = float(self.grid[a + first]) if first < b - a else float(times[0])
        whole = at - max(self.grid[0], times[0] - pace) <= 1.01 * self.spacing
        if whole and self.grid[0] < earliest:
            at = max(at, float(times[0] - pace))
        return Reach(at, min(float(times[0] - at) / pace, 1.0), bool(whole))


def _predict_fall(logs: np.ndarray) -> tuple[float, float]:
    """Predict the fall of the log range (k ≥ 2,) in the cycle that begins before the first swing, and its error."""
    if logs.size == 2:
        fall = 2 * float(logs[0] - logs[1])
        return fall, 0.5 * abs(fall)
    falls = logs[:-2] - logs[2:]
    if falls.size == 0:
        raise InputError(
            "fewer than three swings can be followed; are there wrong values in it, or another column?"
        )

    def most_change(first: float) -> float:
        return abs(first) * float(np.expm1(0.5 * POWER * abs(first)))

    near = falls[: int(np.count_nonzero(logs[:-2] > logs[0] - ALIKE))]
    if near.size >= 6:
        line = np.polynomial.Polynomial.fit(np.arange(near.size), near, 1)
        first = float(line(0.0))
        scatter = float(np.std(near - line(np.arange(near.size))))
        most = most_change(first)
        fall = float(np.clip(line(-1.0), first - most, first + most))
        return fall, 2 * scatter + 0.5 * most + 0.1 * abs(fall)
    first = float(falls[0])
    if falls.size == 1:
        return first, 0.4 * abs(first)
    most = most_change(first)
    fall = float(np.clip(2 * first - falls[1], first - most, first + most))
    return fall, 0.5 * most + 0.1 * abs(fall)
