"""Where the free decay stands in a record of an envelope: after the drive, before the noise floor."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from bayesdamp.types import Refusal

POINTS = 600
"""Blocks that a record is looked at in."""
COARSE = 72
"""Blocks among which the straightest descent is sought."""
ABOVE_FLOOR = 10.0
"""dB above the mean power of the floor where a decay ends: there a Gaussian in the logarithm still describes what the
floor does to it, and its mean is right to 1e-5 (the logarithm of a circular Gaussian's power plus a constant's)."""
LEAST_DROP = 3.0
"""dB that a decay has to fall for its rate to be told; a half-life is 6."""
LEAST_POINTS = 6
MISFIT_WEIGHT = 8.0
"""dB of fall that a dB of root mean square misfit of a straight line outweighs, conventional."""
GUARD = 0.02
"""Share of the decay's duration left out after the release where a drive stands before it."""
SHORT = 0.12
"""Length of the short lines that find the release, as a share of the decay's duration."""
WORSE = 2.0
"""Times the usual misfit of a short line at which it is none of the decay."""
SLOWEST = 0.4
"""Share of the rate after it (and the inverse of its multiple) below which a fall is none of the decay."""
SMALLEST = 0.15
"""dB that is no deviation: detectors are not linear to better."""


@dataclass(frozen=True)
class Window:
    """The part of a record that decays freely.

    start, stop: indices of its first sample and behind its last one. why: sentences on how they were chosen.
    floor: mean power of the floor in the unit of the reading's power, nan where the record does not reach it.
    floor_share: of that power what does not fluctuate, 0 to 1. floor_start: index from which the floor is seen.
    """

    start: int
    stop: int
    floor: float
    floor_share: float
    floor_start: int
    why: tuple[str, ...]


