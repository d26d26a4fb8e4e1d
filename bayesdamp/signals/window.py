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
    if turns.times.size >= 3:  # the noise at rest says little of the noise in motion
        a, b = np.searchsorted(t, (turns.times[0], turns.times[-1]))
        noise = roughness(t[a : b + 1], y[a : b + 1], period)
        turns = _main_run(turns, max(STEPS * step, SIGMAS * noise))
    if turns.times.size < 3:
        raise InputError(
            f"{name}: no oscillation: fewer than three turning points stand out of noise and rounding"
        )
    notes: list[str] = []
    first, last = 0, t.size - 1
    if seek_start:
        first = _start(t, y, turns, 2 * noise + step, notes)
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
    good = (gaps > 0.7 * typical) & (gaps < 1.6 * typical) & (np.abs(np.diff(turns.values)) > 2 * floor)
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


def _misfit(t: np.ndarray, y: np.ndarray, begin: float, end: float, half: float) -> tuple[float, float]:
    """(rms, largest) distance of the samples in [begin, end] from a slowly changing sinusoid and overtone.

    half: half a period in s.
    """
    a, b = np.searchsorted(t, (begin - 1e-12, end + 1e-12))
    if b - a < 3:
        return 0.0, 0.0
    x = np.pi * (t[a:b] - (begin + end) / 2) / half
    c, s = np.cos(x), np.sin(x)
    columns = np.stack([np.ones_like(x), c, s, x, x * c, x * s, np.cos(2 * x), np.sin(2 * x)], axis=1)
    columns = columns[:, : max(min(8, (b - a) // 2), 1)]
    rest = y[a:b] - columns @ np.linalg.lstsq(columns, y[a:b], rcond=1e-8)[0]
    return float(np.sqrt(np.sum(rest**2) / max(b - a - columns.shape[1], 1))), float(np.abs(rest).max())


def _start(t: np.ndarray, y: np.ndarray, turns: Turning, floor: float, notes: list[str]) -> int:
    """The first sample of the free decay: the record's own, or that of the first clean turning point.

    floor: what noise and rounding can do to one swing, in the unit of y.
    """
    sizes = np.abs(turns.values - midpoints(turns.values))
    ranges = np.log(np.abs(np.diff(turns.values[:24])))
    gaps = np.diff(turns.times)
    swings = np.array(
        [_misfit(t, y, turns.times[i], turns.times[i + 1], gaps[i]) for i in range(min(gaps.size, 24))]
    )

    def shaped(misfit: tuple[float, float] | np.ndarray, i: int) -> bool:
        """Whether a misfit is no more than those of the swings from i on."""
        later = swings[i : i + 8]
        usual = np.median(later, axis=0) if later.size else np.zeros(2)
        limit = np.maximum(5 * usual, np.array([0.01 * sizes[0], 0.02 * sizes[0]]))
        return bool(np.all(misfit <= np.maximum(limit, np.array([0.3, 0.6]) * floor)))

    def in_step(i: int) -> bool:
        """Whether the amplitude falls in the period from turning point i on as the later ones foretell."""
        falls = ranges[i + 2 : i + 9] - ranges[i : i + 7][: ranges[i + 2 : i + 9].size]
        if falls.size < 5:
            return True
        x = np.arange(1, falls.size)
        curve = np.polynomial.Polynomial.fit(x, falls[1:], 2 if x.size >= 5 else 1)
        scatter = float(np.std(falls[1:] - curve(x)))
        foretold = float(curve(0.0))
        return abs(falls[0] - foretold) <= max(0.1 * abs(foretold), 5 * scatter, floor / np.exp(ranges[i]))

    def in_time(i: int) -> bool:
        """Whether swing i lasts as long as the later ones foretell: a hand lets go when it likes."""
        later = gaps[i + 1 : i + 6]
        if later.size < 2:
            return True
        x = np.arange(1, later.size + 1)
        line = np.polynomial.Polynomial.fit(x, later, 1 if later.size > 2 else 0)
        scatter = float(np.std(later - line(x)))
        return abs(gaps[i] - float(line(0.0))) <= max(0.05 * float(np.median(later)), 5 * scatter)

    most = min(6, gaps.size // 4)
    clean = (i for i in range(most + 1) if in_time(i) and shaped(swings[i], i + 1) and in_step(i))
    at = next(clean, 0)
    if at == 0 and turns.times[0] - t[0] <= 1.1 * gaps[0]:
        opening = _misfit(t, y, float(t[0]), turns.times[1], gaps[0])
        if shaped(opening, 1) and _reaches(t, y, turns, sizes, floor):
            return 0
    first = int(np.searchsorted(t, turns.times[at] - 1e-12))
    notes.append(
        f"The start ({t[first]:.6g} s, sample {first} from 0) is the {_ordinal(at + 1)} turning point: "
        "what is before it is rest, a hand, a disturbed release, or a swing quite unlike the later ones."
    )
    return first


def _reaches(t: np.ndarray, y: np.ndarray, turns: Turning, sizes: np.ndarray, floor: float) -> bool:
    """Whether what comes before the first turning point does not exceed the swing that it belongs to."""
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
        f"The stop ({t[last]:.6g} s, sample {last} from 0) is the last turning point that stands out "
        "of noise and rounding; after it the record is at rest or all but."
    )
    return last


def _ordinal(n: int) -> str:
    return {1: "first", 2: "second", 3: "third"}.get(n, f"{n}th")
