"""Where the free decay stands in a record of an envelope: after the drive, before the noise floor."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from bayesdamp.records.envelope.floor import ABOVE_FLOOR, SeenFloor, seen_floor
from bayesdamp.records.envelope.one_law import (
    GUARD,
    LEAST_DROP,
    LEAST_POINTS,
    SMALLEST,
    WORSE,
    a_law_holds,
    blocks,
    fall,
    one_law,
    start_by_a_law,
)
from bayesdamp.types import Refusal

POINTS = 600
"""Blocks that a record is looked at in."""
COARSE = 72
"""Blocks among which the straightest descent is sought."""
LOST = 0.4
"""Share of the straightest descent that has to be left behind the start."""
SURE_DROP = 8.0
"""dB of descent that cannot be without a decay."""
SPARSE = 60
"""Readings below which a record is a table: no release and no floor is looked for."""
MISFIT_WEIGHT = 20.0
"""dB of fall that a dB of root mean square misfit of a straight line outweighs, conventional."""
NARROWEST = 10
ROUNDS = 4
SHORT = 0.12
"""Length of the short lines that find the release, as a share of the decay's duration."""
AHEAD = 2
"""Lengths of short lines ahead over which the usual misfit is taken: it grows towards the floor."""
SLOWEST, FASTEST = 0.4, 5.0
"""Shares of the rate after it beyond which a fall is none of the decay."""
FLAT = 0.2
"""Share of the rate before it at which a level falls no more."""
WILD, WILD_OVER = 2.5, 15
"""dB of scatter from one block to the next, over so many, at which a level is a floor's (of random phase: 5.6)."""
LAST, ROUGHER = 8, 3.0
"""Readings at least at a record's end that are looked at for what is steeper there; times the roughness of a decay's
first eighth that a floor, which scatters by 5.6 dB where it is of random phase, has at least."""
SMOOTH = 7
"""Blocks over which the level is smoothed where it is held against the floor's."""
LEVEL = 0.15
"""The same share below which it is none, however the slope wobbles."""
TOLERANCE = 3.0
"""Usual changes of the slope by which one has to be off to be none of the decay."""


@dataclass(frozen=True)
class Window:
    """The part of a record that decays freely.

    start, stop: indices of its first sample and behind its last one. why: sentences on how they were chosen.
    floor: what is seen of the noise floor behind it, None where the record does not reach it.
    """

    start: int
    stop: int
    floor: SeenFloor | None
    why: tuple[str, ...]


def find_window(t: np.ndarray, y: np.ndarray) -> Window:
    """The free decay in times (s) and levels (dB of power), both of shape (n,).

    It is looked for as by eye: the longest straight descent, followed back to where it begins (the reading before it
    stands above or below its continuation) and on to the noise floor. Raises Refusal where nothing decays.
    """
    if t.size < LEAST_POINTS:
        raise Refusal(f"{t.size} readings: an envelope needs at least {LEAST_POINTS}")
    if t.size < SPARSE:
        return _table(t, y)
    tb, yb, edges = blocks(t, y, POINTS)
    first, last = _straightest(tb, yb)
    core = fall(yb, first, last + 1)
    top = int(np.argmax(yb))
    # Or it falls from its highest block on, nowhere straight, by one power of the amplitude.
    bent = core < LEAST_DROP and fall(yb, top, yb.size) > SURE_DROP and a_law_holds(t, y, tb, yb, edges, top)
    if core < LEAST_DROP and not bent:
        raise Refusal(f"the level falls by {max(core, 0):.1f} dB, {LEAST_DROP:g} are needed")
    begin, broken = _followed_back(tb, yb, first, last)
    end, floor = _followed_on(t, y, begin, tb, yb, edges)
    if core > SURE_DROP and (fall(yb, begin, end) < LEAST_DROP or fall(yb, begin, last) < LOST * core):
        begin, broken = first, first > 0  # the short lines were told from none
        end, floor = _followed_on(t, y, begin, tb, yb, edges)
    begun = start_by_a_law(t, y, tb, yb, edges, begin, end)
    if begun != begin:
        behind, lower = _followed_on(t, y, begun, tb, yb, edges)
        # Unless what it takes for its floor is a decay.
        if min(fall(yb, begin, end), fall(yb, behind, end)) < LEAST_DROP:
            begin, broken, end, floor = begun, begun > 0, behind, lower
    start, stop = int(edges[begin]), int(edges[end])
    begins = "starts with the record" if begin == 0 else f"starts at {t[start]:.4g} s, the highest reading"
    if broken:
        begins = f"starts at {t[start]:.4g} s, where the reading before it is no continuation of the decay"
    ends = "ends with the record, above any floor" if stop == t.size else f"ends at {t[stop - 1]:.4g} s"
    if floor is not None:
        ends = f"ends at {t[stop - 1]:.4g} s, {ABOVE_FLOOR:g} dB above the noise floor"
    if stop - start < LEAST_POINTS:
        raise Refusal(f"{stop - start} readings stand between the start and the noise floor")
    drop = fall(yb, begin, end)
    if drop < LEAST_DROP:
        raise Refusal(f"the level falls by {max(drop, 0):.1f} dB, {LEAST_DROP:g} are needed")
    return Window(start, stop, floor, (begins, ends))


