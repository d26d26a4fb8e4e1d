"""Whether a swing continues the later ones: its period, midline and shape, of which no law is assumed."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal

import numpy as np
from scipy.ndimage import uniform_filter1d
from scipy.special import stdtrit

from bayesdamp.records.oscillation.turning import Turning
from bayesdamp.types import InputError

Reason = Literal["period", "amplitude", "midline", "shape"]

LATER = 10
"""Later swings that a swing is measured by."""
CHANCE = 1e-3
"""How often chance alone may put a swing off the curve of the later ones."""
TIMES = 5.0
"""Usual misfits of the later swings that the misfit of a swing may be."""
PERIOD, MIDLINE, SHAPE = 0.02, 0.03, 0.01
"""What a swing may be off where the later ones do not scatter: shares of the period, of the range, of the amplitude."""
POWER = 1.2
"""The fall of the log amplitude goes at most with this power of the amplitude, up or down."""
ALIKE = 0.9
"""By how much the log range may have fallen where the rate of decay still foretells that of the largest swings: dry
friction lets it grow without bound towards the end."""
TEMPLATE = 0.02
"""Share of the range by which a swing may differ from a later one that is scaled to its size and period."""


@dataclass
class Swings:
    """The swings of a stretch of turning points (k,): ranges and gaps (k - 1,), midlines (k - 2,), shapes as asked.

    t, y: the samples (n,). floor: what noise and rounding can do to one swing, in the unit of y.
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
        """In what swing i does not continue the later ones; None where it does, or where they are too few to tell."""
        later = self.gaps[i + 1 : i + 1 + LATER]
        if later.size >= 2:  # it must last as long as these foretell: a hand lets go when it likes
            foretold, slack = _foretold(later)
            usual = float(np.median(later))
            blur = 0.3 * self.floor / self.ranges[i] * usual
            share = PERIOD if later.size >= 6 else 2.5 * PERIOD
            if not abs(self.gaps[i] - foretold) <= max(share * usual, blur) + slack:
                return "period"
        later = self.midlines[i + 1 : i + 1 + LATER]
        if later.size >= 3:
            foretold, slack = _foretold(later)
            if not abs(self.midlines[i] - foretold) <= max(MIDLINE * self.ranges[i], self.floor) + slack:
                return "midline"
        return None if self._like_later(i, self.misfit(i)) else "shape"

    def opens_like_later(self, begin: float) -> bool:
        """Whether what is recorded from begin (s) to the first turning point has no more misfit than the swings."""
        end = float(self.turns.times[0])
        samples = int(np.count_nonzero((self.t >= begin) & (self.t <= end)))
        if samples < 8 or end - begin < 0.3 * float(self.gaps[0]):
            return True
        return self._like_later(-1, self._fitted(begin, end, self.gaps[0]))

    def _like_later(self, i: int, misfit: tuple[float, float]) -> bool:
        later = np.array([self.misfit(j) for j in range(i + 1, min(i + 1 + LATER, self.gaps.size))])
        usual = np.median(later, axis=0) if later.size else np.zeros(2)
        limit = np.maximum(TIMES * usual, np.array([1, 2]) * SHAPE * 0.5 * self.ranges[max(i, 0)])
        return bool(np.all(misfit <= np.maximum(limit, np.array([0.3, 0.6]) * self.floor)))

    def misfit(self, i: int) -> tuple[float, float]:
        """(rms, largest) distance of the samples of swing i from a slowly changing sinusoid and overtone."""
        if i not in self._misfits:
            self._misfits[i] = self._fitted(
                float(self.turns.times[i]), float(self.turns.times[i + 1]), self.gaps[i]
            )
        return self._misfits[i]

    def _fitted(self, begin: float, end: float, half: float) -> tuple[float, float]:
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


def _foretold(later: np.ndarray) -> tuple[float, float]:
    """(value before the first of later ones (k ≥ 2,), what chance may add to it) by a smooth curve through these.

    Swings up and down may differ. The second is the prediction interval of least squares that CHANCE leaves.
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

    at: the earliest time (s) up to which they agree. share: the share of a swing that this is. whole: whether it is all
    of the swing, or all that was recorded.
    """

    at: float
    share: float
    whole: bool


