"""Compare two verdicts on a record: by sampled motions or another computation against the first."""

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

    same: whether both name the same damping, or neither names one. moved: the largest change of a damping ratio, in
    the total standard deviations of the first verdict.
    """

    same: bool
    moved: float

    @property
    def confirms(self) -> bool:
        """Whether the damping is the same and no ratio moved by `MOVED` or more."""
        return self.same and self.moved < MOVED


@dataclass(frozen=True)
class Intervals:
    """How another computation of a damping ratio compares with the verdict at one amplitude.

    moved: change of the value in the verdict's total standard deviations; wider: width of its interval over that of
    the verdict.
    """

    amplitude: float
    moved: float
    wider: float

    @property
    def confirms(self) -> bool:
        """Whether the value moved by less than `MOVED` and the widths agree."""
        return self.moved < MOVED and 1 / WIDTHS_AGREE < self.wider < WIDTHS_AGREE


def _compare(first: Verdict, ratios: Sequence[tuple[float, float, float]]) -> list[Intervals]:
    comparisons = []
    for r, (value, low, high) in zip(first.damping_ratio, ratios, strict=False):
        width = max(r.high - r.low, 1e-300)
        moved = abs(value - r.value) * 2 * Z95 / width
        comparisons.append(Intervals(r.amplitude, moved, (high - low) / width))
    return comparisons


def intervals(first: Verdict, ratios: Sequence[tuple[float, float, float]]) -> Intervals:
    """Return the comparison at the amplitude where shift and width together are worst.

    Parameters
    ----------
    first
        The verdict that is checked.
    ratios
        (value, low, high) of the damping ratio at the verdict's amplitudes, in their order; at least one.
    """
    return max(
        _compare(first, ratios),
        key=lambda i: max(i.moved / MOVED, abs(log(i.wider)) / log(WIDTHS_AGREE)),
    )


def agreement(first: Verdict, second: Verdict) -> Agreement:
    """Return how a second verdict on a record compares with the first."""
    dampings = {frozenset(v.damping.split("+")) if v.decided else frozenset() for v in (first, second)}
    comparisons = _compare(first, [(r.value, r.low, r.high) for r in second.damping_ratio])
    return Agreement(len(dampings) == 1, max((i.moved for i in comparisons), default=0.0))
