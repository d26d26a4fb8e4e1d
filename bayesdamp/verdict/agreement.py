"""Whether a second verdict on a record, from sampled motions, agrees with the first."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import log

from bayesdamp.verdict.parts import DampingRatio
from bayesdamp.verdict.types import Verdict

SMALL = 0.5
"""Standard deviations of a damping ratio below which it has not moved."""
Z95 = 1.96


@dataclass(frozen=True)
class Agreement:
    """same: whether both name the same damping, or both none. moved: the largest change of a damping ratio, in the
    total standard deviations that the first verdict gave it."""

    same: bool
    moved: float

    @property
    def confirms(self) -> bool:
        """Whether the sum is the same and no ratio moved by more than a little."""
        return self.same and self.moved < SMALL


ALIKE = 1.25
"""Factor by which an interval may be wider or narrower: ends by a few hundred draws move by a tenth of the width."""


@dataclass(frozen=True)
class Intervals:
    """How another computation of a verdict's damping ratios compares: at an amplitude it moves by so many of the total
    standard deviations that are quoted there, and its interval is so many times as wide; that of all amplitudes where
    both together are worst."""

    amplitude: float
    moved: float
    wider: float

    @property
    def confirms(self) -> bool:
        """Whether nothing moved by more than a little, and widths are alike."""
        return self.moved < SMALL and 1 / ALIKE < self.wider < ALIKE


def intervals(first: Verdict, ratios: Sequence[tuple[float, float, float]]) -> Intervals:
    """Of (value, low, high) at the verdict's amplitudes, in their order; one or more."""

    def one(r: DampingRatio, value: float, low: float, high: float) -> Intervals:
        width = max(r.high - r.low, 1e-300)
        return Intervals(r.amplitude, abs(value - r.value) * 2 * Z95 / width, (high - low) / width)

    each = [one(r, *other) for r, other in zip(first.damping_ratio, ratios, strict=True)]
    return max(each, key=lambda i: max(i.moved / SMALL, abs(log(i.wider)) / log(ALIKE)))


def agreement(first: Verdict, second: Verdict) -> Agreement:
    """How a second verdict on a record compares with the first."""
    named = {frozenset(v.damping.split("+")) if v.decided else frozenset() for v in (first, second)}
    moves = [
        abs(b.value - a.value) / max((a.high - a.low) / (2 * Z95), 1e-300)
        for a, b in zip(first.damping_ratio, second.damping_ratio, strict=False)
    ]
    return Agreement(len(named) == 1, max(moves, default=0.0))
