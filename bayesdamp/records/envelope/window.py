"""The free decay in a record of an envelope: after the drive, before the noise floor."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from bayesdamp.records.envelope.decay import (
    ABOVE_FLOOR,
    GUARD,
    LEAST_DROP,
    LEAST_POINTS,
    SMALLEST,
    WORSE,
    Levels,
    SeenFloor,
    blocks,
    fall,
    fit_power_law,
    measure_floor,
    power_law_holds,
    power_law_start,
)
from bayesdamp.types import Refusal

POINTS = 600
"""Blocks that a record is averaged into."""
COARSE = 72
"""Blocks among which the straightest descent is searched."""
LOST = 0.4
"""Share of the straightest descent that has to be left behind the start."""
SURE_DROP = 8.0
"""dB of descent that only a decay can cause."""
SPARSE = 60
"""Readings below which a record is a table: no release and no floor is searched."""
MISFIT_WEIGHT = 20.0
"""dB of fall that a dB of root mean square misfit of a straight line outweighs, conventional."""
NARROWEST = 10
ROUNDS = 4
SHORT = 0.12
"""Length of the short lines that find the release, as a share of the decay's duration."""
AHEAD = 2
"""Lengths of short lines ahead over which the usual misfit is taken: it grows towards the floor."""
SLOWEST, FASTEST = 0.4, 5.0
"""Multiples of the rate after it beyond which a fall is not part of the decay."""
FLAT = 0.2
"""Share of the rate before it below which a level no longer falls."""
WILD, WILD_OVER = 2.5, 15
"""dB of scatter from one block to the next, over so many, at which a level is a floor's (of random phase: 5.6)."""
LAST, ROUGHER = 8, 3.0
"""Least number of readings at a record's end that are checked for a steeper fall; multiple of the roughness of a
decay's first eighth that a floor, which scatters by 5.6 dB where it is of random phase, has at least."""
SMOOTH = 7
"""Blocks over which the level is smoothed where it is compared with the floor's."""
LEVEL = 0.15
"""As SLOWEST, the multiple below which a fall is never part of the decay, however the slope varies."""
TOLERANCE = 3.0
"""Multiple of the usual change of the slope that a slope must deviate by to be no part of the decay."""


@dataclass(frozen=True)
class EnvelopeWindow:
    """The part of a record that decays freely.

    start, stop: indices of its first sample and behind its last one. why: sentences on how they were chosen.
    floor: the noise floor measured behind it, None where the record does not reach it.
    """

    start: int
    stop: int
    floor: SeenFloor | None
    why: tuple[str, ...]


def find_window(t: np.ndarray, y: np.ndarray) -> EnvelopeWindow:
    """Find the free decay in times (s) and levels (dB of power), both of shape (n,).

    The search follows what an eye does: the longest straight descent, followed back to where it begins (the reading
    before it is above or below its continuation) and on to the noise floor. Raises Refusal where nothing decays.
    """
    if t.size < LEAST_POINTS:
        raise Refusal(f"{t.size} readings: an envelope needs at least {LEAST_POINTS}")
    if t.size < SPARSE:
        # A table of few readings, which somebody has read off a decay already: from the highest one on.
        top = int(np.argmax(y))
        if t.size - top < LEAST_POINTS:
            raise Refusal(
                f"{t.size - top} readings from the highest one on: at least {LEAST_POINTS} are needed"
            )
        _refuse_small(float(y[top] - y[-1]))
        begins = "starts with the record" if top == 0 else f"starts at {t[top]:.4g} s, the highest reading"
        return EnvelopeWindow(top, t.size, None, (begins, "ends with the record"))
    levels = Levels(t, y, *blocks(t, y, POINTS))
    yb = levels.yb
    first, last = _straightest(levels)
    core = fall(yb, first, last + 1)
    top = int(np.argmax(yb))
    # Or it falls from its highest block on, nowhere straight, by one power of the amplitude.
    bent = core < LEAST_DROP and fall(yb, top, yb.size) > SURE_DROP and power_law_holds(levels, top)
    if not bent:
        _refuse_small(core)
    begin, broken = first, first > 0
    for _ in range(ROUNDS):
        before = begin
        begin, broken = _follow_back(levels, begin, last)
        if abs(begin - before) <= 1:
            break
    end, floor = _follow_on(levels, begin)
    if core > SURE_DROP and (fall(yb, begin, end) < LEAST_DROP or fall(yb, begin, last) < LOST * core):
        begin, broken = first, first > 0  # the short lines gave a start that leaves no decay
        end, floor = _follow_on(levels, begin)
    earlier = power_law_start(levels, begin, end)
    if earlier != begin:
        behind, lower = _follow_on(levels, earlier)
        # Unless what it takes for its floor is a decay.
        if min(fall(yb, begin, end), fall(yb, behind, end)) < LEAST_DROP:
            begin, broken, end, floor = earlier, earlier > 0, behind, lower
    start, stop = int(levels.edges[begin]), int(levels.edges[end])
    begins = "starts with the record"
    if broken:
        begins = f"starts at {t[start]:.4g} s, where the reading before it does not continue the decay"
    ends = "ends with the record, above any floor" if stop == t.size else f"ends at {t[stop - 1]:.4g} s"
    if floor is not None:
        ends = f"ends at {t[stop - 1]:.4g} s, {ABOVE_FLOOR:g} dB above the noise floor"
    if stop - start < LEAST_POINTS:
        raise Refusal(f"only {stop - start} readings are between the start and the noise floor")
    _refuse_small(fall(yb, begin, end))
    return EnvelopeWindow(start, stop, floor, (begins, ends))