def reach(grid: np.ndarray, values: np.ndarray, turns: Turning, step: float, noise: float) -> Reach:
    """How far the samples before the first of three or more turning points agree with the swings after it.

    grid, values: equally spaced times (m,) and values, with this recording step and sd of the noise. The swing between
    the second and third turning point goes the same way as the one before the first; its size and period are
    extrapolated.
    """
    from scipy.interpolate import CubicSpline

    times = turns.times
    gaps, ranges = np.diff(times), np.abs(np.diff(turns.values))
    fall, unsure = _next_fall(np.log(ranges[: LATER + 2]))
    unsure = min(unsure, 0.03 + 0.1 * abs(fall))
    same = gaps[1:8:2]  # swings in the same direction: those up may last longer than those down
    trend = float(same[0] - same[-1]) / (same.size - 1) if same.size > 1 else 0.0
    pace = float(np.clip(same[0] + trend, 0.9 * same[0], 1.1 * same[0]))
    late = min(0.01 * pace + 0.5 * float(np.abs(np.diff(same[:2])).sum()), 0.02 * pace)
    # The last swing before the first turning point and a little more, and a cycle later, what it should be like.
    earliest = times[0] - 1.15 * pace
    a, b = np.searchsorted(grid, (earliest - 1e-12, times[0]))
    if b <= a:
        return Reach(float(times[0]), 0.0, True)
    back = times[0] - grid[a:b]
    scale = float(np.exp(fall))
    later = CubicSpline(grid, values)(times[2] - back * gaps[1] / pace) - turns.values[2]
    off = values[a:b] - turns.values[0] - later * scale
    spacing = float(grid[1] - grid[0])
    width = max(int(0.1 * gaps[0] / spacing), 0) | 1
    share = np.minimum(back / pace, 1.0)
    speed = np.abs(np.gradient(values[a:b], spacing)) if b - a > 1 else np.zeros(1)
    allowed = (1 + scale) * (0.5 * step) + (TEMPLATE + unsure * share) * ranges[0]
    allowed = allowed + np.minimum(speed, 2 * ranges[0] / pace) * late * share
    blur = 4.5 * noise * np.sqrt(1 + scale**2)
    smooth = uniform_filter1d(off, width, mode="nearest")
    agrees = (np.abs(smooth) <= allowed + blur / np.sqrt(width)) & (np.abs(off) <= allowed + blur)
    wrong = np.flatnonzero(~agrees)
    first = int(wrong[-1]) + 1 if wrong.size else 0
    at = float(grid[a + first]) if first < b - a else float(times[0])
    whole = at - max(grid[0], times[0] - pace) <= 1.01 * spacing
    if whole and grid[0] < earliest:
        at = max(at, float(times[0] - pace))
    return Reach(at, min(float(times[0] - at) / pace, 1.0), bool(whole))


def _next_fall(logs: np.ndarray) -> tuple[float, float]:
    """(fall of the log range in the cycle from the swing before the first on, how unsure that is), logs (k ≥ 2,)."""
    if logs.size == 2:
        fall = 2 * float(logs[0] - logs[1])
        return fall, 0.5 * abs(fall)
    falls = logs[:-2] - logs[2:]
    near = falls[: int(np.count_nonzero(logs[:-2] > logs[0] - ALIKE))]
    if near.size >= 6:
        line = np.polynomial.Polynomial.fit(np.arange(near.size), near, 1)
        first, foretold = float(line(0.0)), float(line(-1.0))
        scatter = float(np.std(near - line(np.arange(near.size))))
        most = abs(first) * float(np.expm1(0.5 * POWER * abs(first)))
        foretold = float(np.clip(foretold, first - most, first + most))
        return foretold, 2 * scatter + 0.5 * most + 0.1 * abs(foretold)
    if falls.size == 0:
        raise InputError(
            "fewer than three swings can be followed; are there wrong values in it, or another column?"
        )
    if falls.size == 1:
        return float(falls[0]), 0.4 * abs(float(falls[0]))
    most = abs(float(falls[0])) * float(np.expm1(0.5 * POWER * abs(falls[0])))
    fall = float(np.clip(2 * falls[0] - falls[1], falls[0] - most, falls[0] + most))
    return fall, 0.5 * most + 0.1 * abs(fall)