def _table(t: np.ndarray, y: np.ndarray) -> Window:
    """The decay in a table of few readings: from the highest one on, which somebody has read off a decay already."""
    start = int(np.argmax(y))
    if t.size - start < LEAST_POINTS:
        raise Refusal(
            f"{t.size - start} readings from the highest one on: at least {LEAST_POINTS} are needed"
        )
    drop = float(y[start] - y[-1])
    if drop < LEAST_DROP:
        raise Refusal(f"the level falls by {max(drop, 0):.1f} dB, {LEAST_DROP:g} are needed")
    begins = "starts with the record" if start == 0 else f"starts at {t[start]:.4g} s, the highest reading"
    return Window(start, t.size, None, (begins, "ends with the record"))


def bounded(t: np.ndarray, y: np.ndarray, start: float | None, stop: float | None) -> Window:
    """The window with bounds that were given, in s of the record's clock; None: as it is found. Raises Refusal."""
    try:
        found = find_window(t, y)
    except Refusal:
        if start is None or stop is None:
            raise
        found = Window(0, t.size, None, ("", ""))
    first = found.start if start is None else int(np.searchsorted(t, start))
    behind = found.stop if stop is None else int(np.searchsorted(t, stop, side="right"))
    if behind - first < LEAST_POINTS:
        raise Refusal(
            f"{max(0, behind - first)} readings stand between start and stop; at least {LEAST_POINTS} must"
        )
    why = (
        found.why[0] if start is None else f"starts at {t[first]:.4g} s, as asked",
        found.why[1] if stop is None else f"ends at {t[behind - 1]:.4g} s, as asked",
    )
    return Window(first, behind, found.floor, why)