def _refuse_small(drop: float) -> None:
    """Raise Refusal for a fall in dB that is too small."""
    if drop < LEAST_DROP:
        raise Refusal(f"the level falls by {max(drop, 0):.1f} dB, {LEAST_DROP:g} are needed")


def bounded(t: np.ndarray, y: np.ndarray, start: float | None, stop: float | None) -> EnvelopeWindow:
    """Return the window between given bounds, in s of the record's clock; None: as `find_window` finds it.

    Raises Refusal where too few readings are between them.
    """
    try:
        window = find_window(t, y)
    except Refusal:
        if start is None or stop is None:
            raise
        window = EnvelopeWindow(0, t.size, None, ("", ""))
    first, behind = window.start, window.stop
    begins, ends = window.why
    if start is not None:
        first = int(np.searchsorted(t, start))
    if stop is not None:
        behind = int(np.searchsorted(t, stop, side="right"))
    if behind - first < LEAST_POINTS:
        raise Refusal(
            f"{max(0, behind - first)} readings are between start and stop; at least {LEAST_POINTS} are needed"
        )
    if start is not None:
        begins = f"starts at {t[first]:.4g} s, as asked"
    if stop is not None:
        ends = f"ends at {t[behind - 1]:.4g} s, as asked"
    return EnvelopeWindow(first, behind, window.floor, (begins, ends))


