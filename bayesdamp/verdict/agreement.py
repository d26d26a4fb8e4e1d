"""Whether a second answer on a record, from sampled motions or other computations, agrees with the first."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import log

from bayesdamp.verdict.thresholds import MOVED, WIDTHS_AGREE
from bayesdamp.verdict.types import Verdict

Z95 = 1.96


@dataclass(frozen=True)
class Agreement:
    """How a second verdict compares with the first.

    same: whether both name the same damping, or both none. moved: the largest change of a damping ratio, in the total
    standard deviations that the first verdict gave it.
    """

    same: bool
    moved: float

    @property
    def confirms(self) -> bool:
        """Whether the sum is the same and no ratio moved by more than a little."""
        return self.same and self.moved < MOVED


@dataclass(frozen=True)
class Intervals:
    """How another computation of a damping ratio compares with a verdict's at an amplitude.

    moved: in the total standard deviations that are quoted there; wider: its interval over the verdict's.
    """

    amplitude: float
    moved: float
    wider: float

    @property
    def confirms(self) -> bool:
        """Whether nothing moved by more than a little, and widths are alike."""
        return self.moved < MOVED and 1 / WIDTHS_AGREE < self.wider < WIDTHS_AGREE


def _compared(first: Verdict, ratios: Sequence[tuple[float, float, float]]) -> list[Intervals]:
    each = []
    for r, (value, low, high) in zip(first.damping_ratio, ratios, strict=False):
        width = max(r.high - r.low, 1e-300)
        each.append(Intervals(r.amplitude, abs(value - r.value) * 2 * Z95 / width, (high - low) / width))
    return each


def intervals(first: Verdict, ratios: Sequence[tuple[float, float, float]]) -> Intervals:
    """Return the comparison at the amplitude where shift and width together are worst.

    ratios: (value, low, high) at the verdict's amplitudes, in their order; one or more.
    """
    badness = {
        i: max(i.moved / MOVED, abs(log(i.wider)) / log(WIDTHS_AGREE)) for i in _compared(first, ratios)
    }
    return max(badness, key=badness.__getitem__)


def agreement(first: Verdict, second: Verdict) -> Agreement:
    """Return how a second verdict on a record compares with the first."""
    named = {frozenset(v.damping.split("+")) if v.decided else frozenset() for v in (first, second)}
    found = _compared(first, [(r.value, r.low, r.high) for r in second.damping_ratio])
    return Agreement(len(named) == 1, max((i.moved for i in found), default=0.0))