def _straightest(t: np.ndarray, y: np.ndarray) -> tuple[int, int]:
    """First and last block of the descent that falls farthest for the misfit of a straight line.

    Levels are means of power, and none is below that of the record's end: a floor's dips are no descent.
    """
    tc, power, edges = blocks(t, 10.0 ** ((y - y.max()) / 10.0), COARSE)
    yc = 10.0 * np.log10(power)
    yc = np.maximum(yc, 10.0 * np.log10(power[-max(1, yc.size // 12) :].mean()))
    i, j = np.triu_indices(tc.size + 1, k=min(4, tc.size))
    slope, rms = _lines(tc, yc, i, j)
    falls = slope * (tc[i] - tc[j - 1])
    best = int(np.argmax(falls - MISFIT_WEIGHT * rms))
    if not falls[best] > 0:
        raise Refusal("the level nowhere falls")
    return int(edges[i[best]]), int(edges[j[best]]) - 1


def _followed_back(t: np.ndarray, y: np.ndarray, first: int, last: int) -> tuple[int, bool]:
    """The block at which the decay begins, and whether something else stands before it.

    Short straight lines are laid through the readings; going back from the straight part, the first one that fits
    worse than those do, or falls at another rate, reaches into what is none of the decay.
    """
    broken = first > 0
    for _ in range(ROUNDS):
        before = first
        first, broken = _once_back(t, y, first, last)
        if abs(first - before) <= 1:
            break
    return first, broken


def _once_back(t: np.ndarray, y: np.ndarray, first: int, last: int) -> tuple[int, bool]:
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
        odd = odd or ratio < LEVEL
        usual = float(np.median(rms[at : at + AHEAD * width]))
        if odd or rms[at - 1] > max(WORSE * usual, SMALLEST / 3):
            near = slice(max(0, at - width), min(at + 2 * width, last + 1))
            hinge = near.start + _hinge(t[near], y[near])
            return min(max(at, hinge) + max(1, round(GUARD * span)), last - 3), True
        at -= 1
    return 0, False


def _hinge(t: np.ndarray, y: np.ndarray) -> int:
    """The reading from which a second straight line describes readings best, the first one those before it."""
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


def _followed_on(
    t: np.ndarray, y: np.ndarray, begin: int, tb: np.ndarray, yb: np.ndarray, edges: np.ndarray
) -> tuple[int, SeenFloor | None]:
    """The block behind the decay's last, and the floor that is seen.

    A decay by a power of the amplitude, plus a floor, is fitted to the powers from the start on, robustly.
    """
    count = tb.size
    x, floor, seen, stop, scale = one_law(t, y, begin, tb, edges)
    behind = slice(int(edges[seen]), stop)
    known = SeenFloor(floor)
    if stop - behind.start > 4:
        power = 10.0 ** ((y[behind] - scale) / 10.0)
        floor = max(floor, float(power.mean()))
        rest = np.exp(2.0 * np.interp(t[behind], tb[begin:], x))
        took = float(tb[seen] - tb[begin])
        known = seen_floor(t[behind], power, rest, float(x[0] - x[seen - begin]) / took if took > 0 else 0.0)
    else:
        flat = _flat_end(tb[begin:], yb[begin:] - scale)
        if flat > 0:
            floor, seen = max(floor, flat), count - 1
            known = SeenFloor(floor)
    end = min(count, begin + _calm(yb[begin:]))
    if seen == count and floor < 10.0 ** (-ABOVE_FLOOR / 10.0) * np.exp(2.0 * x[-1]):
        return end, None
    if _steepens(t, y, int(edges[begin]), int(edges[seen]), stop):
        return end, None
    limit = 10.0 ** (ABOVE_FLOOR / 10.0) * floor
    above = np.flatnonzero(np.exp(2.0 * x) < limit)
    end = min(end, begin + int(above[0])) if above.size else end
    if end - begin > SMOOTH:
        smooth = np.convolve(yb[begin:end], np.ones(SMOOTH) / SMOOTH, "valid")
        below = np.flatnonzero(smooth - scale < 10.0 * np.log10(limit) - 3.0)
        end = begin + int(below[0]) + SMOOTH // 2 if below.size else end
    return end, known.scaled(10.0 ** (scale / 10.0))


def _steepens(t: np.ndarray, y: np.ndarray, begin: int, seen: int, stop: int) -> bool:
    """Whether readings from `seen` to `stop`, or the last few, fall faster than those before do and are no rougher than
    the decay's first eighth, from `begin` on: no floor, but a decay that one power of the amplitude does not follow."""
    seen = min(seen, stop - LAST)
    before = slice(max(begin, seen - max(NARROWEST, (seen - begin) // 4)), seen)
    if before.stop - before.start < LEAST_POINTS:
        return False
    slope, usual = (float(np.polyfit(t[one] - t[seen], y[one], 1)[0]) for one in (slice(seen, stop), before))
    early, late = y[begin : begin + max((seen - begin) // 8, LAST)], y[seen:stop]
    return slope < usual < 0.0 and _rough(late) < ROUGHER * _rough(early)


def _rough(y: np.ndarray) -> float:
    """Median size of third differences, which a curve hardly has."""
    return float(np.median(np.abs(np.diff(y, 3))))


def _flat_end(t: np.ndarray, y: np.ndarray) -> float:
    """Mean power of the last tenth or so of a record that falls no more there; 0 where it still does."""
    part = y.size // 8
    if part < 3:
        return 0.0
    last, before = 10.0 ** (y[-part:] / 10.0), 10.0 ** (y[-2 * part : -part] / 10.0)
    step = float(t[-part:].mean() - t[-2 * part : -part].mean())
    half = y.size // 2
    usual = float(y[:part].mean() - y[half : half + part].mean()) / float(
        t[half : half + part].mean() - t[:part].mean()
    )
    fell = 10.0 * np.log10(before.mean() / last.mean())
    return float(last.mean()) if fell < FLAT * usual * step else 0.0


def _calm(y: np.ndarray) -> int:
    """How many levels stand before they scatter as at a floor: there no decay is told from it."""
    if y.size < 2 * WILD_OVER:
        return y.size
    bends = (y[1:-1] - 0.5 * (y[:-2] + y[2:])) ** 2 / 1.5
    wild = np.flatnonzero(np.convolve(bends, np.ones(WILD_OVER) / WILD_OVER, "valid") > WILD**2)
    return int(wild[0]) + WILD_OVER // 2 if wild.size else y.size