def blocks(t: np.ndarray, y: np.ndarray, most: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Means of times and values over at most so many runs of samples, and the runs' bounds, shape (blocks + 1,)."""
    count = min(most, t.size)
    edges = np.linspace(0, t.size, count + 1).round().astype(int)
    size = np.diff(edges)
    return np.add.reduceat(t, edges[:-1]) / size, np.add.reduceat(y, edges[:-1]) / size, edges


def find_window(t: np.ndarray, y: np.ndarray) -> Window:
    """The free decay in times (s) and levels (dB of power), both of shape (n,).

    It is looked for as by eye: the longest straight descent, followed back to where it begins (the reading before it
    stands above or below its continuation) and on to the noise floor. Raises Refusal where nothing decays.
    """
    if t.size < LEAST_POINTS:
        raise Refusal(f"{t.size} readings: an envelope needs at least {LEAST_POINTS}")
    tb, yb, edges = blocks(t, y, POINTS)
    first, last = _straightest(tb, yb)
    begin, broken = _followed_back(tb, yb, first, last)
    end, floor, share, floor_at = _followed_on(tb, yb, t, y, begin, last, edges)
    why = []
    start = int(edges[begin])
    if broken:
        why.append(f"starts at {t[start]:.4g} s, where the reading before it is no continuation of the decay")
    else:
        why.append("starts with the record" if begin == 0 else f"starts at {t[start]:.4g} s, the highest reading")
    stop = int(edges[end])
    if np.isfinite(floor):
        why.append(f"ends at {t[stop - 1]:.4g} s, {ABOVE_FLOOR:g} dB above the noise floor")
    else:
        why.append("ends with the record, above any floor" if stop == t.size else f"ends at {t[stop - 1]:.4g} s")
    if stop - start < LEAST_POINTS:
        raise Refusal(f"no free decay: {stop - start} readings stand between the start and the noise floor")
    drop = yb[begin : begin + max(1, (end - begin) // 20)].mean() - yb[max(begin, end - max(1, (end - begin) // 20)) : end].mean()
    if drop < LEAST_DROP:
        raise Refusal(f"no free decay: the level falls by {max(drop, 0):.1f} dB, {LEAST_DROP:g} are needed")
    return Window(start, stop, floor, share, int(edges[floor_at]), tuple(why))


def _straightest(t: np.ndarray, y: np.ndarray) -> tuple[int, int]:
    """First and last block of the descent that falls farthest for the misfit of a straight line."""
    tc, yc, edges = blocks(t, y, COARSE)
    tc = tc - tc.mean()
    sums = [np.concatenate([[0.0], np.cumsum(v)]) for v in (np.ones_like(tc), tc, tc * tc, yc, yc * tc, yc * yc)]
    i, j = np.triu_indices(tc.size + 1, k=min(4, tc.size))
    n, st, stt, sy, sty, syy = (s[j] - s[i] for s in sums)
    vt = np.maximum(stt - st * st / n, 1e-300)
    slope = (sty - st * sy / n) / vt
    rms = np.sqrt(np.maximum(syy - sy * sy / n - slope * slope * vt, 0.0) / n)
    fall = -slope * (tc[j - 1] - tc[i])
    best = int(np.argmax(fall - MISFIT_WEIGHT * rms))
    if fall[best] <= 0:
        raise Refusal("no free decay: the level nowhere falls")
    return int(edges[i[best]]), int(edges[j[best]]) - 1


def _followed_back(t: np.ndarray, y: np.ndarray, first: int, last: int) -> tuple[int, bool]:
    """The block at which the decay begins, and whether something else stands before it.

    Short straight lines are laid through the readings; going back from the straight part, the first one that fits
    worse than those do, or falls at another rate, reaches into what is none of the decay.
    """
    span = last - first + 1
    width = max(5, round(SHORT * span))
    if last - first < width:
        return first, first > 0
    slope, rms = _short_lines(t, y, width)
    known = slice(first, max(first + 1, min(first + span // 2, last - width)))
    usual, rate = float(np.median(rms[known])), float(np.median(slope[known]))
    at = min(first + span // 4, known.stop - 1)
    limit = max(WORSE * usual, SMALLEST / 3)
    while at > 0:
        ahead = slope[at : at + width]
        rate = float(np.median(ahead[ahead < 0])) if np.any(ahead < 0) else rate
        if rms[at - 1] > limit or not SLOWEST <= slope[at - 1] / rate <= 1.0 / SLOWEST:
            return min(at + max(1, round(GUARD * span)), last - 3), True
        at -= 1
    return 0, False


def _short_lines(t: np.ndarray, y: np.ndarray, width: int) -> tuple[np.ndarray, np.ndarray]:
    """Slope and root mean square misfit of the straight line through each run of so many readings."""
    times, levels = (np.lib.stride_tricks.sliding_window_view(v, width) for v in (t, y))
    lag = times - times.mean(axis=1, keepdims=True)
    off = levels - levels.mean(axis=1, keepdims=True)
    slope = (lag * off).sum(axis=1) / (lag * lag).sum(axis=1)
    return slope, np.sqrt(np.mean((off - slope[:, None] * lag) ** 2, axis=1))


def _followed_on(
    tb: np.ndarray, yb: np.ndarray, t: np.ndarray, y: np.ndarray, begin: int, last: int, edges: np.ndarray
) -> tuple[int, float, float, int]:
    """(block behind the decay's last, mean power of the floor, its constant share, block from which it is seen)."""
    count = tb.size
    bend = _bend(tb[begin:], yb[begin:])
    if bend is None:
        return count, np.nan, 0.0, count
    bend += begin
    slope, level = np.polyfit(tb[begin:bend], yb[begin:bend], 1)
    behind = min(count, bend + max(8, bend - begin))
    power = 10.0 ** (y[edges[bend] : edges[behind]] / 10.0)
    floor = float(power.mean())
    decibels = 10.0 * np.log10(floor)
    late = slice(begin + (bend - begin) * 3 // 5, bend)
    slope, level = np.polyfit(tb[late], yb[late], 1)
    if slope >= 0 or decibels > level + slope * tb[bend - 1] + 6.0:
        return bend, np.nan, 0.0, count
    crossing = (decibels + ABOVE_FLOOR - level) / slope
    end = int(np.clip(np.searchsorted(tb, crossing), begin + 3, bend))
    share = float(np.clip(1.0 - power.std() / floor, 0.0, 1.0))
    return end, floor, share, bend


def _bend(t: np.ndarray, y: np.ndarray) -> int | None:
    """The block at which a decay gives way to a level that stays, each with its own scatter; None where none does."""
    count = t.size
    if count < 12:
        return None
    time = (t - t[0]) / max(t[-1] - t[0], 1e-300)
    candidates = np.unique(np.linspace(5, count - 4, min(80, count - 8)).astype(int))
    costs = []
    for at in candidates:
        off = y[:at] - np.polyval(np.polyfit(time[:at], y[:at], 2), time[:at])
        tail = y[at:] - y[at:].mean()
        costs.append(at * np.log(off.std() + SMALLEST) + (count - at) * np.log(tail.std() + SMALLEST))
    whole = y - np.polyval(np.polyfit(time, y, 2), time)
    best = int(np.argmin(costs))
    # Readings of a block are alike, so that what speaks for a bend is a tenth of what independent ones would say.
    if count * np.log(whole.std() + SMALLEST) - costs[best] < 0.1 * count:
        return None
    return int(candidates[best])
