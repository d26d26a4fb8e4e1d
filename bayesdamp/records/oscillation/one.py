"""Whether a record is the free decay of one oscillator, and if not, what is seen instead and how large it is."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from typing import Literal

import numpy as np

from bayesdamp.records.oscillation.modes import Modes, damped_modes, few_samples

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
STEADY = 0.1
"""Share of the other's decay rate below which an oscillation is kept up by a drive."""
HOLE = 0.2
"""Part of a period without a sample in which a turning point may be missed."""
CYCLES = 3.0
"""Cycles of the slower mode below which nothing is said."""


@dataclass(frozen=True)
class NotOne:
    """What is seen. modes: one that grows, or two. size: of the second mode, relative to the largest amplitude of the
    first; of growth, the factor by which it grows less 1."""

    seen: Literal["growing", "beats", "two modes", "driven"]
    modes: Modes
    size: float


def other_than_one(t: np.ndarray, y: np.ndarray, period: float) -> NotOne | None:
    """What values y (n,) at times t (n,), s, are if not the free decay of one oscillator of about this period in s;
    None where nothing speaks against that.

    A second mode is believed where two damped sinusoids explain nearly all, one does not, and what both make together
    is nothing that one oscillator does, be it linear or not: another frequency that is no harmonic, or an amplitude
    that rises.
    """
    t, y = few_samples(np.asarray(t, float), np.asarray(y, float), period)
    if t.size < 20:
        return None
    one = damped_modes(t, y, 1)
    if one is None or one.left >= 1:
        return None
    if one.left < 1 - EXPLAINED and _grows(one):
        return NotOne("growing", one, float(one.last[0] / one.first[0] - 1))
    two = damped_modes(t, y, 2)
    if two is None or two.left > (1 - EXPLAINED) or two.left > 0.5 * one.left:
        return None
    largest = np.maximum(two.first, two.last)
    size = float(largest[1] / largest[0])
    f, g = float(two.frequencies.min()), float(two.frequencies.max())
    if f * float(t[-1] - t[0]) < CYCLES:
        return None
    if g / f - 1 < CLOSE:
        if _lifted(t, y, 1 / f, float(np.std(y)) * two.left**0.5) < LIFTED:
            return None
        seen = "driven" if _steady(two) else "beats"
        return NotOne(seen, two, size)
    multiple = two.frequencies[1] / two.frequencies[0]
    if multiple > 1 and abs(multiple - round(multiple)) < HARMONIC * multiple:
        return None
    return NotOne("driven" if _steady(two) else "two modes", two, size)


def _grows(one: Modes) -> bool:
    return bool(one.rates[0] < -SIGMAS * one.errors[0] and one.last[0] > GROWN * one.first[0])


def _steady(two: Modes) -> bool:
    """Whether one is kept up while the other decays."""
    kept, falling = sorted(two.rates.tolist())
    return abs(kept) < STEADY * falling


def _filled(t: np.ndarray, a: int, b: int, widest: float) -> bool:
    """Whether no hole is among samples a to b, nor beside them."""
    return bool(np.diff(t[max(a - 1, 0) : b + 1]).max() <= widest)


def _lifted(t: np.ndarray, y: np.ndarray, period: float, noise: float) -> float:
    """By how much the amplitude surely rises again after it has fallen, relative to itself then.

    Ranges of whole periods are compared, the larger of two in a row with the lesser of two later ones. Damping of any
    law takes energy: of one oscillator this is noise. noise: standard deviation of a sample.
    """
    edges = np.searchsorted(t, np.arange(t[0], t[-1], period))
    widest = max(HOLE * period, 2.5 * float(np.median(np.diff(t))))
    whole = [(a, b) for a, b in pairwise(edges) if b - a > 3 and _filled(t, a, b, widest)]
    ranges = np.array([np.ptp(y[a:b]) for a, b in whole])
    if ranges.size < 2 * TOGETHER:
        return 0.0
    runs = np.lib.stride_tricks.sliding_window_view(ranges, TOGETHER)
    before, later = np.minimum.accumulate(runs.max(axis=1))[:-TOGETHER], runs.min(axis=1)[TOGETHER:]
    lifted = later - before - CLEAR * noise
    return float(max(np.max(lifted / np.maximum(later, 1e-300)), 0.0))
