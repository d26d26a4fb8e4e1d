"""Stretches of turning points that may be one free decay: in step, clear of the noise, without a jump of amplitude."""

from __future__ import annotations

from collections.abc import Iterable
from itertools import pairwise

import numpy as np
from scipy.ndimage import median_filter, uniform_filter1d

from bayesdamp.records.oscillation.turning import Turning, local_median, true_runs

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
AVERAGED, SMALL = 6, 0.1
"""Swings that are averaged to measure a rise, and share of the largest swing by which noise lifts others at most."""
POWER = 1.2
"""The rate of decay goes at most with this power of the amplitude, up or down: −1 is dry friction, 1 is drag."""


def stretches(t: np.ndarray, turns: Turning, floor: float) -> list[tuple[int, int]]:
    """(first, last + 1) turning points of stretches of three or more, in their order in time.

    t: times of the samples (n,) in s. floor: what the distance of a turning point from the midline must exceed.
    """
    found: list[tuple[int, int]] = []
    for first, last in _in_step(t, turns, floor):  # swings first .. last - 1
        # A spike or a gap spoils one turning point, and with it two ranges.
        ranges = median_filter(np.abs(np.diff(turns.values[first : last + 1])), 5, mode="nearest")
        # Swings between turning points that span others, of which there is no sample.
        gaps = np.diff(turns.times[first : last + 1])
        across = np.flatnonzero(gaps > 1.6 * np.median(gaps))
        marks = [0, *_apart(_jumps(ranges, floor), across), ranges.size]
        for a, b in pairwise(marks):
            breaks = (a + c for c in _breaks(ranges[a:b], floor) if a + c < b)
            cuts = [a, *_apart(breaks, across), b]
            cuts = sorted({c + e for c, d in pairwise(cuts) for e in _falling(ranges[c:d], floor)})
            found += [(first + c, first + d + 1) for c, d in pairwise(cuts) if d - c >= 2]
    return found


def worth(turns: Turning, stretch: tuple[int, int]) -> float:
    """What a stretch tells of the damping: its swings times the log of the amplitudes that it goes through."""
    ranges = np.abs(np.diff(turns.values[slice(*stretch)]))
    few = min(2, ranges.size)
    fallen = np.log(max(float(ranges[:few].max() / ranges[-few:].min()), 1.0))
    return ranges.size * (0.02 + float(fallen))


def unsteadiness(ranges: np.ndarray) -> float:
    """Return the largest rise of ranges (k,) of swings after they have fallen, averaged over a few cycles.

    A filter leaves noise of a narrow band, which lifts swings by so much. 0 where they rise by much more, as in beats.
    """
    if ranges.size < 4 * AVERAGED:
        return 0.0
    smooth = uniform_filter1d(ranges, AVERAGED, mode="nearest")
    falling = smooth[int(np.argmax(smooth)) :]
    rise = float((falling - np.minimum.accumulate(falling)).max())
    return rise if rise < SMALL * float(smooth.max()) else 0.0


