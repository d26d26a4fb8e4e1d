"""Find stretches of a record that may be one free decay, and test whether a half cycle agrees with the later ones.

A swing is the half cycle from one turning point to the next. A stretch is a series of swings that are in phase, above
the noise, and without a jump of the amplitude. No damping law is assumed.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from typing import Literal

import numpy as np
import scipy  # loads its modules when they are used

from bayesdamp.records.oscillation.features import TurningPoints, local_median, true_runs
from bayesdamp.records.oscillation.noise import neighbourhoods
from bayesdamp.types import InputError

Reason = Literal["period", "amplitude", "midline", "shape"]
"""Name of the property in which a swing (half cycle) disagrees with the later swings."""

# These thresholds were set on simulated and measured records in which a hand holds, hits or releases the body
# (tests/records/hands.py).
MAX_RISE = 0.25
"""A second release or a push is assumed if the range (maximum minus minimum) of the half cycles grows by more than this
fraction within a cycle. A beat is not taken for a push, because its range grows as gradually as it fell before
(`JUMP_RATIO`)."""
MAX_FALL = 0.35
"""A hand that stops the motion is assumed if the range (maximum minus minimum) of the half cycles falls by more than
this fraction within a cycle, unless it already fell so fast before (`JUMP_RATIO`)."""
JUMP_RATIO = 3.0
"""A change of the range (maximum minus minimum) of the half cycles within a cycle counts as a jump only if it is more
than this many times the largest change in the cycles before. (It must also exceed `MAX_RISE` or `MAX_FALL`.)"""
TAIL_INFORMATION = 0.5
"""Of a decay that is cut where its rate changes, the first part is used if it has at least this fraction of the
information of the part with the most (`best_stretch`)."""
SWINGS_PER_WINDOW = 4
"""To find a sudden change (break) of the decay rate, the rates in two windows before it and two windows after it are
compared. This is the number of swings (half cycles) in each window."""
MIN_RATE_CHANGE = 0.4
"""The decay rate may vary as a power of the amplitude, with an exponent between ± `LARGEST_POWER`. It changes suddenly
(a break) only if the part of its change that no such power explains exceeds this fraction of the larger one of the
rates before and after."""
LARGEST_POWER = 1.2
"""The decay rate of a free decay is assumed to vary as a power of the amplitude. The exponent is between minus this
value and plus this value: −1 is dry friction, 0 viscous damping, 1 drag."""
LATER_SWINGS = 10
"""Largest number of later swings (half cycles) with which a swing is compared."""
EXCEEDANCE = 1e-3
"""Probability that a swing (half cycle) of an undisturbed free decay is outside the prediction interval from the later
swings (`_predict_before`). A swing that is outside by more than a tolerance (`PERIOD_TOLERANCE` or
`MIDLINE_TOLERANCE`) counts as disturbed, by a hand or a hit."""
MAX_MISFIT = 5.0
"""A swing (half cycle) has another shape than the later swings if its misfit, the residual of a sinusoid fitted to it
(`Swings.misfit`), is more than this many times their median misfit."""
PERIOD_TOLERANCE, MIDLINE_TOLERANCE, SHAPE_TOLERANCE = 0.02, 0.03, 0.01
"""Deviations of a swing (half cycle) from the later ones that do not count as a disturbance: of the duration
(relative), of the midline (as a fraction of the range), and of the shape (rms misfit as a fraction of half the
range)."""
MAX_LOG_FALL = 0.9
"""The decay rate at the start of a decay is extrapolated from the half cycles whose ln range (ln of maximum minus
minimum) is at most this much below that of the first half cycle. Smaller half cycles are not used, because with dry
friction the rate increases without bound towards the end."""
STILL_FRACTION = 0.02
"""The body counts as moving in a part of the record if the range of the values exceeds the effects of noise and
rounding by more than this fraction of the range of a nearby half cycle (`Series.moves`)."""
NOISE_ERRORS = 4.0
"""A movement may be only noise if its range is below this many standard deviations of the noise. A turning point may be
only noise if it is closer to the midline than this many standard errors of its value."""
TEMPLATE_TOLERANCE = 0.02
"""The samples before the first turning point are compared with a later swing (half cycle) after scaling it to their
size and period. They agree if the difference, apart from noise, is at most this fraction of the range of the first
swing (`Series.reach`)."""


def find_stretches(t: np.ndarray, turns: TurningPoints, floor: float) -> list[tuple[int, int]]:
    """Find the stretches of swings (half cycles) that may be a free decay.

    The swings of a stretch follow one another by about half a period and are above the noise, and neither their range
    nor its decay rate jumps.

    Parameters
    ----------
    t
        Times of the samples in s, (n,).
    turns
        The turning points.
    floor
        Smallest distance of a turning point from the midline, in the unit of the values; closer ones are noise.

    Returns
    -------
    list of tuple
        For each stretch of at least three turning points, in time order: index of its first turning point, and 1 +
        index of its last one.
    """
    spans: list[tuple[int, int]] = []
    for first, last in _runs_in_phase(t, turns, floor):  # swings first .. last - 1
        # A median of five, because a spike or a gap spoils one turning point, and so two ranges.
        ranges = np.median(neighbourhoods(np.abs(np.diff(turns.values[first : last + 1])), 5), axis=1)
        # Indices at which turning points are missing in a gap of the samples.
        gaps = np.diff(turns.times[first : last + 1])
        across = np.flatnonzero(gaps > 1.6 * np.median(gaps))

        for a, b in pairwise([0, *_without_holes(_find_jumps(ranges, floor), across), ranges.size]):
            breaks = (a + c for c in _find_breaks(ranges[a:b], floor) if a + c < b)
            cuts = [a, *_without_holes(breaks, across), b]
            cuts = sorted({c + e for c, d in pairwise(cuts) for e in _ends_of_fall(ranges[c:d], floor)})
            spans += [(first + c, first + d + 1) for c, d in pairwise(cuts) if d - c >= 2]
    return spans


def _without_holes(marks: Iterable[int], across: np.ndarray) -> list[int]:
    """Remove the jumps and breaks that are near a gap in the samples, and return the indices of the others.

    Across a gap the range of the swings (half cycles) falls as much as over several swings. This must not count as a
    jump of the range or a break of the decay rate.

    marks: indices of the swings with a jump or break. across: indices of the swings that contain a gap. Near means
    within 2 × `SWINGS_PER_WINDOW` swings.
    """
    return [m for m in marks if not np.any(np.abs(across - m) <= 2 * SWINGS_PER_WINDOW)]


def information(turns: TurningPoints, stretch: tuple[int, int]) -> float:
    """Return a measure of how much information a stretch of half cycles contains about the damping; no unit.

    It is n (0.02 + ln r) for n half cycles. The range of a half cycle is its maximum minus its minimum. r is the larger
    range of the first two half cycles divided by the smaller range of the last two, but at least 1. stretch: index of
    its first turning point, and 1 + index of its last one.
    """
    ranges = np.abs(np.diff(turns.values[slice(*stretch)]))
    few = min(2, ranges.size)
    fallen = np.log(max(float(ranges[:few].max() / ranges[-few:].min()), 1.0))
    return ranges.size * (0.02 + float(fallen))


def best_stretch(turns: TurningPoints, stretches: Sequence[tuple[int, int]]) -> tuple[int, int]:
    """Return the stretch with the most `information` on the damping.

    If this is the tail of another stretch, which ends where it starts and has at least `TAIL_INFORMATION` times as much
    information, the other one is returned: its half cycles are larger, so that forces other than damping matter less.
    """
    best = max(stretches, key=lambda span: information(turns, span))
    least, ranges = TAIL_INFORMATION * information(turns, best), np.abs(np.diff(turns.values))
    for a, b in reversed(stretches):
        falls_on = b - 1 == best[0] and ranges[b - 1] <= ranges[b - 2]
        if falls_on and information(turns, (a, b)) >= least:
            best = a, b
    return best


def _runs_in_phase(t: np.ndarray, turns: TurningPoints, floor: float) -> list[tuple[int, int]]:
    """Return the runs of swings (half cycles) that are in phase and above the noise, as (first swing, 1 + last swing).

    Swing i is between turning points i and i + 1. A run continues across a turning point that a spike spoils, and
    across a gap in the samples. The arguments are those of `find_stretches`.
    """
    gaps, ranges = np.diff(turns.times), np.abs(np.diff(turns.values))
    if gaps.size == 0:
        return []
    typical = local_median(gaps)
    width = np.concatenate([typical[:1], typical]) / 4
    begin, end = np.maximum(turns.times - width, t[0]), np.minimum(turns.times + width, t[-1])
    samples = np.searchsorted(t, end, side="right") - np.searchsorted(t, begin)
    sampled = samples >= 0.75 * (end - begin) / float(np.median(np.diff(t))) - 1
    clear = (ranges > 2 * floor) & (np.median(neighbourhoods(ranges, 3), axis=1) > 2 * floor)
    good = (gaps > 0.7 * typical) & (gaps < 1.6 * typical) & clear & sampled[1:] & sampled[:-1]
    runs: list[tuple[int, int]] = []

    def continues(stop: int, a: int, b: int) -> bool:
        """Return whether swings a to b - 1 continue a run of swings that ends before swing `stop`.

        Swings `stop` to a - 1 are spoiled by wrong turning points or by a gap in the samples.
        """
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
    """Return the indices that cut k half cycles into a rising part, a falling part, and a part that rises again.

    The first index is 0, the last is k. The falling part begins with the largest half cycle and ends with the smallest
    one after it. A free decay neither begins nor ends with a rising part, but the ringing of a filter before and after
    a hit does. A rise counts only if it exceeds the fraction `MAX_RISE` and 4 `floor`; if it does not, there is no cut.

    ranges: ranges (maximum minus minimum) of the half cycles, (k,). floor: smallest distance of a turning point from
    the midline that is not noise, in the same unit.
    """
    if ranges.size == 0:
        return [0]
    top = int(np.argmax(ranges))
    low, marks = top + int(np.argmin(ranges[top:])), [0]
    if ranges[top] - ranges[0] > max(MAX_RISE * ranges[0], 4 * floor):
        marks.append(top)
    if ranges[-1] - ranges[low] > max(MAX_RISE * ranges[low], 4 * floor):
        marks.append(low + 1)
    return [*marks, ranges.size]


def _find_jumps(ranges: np.ndarray, floor: float) -> list[int]:
    """Return the indices of the swings (half cycles) before which a decay must end, because the range jumps there.

    ranges: ranges (maximum minus minimum) of the swings, (k,). floor: smallest distance of a turning point from the
    midline that is not noise, in the same unit; changes of the range below 4 `floor` are not jumps.
    """
    change = ranges[2:] - ranges[:-2]
    rises = change > np.maximum(MAX_RISE * ranges[:-2], 4 * floor)
    falls = -change > np.maximum(MAX_FALL * ranges[:-2], 4 * floor)
    marks: list[int] = []
    for i in np.flatnonzero(rises | falls).tolist():
        usual = np.abs(change[max(i - 4, 0) : max(i - 1, 0)])
        if usual.size == 0 and change[i] < 0:
            continue
        if abs(change[i]) > JUMP_RATIO * float(usual.max(initial=0.0)):
            at = i + 2 if change[i] > 0 else i + 1
            if not marks or at - marks[-1] > 1:
                marks.append(at)
            elif change[i] > 0:
                marks[-1] = at
    return marks


def _find_breaks(ranges: np.ndarray, floor: float) -> list[int]:
    """Return the indices of swings (half cycles) at which the decay rate changes suddenly (breaks).

    The rates in two windows before a possible break and in two after it are compared, because in a beat the rate
    changes steadily through all four. The part of the change that no power of the amplitude explains must exceed three
    limits: `MIN_RATE_CHANGE` times the larger rate, 6 standard deviations of a rate, and 2.5 times such a change
    between the two windows on one side. The range must be above 16 `floor` until the end of the last window. The list
    is empty for fewer than 16 swings.

    ranges: ranges (maximum minus minimum) of the swings, (k,). floor: smallest distance of a turning point from the
    midline that is not noise, in the same unit.
    """
    if ranges.size < 4 * SWINGS_PER_WINDOW:
        return []
    logs, n = np.log(ranges), np.arange(SWINGS_PER_WINDOW) - (SWINGS_PER_WINDOW - 1) / 2
    windows = np.lib.stride_tricks.sliding_window_view(logs, SWINGS_PER_WINDOW)
    size = windows.mean(axis=1)
    rate = -(windows @ n) / np.sum(n**2)
    scatter = np.sqrt(np.mean((windows - size[:, None] + rate[:, None] * n) ** 2, axis=1))
    blur = np.hypot(scatter, 0.5 * floor / ranges[: size.size]) / np.sqrt(np.sum(n**2))
    k = np.arange(SWINGS_PER_WINDOW, ranges.size - 3 * SWINGS_PER_WINDOW + 1)
    # The four windows begin at k - SWINGS_PER_WINDOW, k, k + SWINGS_PER_WINDOW and k + 2 SWINGS_PER_WINDOW.
    parts = k + np.arange(-SWINGS_PER_WINDOW, 3 * SWINGS_PER_WINDOW, SWINGS_PER_WINDOW)[:, None]
    rates, sizes = rate[parts], size[parts]
    sd = np.sqrt(np.mean(blur[parts] ** 2, axis=0))

    def unexplained(i: int, j: int) -> np.ndarray:
        """Return the change of the decay rate (per swing, ≥ 0) from window j to window i that no power explains.

        A power of the amplitude with an exponent up to ± `LARGEST_POWER` and the rate in window j allow an interval for
        the rate in window i. The result is the distance of the rate in window i from this interval, one value for each
        possible place of the break. The windows are numbered 0 to 3.
        """
        factor = np.exp(LARGEST_POWER * np.abs(sizes[i] - sizes[j]))
        low, high = np.sort([rates[j] / factor, rates[j] * factor], axis=0)
        return np.maximum(np.maximum(low - rates[i], rates[i] - high), 0.0)

    def misfit(part: np.ndarray, degree: int) -> float:
        columns = np.arange(part.size)[:, None] ** np.arange(degree + 1)
        return float(np.sum((part - columns @ np.linalg.lstsq(columns, part, rcond=None)[0]) ** 2))

    def corner(a: int, b: int) -> int:
        """Return the index of the swing between a and b at which the decay rate changes suddenly.

        For this swing, a straight line through ln of the ranges before it and a parabola through those from it on fit
        best.
        """
        corners = range(a + SWINGS_PER_WINDOW + 1, b - SWINGS_PER_WINDOW)
        return min(corners, key=lambda m: misfit(logs[a:m], 1) + misfit(logs[m:b], 2))

    inner = np.maximum(unexplained(0, 1), unexplained(2, 3))
    clear = ranges[k + 3 * SWINGS_PER_WINDOW - 1] > 16 * floor
    limit = np.maximum.reduce(
        [MIN_RATE_CHANGE * np.maximum(np.abs(rates[1]), np.abs(rates[2])), 6 * sd, 2.5 * inner]
    )
    # Require the change also between the outer windows: a spoiled turning point changes only the inner ones.
    excess = np.where(clear, np.minimum(unexplained(1, 2), unexplained(0, 3)) - limit, -1.0)
    marks: list[int] = []
    while (best := int(np.argmax(excess))) >= 0 and excess[best] > 0:
        marks.append(corner(int(k[best]) - SWINGS_PER_WINDOW, int(k[best]) + 3 * SWINGS_PER_WINDOW) + 1)
        excess[max(best - 2 * SWINGS_PER_WINDOW, 0) : best + 2 * SWINGS_PER_WINDOW + 1] = -1.0
    return sorted(marks)


@dataclass
class Swings:
    """The k − 1 swings (half cycles) between the k turning points of a decay.

    Besides the fields below it has the ranges of the swings (`ranges`, maximum minus minimum) and their durations in s
    (`gaps`), each (k − 1,), and the midline at each turning point except the first and the last (`midlines`, (k − 2,)).

    Attributes
    ----------
    t, y
        Times in s and values of the samples, each (n,).
    turns
        The turning points.
    floor
        Largest effect of noise and rounding on one swing, in the unit of y.
    """

    t: np.ndarray
    y: np.ndarray
    turns: TurningPoints
    floor: float
    _misfits: dict[int, tuple[float, float]] = field(default_factory=dict)

    def __post_init__(self) -> None:
        self.gaps = np.diff(self.turns.times)
        self.ranges = np.abs(np.diff(self.turns.values))
        values = self.turns.values
        self.midlines = (values[:-2] + 2 * values[1:-1] + values[2:]) / 4

    def reason_not_continuing(self, i: int) -> Reason | None:
        """Return the first property of "period", "midline" and "shape" in which swing i disagrees with later swings.

        Return None if it agrees in all three. The period needs two later swings and the midline three; a property with
        fewer is not tested.
        """
        later = self.gaps[i + 1 : i + 1 + LATER_SWINGS]
        if later.size >= 2:  # a swing that a hand stops is shorter than predicted
            predicted, slack = _predict_before(later)
            usual = float(np.median(later))
            blur = 0.3 * self.floor / self.ranges[i] * usual
            share = PERIOD_TOLERANCE if later.size >= 6 else 2.5 * PERIOD_TOLERANCE
            if not abs(self.gaps[i] - predicted) <= max(share * usual, blur) + slack:
                return "period"
        later = self.midlines[i + 1 : i + 1 + LATER_SWINGS]
        if later.size >= 3:
            predicted, slack = _predict_before(later)
            if (
                not abs(self.midlines[i] - predicted)
                <= max(MIDLINE_TOLERANCE * self.ranges[i], self.floor) + slack
            ):
                return "midline"
        return None if self._is_like_later(i, self.misfit(i)) else "shape"

    def opens_like_later(self, begin: float) -> bool:
        """Return whether the samples from `begin` (s) to the first turning point have the shape of the swings after it.

        A slowly changing sinusoid with an overtone is fitted to these samples and to each later swing (half cycle), and
        the residuals are compared. The result is True also if there are too few samples to decide.
        """
        end = float(self.turns.times[0])
        samples = int(np.count_nonzero((self.t >= begin) & (self.t <= end)))
        if samples < 8 or end - begin < 0.3 * float(self.gaps[0]):
            return True
        return self._is_like_later(-1, self._fit_misfit(begin, end, self.gaps[0]))

    def _is_like_later(self, i: int, misfit: tuple[float, float]) -> bool:
        later = np.array([self.misfit(j) for j in range(i + 1, min(i + 1 + LATER_SWINGS, self.gaps.size))])
        usual = np.median(later, axis=0) if later.size else np.zeros(2)
        limit = np.maximum(
            MAX_MISFIT * usual, np.array([1, 2]) * SHAPE_TOLERANCE * 0.5 * self.ranges[max(i, 0)]
        )
        return bool(np.all(misfit <= np.maximum(limit, np.array([0.3, 0.6]) * self.floor)))

    def misfit(self, i: int) -> tuple[float, float]:
        """Fit a slowly changing sinusoid with an overtone to swing i, and return rms and largest absolute residual.

        Both are in the unit of y, and 0 if the swing has fewer than three samples.
        """
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
    """Extrapolate a series back by one element, by a least-squares polynomial fitted to its values `later`, (k ≥ 2,).

    The values are durations or midlines of successive half cycles. The degree of the polynomial is 0 for two values, 1
    for three to five, 2 for more. From eight values on, even and odd values may differ by a constant (upward and
    downward swings). Return the predicted value and the half width of its prediction interval. The element is outside
    of this interval with probability EXCEEDANCE (two-sided). With two or three values the half width is at most twice
    their range.
    """
    x = np.arange(later.size + 1.0)
    columns = x[:, None] ** np.arange(3 if later.size >= 6 else 2 if later.size >= 3 else 1)
    if later.size >= 8:
        columns = np.hstack([columns, (-1.0) ** x[:, None]])
    inverse = np.linalg.pinv(columns[1:])
    c, free = inverse @ later, later.size - columns.shape[1]
    variance = float(np.sum((later - columns[1:] @ c) ** 2)) / free
    weights = columns[0] @ inverse
    slack = float(scipy.special.stdtrit(free, 1 - EXCEEDANCE / 2)) * np.sqrt(
        variance * (1 + float(weights @ weights))
    )
    return float(columns[0] @ c), min(slack, 2 * float(np.ptp(later))) if free < 2 else slack


@dataclass(frozen=True)
class Reach:
    """How far back from a turning point the samples agree with a later swing (half cycle), scaled in size and period.

    Attributes
    ----------
    at
        Earliest time in s back to which they agree.
    share
        Time from `at` to the turning point, as a fraction of the duration of a swing; at most 1.
    whole
        Whether they agree over the full duration of a swing, or over all of it that was recorded.
    """

    at: float
    share: float
    whole: bool


@dataclass(frozen=True)
class Series:
    """A record interpolated on an equally spaced grid of times.

    Attributes
    ----------
    t
        Original times in s, (n,).
    grid, values
        Equally spaced times in s and the values there, each (m,).
    step, noise
        Resolution of the recorded values (steps to which they are rounded; 0 for none), and standard deviation of the
        noise, both in the unit of the values.
    """

    t: np.ndarray
    grid: np.ndarray
    values: np.ndarray
    step: float
    noise: float

    @property
    def spacing(self) -> float:
        """Return the spacing of the grid in s."""
        return float(self.grid[1] - self.grid[0])

    def moves(self, begin: float, end: float, swing: float) -> bool:
        """Return whether the range of the values between the times `begin` and `end` (s) shows that the body moves.

        The range must exceed STILL_FRACTION × `swing` + 2 `step` + NOISE_ERRORS × `noise`. swing: range of a half
        cycle, in the unit of the values.
        """
        part = self.values[(self.grid >= begin) & (self.grid <= end)]
        return (
            part.size > 1
            and float(np.ptp(part)) > STILL_FRACTION * swing + 2 * self.step + NOISE_ERRORS * self.noise
        )

    def reach(self, turns: TurningPoints) -> Reach:
        """Return how far back from the first turning point the samples agree with a later swing, as a `Reach`.

        A swing is the half cycle between two turning points. The samples are compared with the swing between the second
        and third turning point, which has the same direction. This swing is first scaled to the size and period that
        are extrapolated for the swing before the first turning point.
        turns: turning points of the decay, at least three.
        """
        times = turns.times
        gaps, ranges = np.diff(times), np.abs(np.diff(turns.values))
        fall, unsure = _predict_fall(np.log(ranges[: LATER_SWINGS + 2]))
        unsure = min(unsure, 0.03 + 0.1 * abs(fall))
        same = gaps[1:8:2]  # swings in the same direction; upward ones may last longer than downward ones
        trend = float(same[0] - same[-1]) / (same.size - 1) if same.size > 1 else 0.0
        pace = float(np.clip(same[0] + trend, 0.9 * same[0], 1.1 * same[0]))
        late = min(0.01 * pace + 0.5 * float(np.abs(np.diff(same[:2])).sum()), 0.02 * pace)
        # Compare the samples up to 1.15 swings before the first turning point with the scaled later swing.
        earliest = times[0] - 1.15 * pace
        a, b = np.searchsorted(self.grid, (earliest - 1e-12, times[0]))
        if b <= a:
            return Reach(float(times[0]), 0.0, True)
        back = times[0] - self.grid[a:b]
        scale = float(np.exp(fall))
        places = np.clip(times[2] - back * gaps[1] / pace, self.grid[0], self.grid[-1])
        # Interpolate the later swing linearly, and subtract what its curvature adds between two points of the grid.
        part = (places - self.grid[0]) / self.spacing % 1
        bend = np.interp(places, self.grid[1:-1], np.diff(self.values, 2))
        later = np.interp(places, self.grid, self.values) - part * (1 - part) / 2 * bend - turns.values[2]
        off = self.values[a:b] - turns.values[0] - later * scale
        width = max(int(0.1 * gaps[0] / self.spacing), 0) | 1
        share = np.minimum(back / pace, 1.0)
        speed = np.abs(np.gradient(self.values[a:b], self.spacing)) if b - a > 1 else np.zeros(1)
        allowed = (1 + scale) * (0.5 * self.step) + (TEMPLATE_TOLERANCE + unsure * share) * ranges[0]
        allowed = allowed + np.minimum(speed, 2 * ranges[0] / pace) * late * share
        blur = 4.5 * self.noise * np.sqrt(1 + scale**2)
        smooth = neighbourhoods(off, width).mean(axis=1)
        agrees = (np.abs(smooth) <= allowed + blur / np.sqrt(width)) & (np.abs(off) <= allowed + blur)
        wrong = np.flatnonzero(~agrees)
        first = int(wrong[-1]) + 1 if wrong.size else 0
        at = float(self.grid[a + first]) if first < b - a else float(times[0])
        whole = at - max(self.grid[0], times[0] - pace) <= 1.01 * self.spacing
        if whole and self.grid[0] < earliest:
            at = max(at, float(times[0] - pace))
        return Reach(at, min(float(times[0] - at) / pace, 1.0), bool(whole))


def _predict_fall(logs: np.ndarray) -> tuple[float, float]:
    """Predict by how much ln of the range of the half cycles falls over one cycle at the start of a series.

    The cycle begins one half cycle before the given ones: the fall is from the half cycle before the first of them to
    the second of them.

    logs: ln of the ranges (maximum minus minimum) of successive half cycles, (k ≥ 2,). Return the fall (positive if the
    ranges become smaller) and an allowance for its error. Raises InputError if k < 2.
    """
    if logs.size == 2:
        fall = 2 * float(logs[0] - logs[1])
        return fall, 0.5 * abs(fall)
    falls = logs[:-2] - logs[2:]
    if falls.size == 0:
        raise InputError(
            "fewer than two half cycles can be followed; check the file for wrong values, or choose another column"
        )

    def most_change(first: float) -> float:
        return abs(first) * float(np.expm1(0.5 * LARGEST_POWER * abs(first)))

    near = falls[: int(np.count_nonzero(logs[:-2] > logs[0] - MAX_LOG_FALL))]
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
