"""Whether a record is the free decay of one oscillator, and if not, what is seen instead and how large it is."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from typing import Literal

import numpy as np

from bayesdamp.records.oscillation.features import LEAST_SHARE, wandering
from bayesdamp.records.oscillation.modes import Modes, damped_modes, few_samples
from bayesdamp.records.oscillation.rough import roughness
from bayesdamp.records.oscillation.spectrum import coarse_period
from bayesdamp.records.oscillation.turning import zigzag

EXPLAINED = 0.95
"""Share of what one damped sinusoid leaves that a second must explain, and of the whole that both must."""
SIGMAS = 6.0
"""Standard errors of a rate from which an oscillation grows."""
GROWN = 1.05
"""By which factor an oscillation must grow over the record."""
CLOSE = 0.2
"""Relative distance of two frequencies below which their sum is told from one oscillator by its rising amplitude
alone: the frequency of one may change with its amplitude by so much."""
HARMONIC = 0.05
"""Relative distance from a whole multiple of the first frequency below which a second is one oscillator's harmonic."""
LIFTED = 0.05
"""Rise of the amplitude, relative to itself then, from which close frequencies are two oscillations."""
CLEAR = 3.0
"""Standard deviations of a sample by which a range of a period must exceed an earlier one; its own is about one."""
TOGETHER = 2
"""Swings that must rise together."""
GONE, PASSING = 0.01, 15.0
"""Share of the first oscillation to which a second one must fall within so many cycles to be a passing one."""
STEADY = 0.1
"""Share of the other's decay rate below which an oscillation is kept up by a drive."""
HOLE = 0.2
"""Part of a period without a sample in which a turning point may be missed."""
CYCLES = 3.0
"""Cycles of the slower mode below which nothing is said."""
WANDERING = 8.0
"""Cycles of a smaller, slower oscillation that does not decay below which it is a base line that wanders."""
UNSEEN = 3.0
"""Standard errors of a rate below which no decay is seen."""
KEPT = 0.05
"""Fall of the amplitude over a record, or over its last third, below which something keeps it up: of damping by a power
of the velocity up to the third an amplitude that has halved falls by 10 % and more in the last third."""
HALVED = 2.0
"""By how much the amplitude falls at least before it stays."""
AGAIN, RISES, SLOWLY = 1.5, 4, 3
"""By how much an amplitude rises, how many times, and in how many periods at least, where it is excited all along."""
RISING = 0.25
"""Share of the record in which it does so, at least: half where chance does it, little where a hand lets go again and
again."""
ABOVE = 20.0
"""Standard deviations of a sample by which a range of a period must exceed it, to be an oscillation that stays."""


@dataclass(frozen=True)
class NotOne:
    """What is seen. modes: one that grows or stays, or two. size: of the second mode, relative to the largest amplitude
    of the first; of growth, the factor by which it grows less 1; of one that stays, 1; of one that is excited all
    along, how many times its amplitude rises. There rates are nan, and amplitudes the least and the largest."""

    seen: Literal["growing", "steady", "beats", "two modes", "driven", "excited"]
    modes: Modes
    size: float


def other_than_one(t: np.ndarray, y: np.ndarray, period: float, harmonics: bool = False) -> NotOne | None:
    """What values y (n,) at times t (n,), s, are if not the free decay of one oscillator of about this period in s;
    None where nothing speaks against that.

    A second mode is believed where two damped sinusoids explain nearly all, one does not, and what both make together
    is nothing that one oscillator does, be it linear or not: another frequency that is no harmonic, or an amplitude
    that rises, or falls and then stays. harmonics: whether a second mode at a whole multiple of the frequency, or
    one that is soon gone, is believed too.
    """
    t, y = few_samples(np.asarray(t, float), np.asarray(y, float), period)
    if t.size < 20:
        return None
    one = damped_modes(t, y, 1)
    found = None if one is None or one.left >= 1 else _modes_of(t, y, one, harmonics)
    return found or excited(t, y, period)


def _modes_of(t: np.ndarray, y: np.ndarray, one: Modes, harmonics: bool) -> NotOne | None:
    """What one damped sinusoid that does not decay shows, or two."""
    grows = one.rates[0] < -SIGMAS * one.errors[0] and one.last[0] > GROWN * one.first[0]
    if one.left < 1 - EXPLAINED and grows:
        return NotOne("growing", one, float(one.last[0] / one.first[0] - 1))
    if one.left < 1 - EXPLAINED and _stays(one, float(t[-1] - t[0])):
        return NotOne("steady", one, 1.0)
    two = damped_modes(t, y, 2)
    if two is None or two.left > (1 - EXPLAINED) or two.left > 0.5 * one.left:
        return None
    if not harmonics and passing(two, float(t[-1] - t[0]) / 4):
        return None
    largest = np.maximum(two.first, two.last)
    size = float(largest[1] / largest[0])
    kept_up, falling = sorted(
        two.rates.tolist()
    )  # kept up: it does not halve in the record, while the other decays
    steady = abs(kept_up) < min(STEADY * falling, np.log(HALVED) / float(t[-1] - t[0]))
    f, g = float(two.frequencies.min()), float(two.frequencies.max())
    if f * float(t[-1] - t[0]) < CYCLES:
        return None
    slow = int(np.argmin(two.frequencies))
    if slow == 1 and f * float(t[-1] - t[0]) < WANDERING and two.rates[slow] < UNSEEN * two.errors[slow]:
        return None  # a base line that wanders
    if g / f - 1 < CLOSE:
        ranges, noise = _ranges(t, y, 1 / f), float(np.std(y)) * two.left**0.5
        if lifted(ranges, noise) < LIFTED and not (
            steady and _levels(two, ranges, noise, float(t[-1] - t[0]))
        ):
            return None
        return NotOne("driven" if steady else "beats", two, size)
    multiple = two.frequencies[1] / two.frequencies[0]
    if not harmonics and multiple > 1 and abs(multiple - round(multiple)) < HARMONIC * multiple:
        return None
    return NotOne("driven" if steady else "two modes", two, size)