def _falling(ranges: np.ndarray, floor: float) -> list[int]:
    """Return first and last + 1 of swings with ranges (k,), and between them where they begin to fall or rise again.

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


def _in_step(t: np.ndarray, turns: Turning, floor: float) -> list[tuple[int, int]]:
    """(first, last + 1) swings of runs that are in step and clear of the noise, with what a spike or a gap spoils."""
    gaps, ranges = np.diff(turns.times), np.abs(np.diff(turns.values))
    if gaps.size == 0:
        return []
    typical = local_median(gaps)
    width = np.concatenate([typical[:1], typical]) / 4
    begin, end = np.maximum(turns.times - width, t[0]), np.minimum(turns.times + width, t[-1])
    seen = np.searchsorted(t, end, side="right") - np.searchsorted(t, begin)
    sampled = seen >= 0.75 * (end - begin) / float(np.median(np.diff(t))) - 1
    clear = (ranges > 2 * floor) & (median_filter(ranges, 3, mode="nearest") > 2 * floor)
    good = (gaps > 0.7 * typical) & (gaps < 1.6 * typical) & clear & sampled[1:] & sampled[:-1]
    runs: list[tuple[int, int]] = []
    for a, b in true_runs(good):
        if runs and b - a >= 2 and _goes_on(t, turns, runs[-1], (a, b), ranges, floor):
            runs[-1] = (runs[-1][0], b)
        else:
            runs.append((a, b))
    return runs


def _goes_on(
    t: np.ndarray,
    turns: Turning,
    run: tuple[int, int],
    later: tuple[int, int],
    ranges: np.ndarray,
    floor: float,
) -> bool:
    """Whether a later run of swings goes on with the one before: a spoiled turning point, or missing samples."""
    a = later[0]
    before, after = float(ranges[run[1] - 1]), float(ranges[a])
    begin, end = float(turns.times[run[1]]), float(turns.times[a])
    swing = float(turns.times[run[1]] - turns.times[run[1] - 1])
    seen = np.searchsorted(t, end) - np.searchsorted(t, begin)
    if seen < 0.7 * (end - begin) * (t.size - 1) / (t[-1] - t[0]) and end - begin > 1.2 * swing:
        return after <= 1.05 * before + 2 * floor
    off = (end - begin) / swing
    in_phase = abs(off - round(off)) < 0.3 and off < 4.5
    few = later[1] - a < 3
    return (
        not few
        and a - run[1] <= 3
        and in_phase
        and 0.6 * before - 2 * floor <= after <= 1.25 * before + 2 * floor
    )


def _apart(marks: Iterable[int], across: np.ndarray) -> list[int]:
    """The marks that no hole explains: across it the range falls by what the swings in it lose."""
    return [m for m in marks if not np.any(np.abs(across - m) <= 2 * HALF)]


def _jumps(ranges: np.ndarray, floor: float) -> list[int]:
    """Swings at which a new stretch begins because the range has jumped."""
    change = ranges[2:] - ranges[:-2]
    marks: list[int] = []
    for i in np.flatnonzero(
        (change > np.maximum(RISE * ranges[:-2], 4 * floor))
        | (-change > np.maximum(FALL * ranges[:-2], 4 * floor))
    ).tolist():
        usual = np.abs(change[max(i - 4, 0) : max(i - 1, 0)])
        if usual.size == 0 and change[i] < 0:
            continue
        if abs(change[i]) > JUMP * (float(usual.max()) if usual.size else 0.0):
            at = i + 2 if change[i] > 0 else i + 1
            if not marks or at - marks[-1] > 1:
                marks.append(at)
            elif change[i] > 0:
                marks[-1] = at
    return marks


def _breaks(ranges: np.ndarray, floor: float) -> list[int]:
    """Swings at which the rate of decay changes suddenly, by more than the fall of the amplitude can explain.

    The slopes of the log range in two halves before and two after are compared: of a beat they change alike.
    """
    if ranges.size < 4 * HALF:
        return []
    logs, n = np.log(ranges), np.arange(HALF) - (HALF - 1) / 2
    windows = np.lib.stride_tricks.sliding_window_view(logs, HALF)
    size = windows.mean(axis=1)
    rate = -(windows @ n) / np.sum(n**2)
    scatter = np.sqrt(np.mean((windows - size[:, None] + rate[:, None] * n) ** 2, axis=1))
    blur = np.hypot(scatter, 0.5 * floor / ranges[: size.size]) / np.sqrt(np.sum(n**2))
    k = np.arange(HALF, ranges.size - 3 * HALF + 1)  # the halves begin at k - HALF, k, k + HALF, k + 2 HALF
    parts = [rate[k + j * HALF] for j in (-1, 0, 1, 2)]
    sd = np.sqrt(np.mean([blur[k + j * HALF] ** 2 for j in (-1, 0, 1, 2)], axis=0))
    sizes = [size[k + j * HALF] for j in (-1, 0, 1, 2)]

    def beyond(i: int, j: int) -> np.ndarray:
        """What the fall of the amplitude does not explain of the change of the rate from part i to part j."""
        factor = np.exp(POWER * np.abs(sizes[i] - sizes[j]))
        low, high = np.sort([parts[j] / factor, parts[j] * factor], axis=0)
        return np.maximum(np.maximum(low - parts[i], parts[i] - high), 0.0)

    inner = np.maximum(beyond(0, 1), beyond(2, 3))
    clear = ranges[k + 3 * HALF - 1] > 16 * floor
    rates = np.maximum(np.abs(parts[1]), np.abs(parts[2]))
    limit = np.maximum.reduce([BREAK * rates, 6 * sd, 2.5 * inner])
    # A spoiled turning point bends the curve for a few swings; a break lasts.
    excess = np.where(clear, np.minimum(beyond(1, 2), beyond(0, 3)) - limit, -1.0)
    marks: list[int] = []
    while (best := int(np.argmax(excess))) >= 0 and excess[best] > 0:
        marks.append(_corner(logs, int(k[best]) - HALF, int(k[best]) + 3 * HALF) + 1)
        excess[max(best - 2 * HALF, 0) : best + 2 * HALF + 1] = -1.0
    return sorted(marks)


def _corner(logs: np.ndarray, a: int, b: int) -> int:
    """The first swing after a break between swings a and b: the one at which two parabolas fit best."""

    def left(part: np.ndarray, degree: int) -> float:
        columns = np.arange(part.size)[:, None] ** np.arange(degree + 1)
        return float(np.sum((part - columns @ np.linalg.lstsq(columns, part, rcond=None)[0]) ** 2))

    marks = range(a + HALF + 1, b - HALF)
    return min(marks, key=lambda m: left(logs[a:m], 1) + left(logs[m:b], 2))
