"""Whether a second verdict on a record, from sampled motions, agrees with the first."""

from __future__ import annotations

from dataclasses import dataclass

from bayesdamp.verdict.types import Verdict

SMALL = 0.5
"""Standard deviations of a damping ratio below which it has not moved."""
Z95 = 1.96


@dataclass(frozen=True)
class Agreement:
    """same: whether both name the same damping, or both none. moved: the largest change of a damping ratio, in its
    standard deviations."""

    same: bool
    moved: float

    @property
    def confirms(self) -> bool:
        """Whether the sum is the same and no ratio moved by more than a little."""
        return self.same and self.moved < SMALL


def agreement(first: Verdict, second: Verdict) -> Agreement:
    """How a second verdict on a record compares with the first."""
    named = {frozenset(v.damping.split("+")) if v.decided else frozenset() for v in (first, second)}
    moves = [
        abs(b.value - a.value) / max((b.high - b.low) / (2 * Z95), 1e-300)
        for a, b in zip(first.damping_ratio, second.damping_ratio, strict=False)
    ]
    return Agreement(len(named) == 1, max(moves, default=0.0))