def _straightest(levels: Levels) -> tuple[int, int]:
    """Return the first and last block of the descent that falls farthest for the misfit of a straight line.

    Levels are means of power, and none is below that of the record's end: a floor's dips are not a descent.
    """
    t, power, edges = blocks(levels.tb, 10.0 ** ((levels.yb - levels.yb.max()) / 10.0), COARSE)
    y = 10.0 * np.log10(power)
    y = np.maximum(y, 10.0 * np.log10(power[-max(1, y.size // 12) :].mean()))
    i, j = np.triu_indices(t.size + 1, k=min(4, t.size))
    slope, rms = _lines(t, y, i, j)
    falls = slope * (t[i] - t[j - 1])
    best = int(np.argmax(falls - MISFIT_WEIGHT * rms))
    if not falls[best] > 0:
        raise Refusal("the level never falls")
    return int(edges[i[best]]), int(edges[j[best]]) - 1


def _follow_back(levels: Levels, first: int, last: int) -> tuple[int, bool]:
    """Return the block at which the decay begins, and whether something else precedes it.

    Short straight lines are fitted to the readings; going back from the straight part, the first one that fits
    worse than those do, or falls at another rate, contains readings that are not part of the decay.
    """
    t, y = levels.tb, levels.yb
    span = last - first + 1
    width = max(NARROWEST, round(SHORT * span))
    if span < width + 2:
        return first, first > 0
    begins = np.arange(t.size - width + 1)
    slope, rms = _lines(t, y, begins, begins + width)
    behind = max(first + 2, min(first + 3 * span // 5, last - width))
    known = slice(min(first + span // 4, behind - 2), behind)
    rate = float(np.median(slope[known]))
    lag = min(width, (known.stop - known.start) // 2)
    wobble = float(np.median(np.abs(np.diff(slope[known][:: max(1, lag)])))) if lag else 0.0
    at = min(first + 2 * span // 5, known.stop - 1)
    while at > 0:
        ahead = slope[at : at + width]
        rate = float(np.median(ahead[ahead < 0])) if np.any(ahead < 0) else rate
        ratio = slope[at - 1] / rate
        odd = not SLOWEST <= ratio <= FASTEST and abs(slope[at - 1] - rate) > TOLERANCE * wobble
        usual = float(np.median(rms[at : at + AHEAD * width]))
        if odd or ratio < LEVEL or rms[at - 1] > max(WORSE * usual, SMALLEST / 3):
            near = slice(max(0, at - width), min(at + 2 * width, last + 1))
            hinge = near.start + _hinge(t[near], y[near])
            return min(max(at, hinge) + max(1, round(GUARD * span)), last - 3), True
        at -= 1
    return 0, False


def _hinge(t: np.ndarray, y: np.ndarray) -> int:
    """Return the reading from which a second straight line describes readings best, the first one those before it."""
    at = np.arange(3, t.size - 2)
    if at.size == 0:
        return 0
    before, after = _lines(t, y, np.zeros_like(at), at)[1], _lines(t, y, at, np.full_like(at, t.size))[1]
    return int(at[np.argmin(at * before**2 + (t.size - at) * after**2)])


def _lines(t: np.ndarray, y: np.ndarray, low: np.ndarray, high: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return slope and root mean square misfit of straight lines through readings low (k,) to, not with, high (k,)."""
    t = t - t.mean()
    terms = (np.ones_like(t), t, t * t, y, y * t, y * y)
    sums = [np.concatenate([[0.0], np.cumsum(term)]) for term in terms]
    n, st, stt, sy, sty, syy = (total[high] - total[low] for total in sums)
    spread = np.maximum(stt - st * st / n, 1e-300)
    slope = (sty - st * sy / n) / spread
    return slope, np.sqrt(np.maximum(syy - sy * sy / n - slope * slope * spread, 0.0) / n)


def _follow_on(levels: Levels, begin: int) -> tuple[int, SeenFloor | None]:
    """Return the block behind the decay's last one, and the floor that is measured behind it.

    A decay by a power of the amplitude, plus a floor, is fitted to the powers from the start on, robustly.
    """
    t, y, tb, yb, edges = levels.t, levels.y, levels.tb, levels.yb, levels.edges
    count = tb.size
    fit = fit_power_law(levels, begin)
    x, floor, floor_at, stop, scale = fit.x, fit.floor, fit.floor_at, fit.stop, fit.scale
    behind = slice(int(edges[floor_at]), stop)
    measured = SeenFloor(floor)
    if stop - behind.start > 4:
        power = 10.0 ** ((y[behind] - scale) / 10.0)
        floor = max(floor, float(power.mean()))
        rest = np.exp(2.0 * np.interp(t[behind], tb[begin:], x))
        took = float(tb[floor_at] - tb[begin])
        rate = float(x[0] - x[floor_at - begin]) / took if took > 0 else 0.0
        measured = measure_floor(t[behind], power, rest, rate)
    else:
        flat = _flat_end(tb[begin:], yb[begin:] - scale)
        if flat > 0:
            floor, floor_at = max(floor, flat), count - 1
            measured = SeenFloor(floor)
    end, after = count, yb[begin:]
    if after.size >= 2 * WILD_OVER:  # where levels scatter as at a floor, a decay cannot be recognised
        bends = (after[1:-1] - 0.5 * (after[:-2] + after[2:])) ** 2 / 1.5
        wild = np.flatnonzero(np.convolve(bends, np.ones(WILD_OVER) / WILD_OVER, "valid") > WILD**2)
        end = min(count, begin + int(wild[0]) + WILD_OVER // 2) if wild.size else count
    if floor_at == count and floor < 10.0 ** (-ABOVE_FLOOR / 10.0) * np.exp(2.0 * x[-1]):
        return end, None
    if _steepens(t, y, int(edges[begin]), int(edges[floor_at]), stop):
        return end, None
    limit = 10.0 ** (ABOVE_FLOOR / 10.0) * floor
    above = np.flatnonzero(np.exp(2.0 * x) < limit)
    end = min(end, begin + int(above[0])) if above.size else end
    if end - begin > SMOOTH:
        smooth = np.convolve(yb[begin:end], np.ones(SMOOTH) / SMOOTH, "valid")
        below = np.flatnonzero(smooth - scale < 10.0 * np.log10(limit) - 3.0)
        end = begin + int(below[0]) + SMOOTH // 2 if below.size else end
    return end, measured.scaled(10.0 ** (scale / 10.0))


def _steepens(t: np.ndarray, y: np.ndarray, begin: int, floor_at: int, stop: int) -> bool:
    """Return whether readings from `floor_at` to `stop`, or the last few, are a decay rather than a floor.

    They fall faster than those before do and are no rougher than the decay's first eighth, from `begin` on: one power
    of the amplitude does not follow this decay.
    """
    floor_at = min(floor_at, stop - LAST)
    before = slice(max(begin, floor_at - max(NARROWEST, (floor_at - begin) // 4)), floor_at)
    if before.stop - before.start < LEAST_POINTS:
        return False
    slope, usual = (
        float(np.polyfit(t[part] - t[floor_at], y[part], 1)[0]) for part in (slice(floor_at, stop), before)
    )
    early, late = y[begin : begin + max((floor_at - begin) // 8, LAST)], y[floor_at:stop]
    # Third differences, which a curve hardly has.
    rough_early, rough_late = (float(np.median(np.abs(np.diff(part, 3)))) for part in (early, late))
    return slope < usual < 0.0 and rough_late < ROUGHER * rough_early


def _flat_end(t: np.ndarray, y: np.ndarray) -> float:
    """Return the mean power of the last tenth or so of a record that no longer falls there; 0 where it still does."""
    part = y.size // 8
    if part < 3:
        return 0.0
    last, before = 10.0 ** (y[-part:] / 10.0), 10.0 ** (y[-2 * part : -part] / 10.0)
    step = float(t[-part:].mean() - t[-2 * part : -part].mean())
    middle = slice(y.size // 2, y.size // 2 + part)
    usual = float(y[:part].mean() - y[middle].mean()) / float(t[middle].mean() - t[:part].mean())
    fell = 10.0 * np.log10(before.mean() / last.mean())
    return float(last.mean()) if fell < FLAT * usual * step else 0.0