def excited(t: np.ndarray, y: np.ndarray, period: float) -> NotOne | None:
    """An amplitude of values y (n,) at times t (n,), s, that rises again and again, as slowly as it falls, and in the
    end is what it was: random forces, or a hand that never lets go. None where that is not seen."""
    ranges = _ranges(t, y, period)
    if ranges.size < 3 * RISES * SLOWLY:
        return None
    third = ranges.size // 3
    before, after = float(np.median(ranges[:third])), float(np.median(ranges[-third:]))
    if not before < HALVED * after < HALVED**2 * before:  # also where the first third is constant
        return None
    noise = roughness(t, y, period)
    if (
        ranges.min() <= CLEAR * noise
        or coarse_period(t, y)[1] < LEAST_SHARE
        or wandering(t, y, period, noise)
    ):
        return None
    turns, _ = zigzag(np.log(ranges), np.full(ranges.size, np.log(AGAIN)))
    rises = [b - a for a, b in pairwise(turns[:-1]) if ranges[b] > ranges[a] and b - a >= SLOWLY]
    if len(rises) < RISES or sum(rises) < RISING * ranges.size:
        return None
    nan, f = np.array([np.nan]), np.array([1 / period])
    modes = Modes(f, nan, nan, np.array([0.5 * ranges.min()]), np.array([0.5 * ranges.max()]), 1.0)
    return NotOne("excited", modes, float(len(rises)))


def _stays(one: Modes, duration: float) -> bool:
    """Whether no decay is seen where one would be."""
    rate, error = float(one.rates[0]), float(one.errors[0])
    return (
        one.frequencies[0] * duration > CYCLES
        and rate < UNSEEN * error
        and (abs(rate) + 2 * error) * duration < KEPT
    )


def passing(two: Modes, longest: float) -> float:
    """Return for how long, in s, the faster decaying of two modes is seen at the beginning of a record.

    0 where that is more than a few cycles, or more than `longest`, s: then it is a mode, and not a filter's ringing.
    """
    fast, slow = int(np.argmax(two.rates)), int(np.argmin(two.rates))
    size = float(two.first[fast] / max(two.first[slow], 1e-300))
    long = float(np.log(max(size / GONE, 1.0)) / max(two.rates[fast] - two.rates[slow], 1e-300))
    return long if long < min(PASSING / float(two.frequencies[slow]), longest) else 0.0


def _ranges(t: np.ndarray, y: np.ndarray, period: float) -> np.ndarray:
    """The ranges of whole periods without a hole, in order."""
    edges = np.searchsorted(t, np.arange(t[0], t[-1], period))
    widest = max(HOLE * period, 2.5 * float(np.median(np.diff(t))))
    long = [(a, b) for a, b in pairwise(edges) if b - a > 3]
    return np.array([np.ptp(y[a:b]) for a, b in long if np.diff(t[max(a - 1, 0) : b + 1]).max() <= widest])


def lifted(ranges: np.ndarray, noise: float, together: int = TOGETHER) -> float:
    """Return by how much an amplitude surely rises again after it has fallen, relative to itself then.

    Damping of any law takes energy: of one oscillator this is noise.

    Parameters
    ----------
    ranges : ndarray, shape (n,)
        Ranges of periods or of swings, in their order.
    noise : float
        Standard deviation of a sample.
    together : int
        The largest of so many ranges in a row is compared with the least of as many later ones.
    """
    if ranges.size < 2 * together:
        return 0.0
    runs = np.lib.stride_tricks.sliding_window_view(ranges, together)
    before, later = np.minimum.accumulate(runs.max(axis=1))[:-together], runs.min(axis=1)[together:]
    rises = later - before - CLEAR * noise
    return float(max(np.max(rises / np.maximum(later, 1e-300)), 0.0))


def _levels(two: Modes, ranges: np.ndarray, noise: float, duration: float) -> bool:
    """Whether the amplitude has fallen and then stays, clear of the noise, for the last third of the periods, and the
    mode that is kept up surely does so too."""
    last = ranges[-(ranges.size // 3) :]
    if last.size < 3 * TOGETHER or not ranges[0] > HALVED * np.median(last) > HALVED * ABOVE * noise:
        return False
    kept = int(np.argmin(two.rates))
    falls = (abs(float(two.rates[kept])) + 2 * float(two.errors[kept])) * duration / 3
    early, late = np.median(last[: last.size // 2]), np.median(last[-(last.size // 2) :])
    return falls < KEPT and abs(early / late - 1) < KEPT
