"""Levenberg–Marquardt's method (Levenberg 1944, Marquardt 1963; Moré 1977 for its scaling).

A step solves a problem that is simple near a point, damped by λ; λ falls where the step gains and grows where it does
not. `search` is the method for any such problem; `levenberg_marquardt` is it for a function that is expanded to second
order, within lower bounds: (H + λ diag H) s = g for gradient g and information H.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Generic, NamedTuple, Protocol, Self, TypeVar

import numpy as np

FIRST, LOWEST, HIGHEST = 1e-3, 1e-12, 1e12
"""λ at first, and between which it stays (conventional)."""
AGAIN = 1e-9
"""λ that grows from at least, so that it leaves the lowest at once."""


class Schedule(NamedTuple):
    """By what λ shrinks where a step gains, and grows where it does not (conventional). eager: whether it shrinks too
    with a step that gains where another from the same point did not. first, lowest, again: as the constants."""

    less: float = 0.2
    more: float = 6.0
    eager: bool = True
    first: float = FIRST
    lowest: float = LOWEST
    again: float = AGAIN


class Trial(Protocol):
    """A step that was tried. gain: what it gains, below 0 where it is not taken, nan never."""

    @property
    def gain(self) -> float:
        """In the unit of what is sought."""
        ...


TrialT = TypeVar("TrialT", bound=Trial)


class Near(Protocol[TrialT]):
    """A problem as it is near a point."""

    def tried(self, damping: float) -> TrialT | None:
        """The step of this λ; None where none is worth a trial, which ends the search."""
        ...

    def beyond(self, trial: TrialT) -> Self | None:
        """The problem as it is near the point that a step leads to; None where it is not to be told there."""
        ...


NearT = TypeVar("NearT", bound=Near)


@dataclass(frozen=True)
class Ended(Generic[NearT, TrialT]):
    """Where a search ended: near where it was expanded last, None where it could not be; the step that was taken from
    there, if one was; and whether the search said so itself."""

    near: NearT | None
    taken: TrialT | None
    converged: bool


def search(
    near: NearT,
    ended: Callable[[NearT, TrialT, float], bool],
    *,
    limit: int,
    schedule: Schedule = Schedule(),  # noqa: B008 - frozen
) -> Ended[NearT, TrialT]:
    """Levenberg and Marquardt's search from a problem as it is near its start.

    ended: whether the search is over with a step, taken or not, of this λ. limit: of steps that are tried.
    """
    damping, failed = schedule.first, False
    for _ in range(limit):
        trial: TrialT | None = near.tried(damping)
        if trial is None:
            return Ended(near, None, True)
        used, taken = damping, trial.gain >= 0
        if taken and (schedule.eager or not failed):
            damping = max(damping * schedule.less, schedule.lowest)
        if ended(near, trial, used):
            return Ended(near, trial if taken else None, True)
        failed = not taken
        if failed:
            damping = max(damping, schedule.again) * schedule.more
            continue
        there = near.beyond(trial)
        if there is None:
            return Ended(None, trial, False)
        near = there
    return Ended(near, None, False)


Retract = Callable[[np.ndarray, np.ndarray], np.ndarray]
"""A point (d,) and a step, (d,), to the point where the curve ends that starts with this step."""


class Expansion(NamedTuple):
    """A function at a point: its value, its gradient (d,) and its information, which is minus its Hessian, (d, d)."""

    value: float
    gradient: np.ndarray
    information: np.ndarray


Expand = Callable[[np.ndarray], Expansion]


class Step(NamedTuple):
    """One trial: from where it started, by how much it moved, (d,), to where, and what it gained; expected: the
    first-order gain of a step that no bound cuts short. damping: λ."""

    x: np.ndarray
    move: np.ndarray
    at: Expansion
    gain: float
    expected: float
    damping: float
    there: np.ndarray
    new: Expansion


@dataclass(frozen=True)
class Maximum:
    """Where an ascent ended.

    x: (d,); value: the function's, −inf where that is not finite; information: (d, d); evaluations: of the function.
    """

    x: np.ndarray
    value: float
    information: np.ndarray
    evaluations: int
    converged: bool


def straight_on(x: np.ndarray, step: np.ndarray) -> np.ndarray:
    """Without a curve."""
    return x + step


@dataclass(frozen=True)
class Bounded:
    """A function that is sought the maximum of within lower bounds, near x, (d,)."""

    x: np.ndarray
    at: Expansion
    expand: Expand
    floor: np.ndarray
    longest: float
    retract: Retract

    @property
    def finite(self) -> bool:
        """Whether it has a value and an information here."""
        return bool(np.isfinite(self.at.value) and np.all(np.isfinite(self.at.information)))

    def tried(self, damping: float) -> Step | None:
        """The step of this λ; None where there is no value to improve."""
        if not self.finite:
            return None
        x, at = self.x, self.at
        # Where the slope holds a component at its bound, the others move without it.
        free = np.flatnonzero(~((x <= self.floor) & (at.gradient <= 0)))
        move = np.zeros_like(x)
        move[free] = _solved(at.information[np.ix_(free, free)], at.gradient[free], damping)
        move *= min(1.0, self.longest / max(np.abs(move).max(initial=0.0), 1e-300))
        there = np.maximum(self.retract(x, move), self.floor)
        new = self.expand(there)
        gain = float(new.value - at.value) if np.isfinite(new.value) else -np.inf
        return Step(x, there - x, at, gain, float(move @ at.gradient), damping, there, new)

    def beyond(self, trial: Step) -> Self:
        """Near where a step leads."""
        return type(self)(trial.there, trial.new, self.expand, self.floor, self.longest, self.retract)


def levenberg_marquardt(
    expand: Expand,
    x: np.ndarray,
    floor: np.ndarray,
    ended: Callable[[Step], bool],
    *,
    limit: int,
    longest: float = np.inf,
    schedule: Schedule = Schedule(),  # noqa: B008 - frozen
    retract: Retract = straight_on,
) -> Maximum:
    """A local maximum of a function over x ≥ floor, elementwise, from x, (d,).

    floor: (d,), −inf where there is no bound. ended: whether the search has converged with a step, taken or not.
    limit: of steps; longest: the largest component of one; retract: where steps end.
    """
    x = np.maximum(x, floor)
    evaluations, converged = 1, False

    def over(near: Bounded, step: Step, damping: float) -> bool:
        nonlocal evaluations, converged
        evaluations, converged = evaluations + 1, ended(step)
        return converged or (damping if step.gain < 0 else damping * schedule.less) > HIGHEST

    first = Bounded(x, expand(x), expand, floor, longest, retract)
    found: Ended[Bounded, Step] = search(first, over, limit=limit, schedule=schedule)
    last = first if found.near is None else found.near
    last = last if found.taken is None else last.beyond(found.taken)
    if found.taken is None and not last.finite:
        return Maximum(last.x, -np.inf, np.eye(x.size), evaluations, False)
    return Maximum(last.x, float(last.at.value), last.at.information, evaluations, converged)


def _solved(information: np.ndarray, gradient: np.ndarray, damping: float) -> np.ndarray:
    """The step, (d,), in the unit of each component that its own curvature sets."""
    diagonal = np.diag(information)
    scale = np.sqrt(np.where(diagonal > 0, diagonal, 1.0))
    matrix = information / np.outer(scale, scale) + damping * np.eye(scale.size)
    return np.linalg.solve(matrix, gradient / scale) / scale
