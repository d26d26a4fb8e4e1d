"""Where a free decay begins and ends in a record: after the release, before the rest."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from bayesdamp.signals.rough import roughness
from bayesdamp.signals.spectrum import coarse_period
from bayesdamp.signals.turning import Turning, midpoints, turning_points
from bayesdamp.types import InputError

STEPS = 2.0
"""A turning point nearer to the midline than so many recording steps tells nothing of the damping."""
SIGMAS = 2.0
"""The same in standard deviations of the noise."""
SHARE = 0.3
"""Share that an oscillation must have in a record, beyond what white noise would give."""


@dataclass(frozen=True)
class Window:
    """First and last sample (counted from 0, both kept) and why, in sentences."""

    first: int
    last: int
    notes: tuple[str, ...]


def free_decay(
    t: np.ndarray, y: np.ndarray, step: float, seek_start: bool, seek_stop: bool, name: str
) -> Window:
    """The window of a record t (s), y, shape (n,), in which it decays freely.

    step: the recording step in the unit of y. seek_start, seek_stop: which of the two ends to look for; the
    other stays. Raises InputError where nothing oscillates.
    """
    longest = float(t[-1] - t[0])
    period, share = coarse_period(t, y, longest)
    if share < SHARE:
        raise InputError(
            f"{name}: no oscillation stands out of the noise (share of the best sinusoid {share:.2f})"
        )
    noise = roughness(t, y, period)
    turns = _main_run(turning_points(t, y, period, noise), max(STEPS * step, SIGMAS * noise))
    if turns.times.size < 3:
        raise InputError(
            f"{name}: no oscillation: fewer than three turning points stand out of noise and rounding"
        )
    notes: list[str] = []
    first, last = 0, t.size - 1
    if seek_start:
        first = _start(t, y, turns, noise, step, notes)
    if seek_stop:
        last = _stop(t, turns, notes)
    return Window(first, last, tuple(notes))


def _main_run(turns: Turning, floor: float) -> Turning:
    """The turning points from the first to the last that are in step and further than `floor` from the
    midline.
    """
    if turns.times.size < 3:
        return turns
    gaps = np.diff(turns.times)
    typical = np.array([np.median(gaps[max(i - 4, 0) : i + 5]) for i in range(gaps.size)])
    good = (gaps > 0.55 * typical) & (gaps < 1.6 * typical) & (np.abs(np.diff(turns.values)) > 2 * floor)
    edges = np.flatnonzero(np.diff(np.concatenate([[0], good.astype(int), [0]])))
    if edges.size == 0:
        return turns.cut(0, 0)
    runs = list(zip(edges[::2], edges[1::2]))
    best = int(np.argmax([b - a for a, b in runs]))
    low, high = best, best
    while low > 0 and runs[low][0] - runs[low - 1][1] <= 1:  # one turning point that a disturbance spoiled
        low -= 1
    while high < len(runs) - 1 and runs[high + 1][0] - runs[high][1] <= 1:
        high += 1
    return turns.cut(int(runs[low][0]), int(runs[high][1]) + 1)


def _misfit(t: np.ndarray, y: np.ndarray, begin: float, end: float, half: float) -> float:
    """Rms distance of the samples in [begin, end] from one sinusoid with overtone and slow changes (robust to
    none).
    """
    a, b = np.searchsorted(t, (begin - 1e-12, end + 1e-12))
    if b - a < 3:
        return 0.0
    x = np.pi * (t[a:b] - (begin + end) / 2) / half
    c, s = np.cos(x), np.sin(x)
    columns = np.stack([np.ones_like(x), c, s, x, x * c, x * s, np.cos(2 * x), np.sin(2 * x)], axis=1)
    columns = columns[:, : max(min(8, (b - a) // 2), 1)]
    rest = y[a:b] - columns @ np.linalg.lstsq(columns, y[a:b], rcond=1e-8)[0]
    return float(np.sqrt(np.sum(rest**2) / (b - a - columns.shape[1] or 1)))


def _start(t: np.ndarray, y: np.ndarray, turns: Turning, noise: float, step: float, notes: list[str]) -> int:
    """The first sample of the free decay: of the record if it begins in it, else at the first clean turning
    point.
    """
    k = turns.times.size
    sizes = np.abs(turns.values - midpoints(turns.values))
    gaps = np.diff(turns.times)
    floor = 2 * noise + step
    swings = [_misfit(t, y, turns.times[i], turns.times[i + 1], gaps[i]) for i in range(min(k - 1, 24))]
    most = min(12, (k - 1) // 3)

    def clean(i: int) -> bool:
        """Whether the swing from turning point i on looks like those after it."""
        later = swings[i + 1 : i + 9]
        if not later:
            return True
        if swings[i] > max(5 * float(np.median(later)), 0.01 * sizes[i]) and swings[i] > floor / 3:
            return False
        n = min(8, k - i - 2)
        if n < 5:
            return True
        x = np.arange(1, n + 1)
        ranges = np.abs(np.diff(turns.values[i : i + n + 2]))
        curve = np.polynomial.Polynomial.fit(x, np.log(ranges[1:]), 2 if n >= 6 else 1)
        scatter = float(np.std(np.log(ranges[1:]) - curve(x)))
        back = abs(np.log(ranges[0]) - float(curve(0.0)))
        return back < max(0.06, 6 * scatter, 4 * floor / ranges[0])

    at = next((i for i in range(most + 1) if clean(i)), most)
    if at == 0:
        before = turns.times[0] - t[0]
        whole = _misfit(t, y, t[0], turns.times[1], gaps[0])
        usual = float(np.median(swings[1:9])) if len(swings) > 1 else swings[0]
        begins = before <= 1.1 * gaps[0] and whole <= max(5 * usual, 0.01 * sizes[0], floor / 3)
        if begins and _reaches(t, y, turns, sizes, floor):
            return 0
    first = int(np.searchsorted(t, turns.times[at] - 1e-12))
    notes.append(
        f"The start ({t[first]:.6g} s, sample {first}) is the {_ordinal(at + 1)} turning point: "
        "before it the record is at rest, held, or disturbed by the release."
    )
    return first


def _reaches(t: np.ndarray, y: np.ndarray, turns: Turning, sizes: np.ndarray, floor: float) -> bool:
    """Whether what comes before the first turning point does not exceed the swing that it should belong to."""
    before = y[t < turns.times[0]]
    if before.size == 0:
        return True
    middle = midpoints(turns.values)[0]
    return bool(np.abs(before - middle).max() <= 1.35 * sizes[0] + floor)


def _stop(t: np.ndarray, turns: Turning, notes: list[str]) -> int:
    """The last sample of the free decay: the record's, or the last turning point that tells something."""
    gap = float(np.median(np.diff(turns.times)[-5:]))
    if t[-1] - turns.times[-1] <= 1.2 * gap:
        return t.size - 1
    last = int(np.searchsorted(t, turns.times[-1] + 1e-12)) - 1
    notes.append(
        f"The stop ({t[last]:.6g} s, sample {last}) is the last turning point that stands out of noise and rounding; "
        "after it the record is at rest or all but."
    )
    return last


def _ordinal(n: int) -> str:
    return {1: "first", 2: "second", 3: "third"}.get(n, f"{n}th")
