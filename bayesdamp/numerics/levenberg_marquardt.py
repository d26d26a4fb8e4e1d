"""Maximise a function within lower bounds by Levenberg–Marquardt's method.

The function is expanded to second order: a step s solves (H + λ diag H) s = g for gradient g and information H. λ falls
where the step gains and grows where it does not (Levenberg 1944, Marquardt 1963; Moré 1977 for the scaling).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

FIRST, LOWEST, HIGHEST = 1e-3, 1e-12, 1e12
"""λ at first, and its bounds (conventional)."""
AGAIN = 1e-9
"""Least λ before it grows, so that it leaves the lowest at once."""


class Schedule(NamedTuple):
    """Factors by which λ shrinks where a step gains, and grows where it does not (conventional)."""

    less: float = 0.2
    more: float = 6.0


Retract = Callable[[np.ndarray, np.ndarray], np.ndarray]
"""Maps a point (d,) and a step (d,) to the end of the curve that starts with this step."""


class Expansion(NamedTuple):
    """A function at a point: its value, its gradient (d,) and its information, which is minus its Hessian, (d, d)."""

    value: float
    gradient: np.ndarray
    information: np.ndarray


Expand = Callable[[np.ndarray], Expansion]


class Step(NamedTuple):
    """One trial step.

    x: its start, (d,). move: how far it moved, (d,). at: the expansion at its start. gain: of the function. expected:
    the first-order gain of a step that no bound shortens. damping: λ.
    """

    x: np.ndarray
    move: np.ndarray
    at: Expansion
    gain: float
    expected: float
    damping: float


@dataclass(frozen=True)
class Maximum:
    """The end of an ascent.

    x: (d,); value: the function's, −inf where that is not finite; information: (d, d); evaluations: of the function.
    """

    x: np.ndarray
    value: float
    information: np.ndarray
    evaluations: int
    converged: bool


def straight_on(x: np.ndarray, step: np.ndarray) -> np.ndarray:
    """Return the end of a straight step."""
    return x + step


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
    """Return a local maximum of a function over x ≥ floor, elementwise.

    Parameters
    ----------
    expand
        The function's value, gradient and information at a point, (d,).
    x
        Start, (d,).
    floor
        Lower bounds, (d,), −inf where there is none.
    ended
        Whether the search has converged with a step, taken or not.
    limit
        Most steps.
    longest
        Largest component of a step.
    schedule
        Factors of λ.
    retract
        Where steps end.
    """

    def is_finite(at: Expansion) -> bool:
        return bool(np.isfinite(at.value) and np.all(np.isfinite(at.information)))

    x = np.maximum(x, floor)
    at, damping, evaluations = expand(x), FIRST, 1
    for _ in range(limit):
        if not is_finite(at):
            break
        # Where the slope holds a component at its bound, the others move without it.
        free = np.flatnonzero(~((x <= floor) & (at.gradient <= 0)))
        move = np.zeros_like(x)
        # Each component has the unit that its own curvature sets.
        information = at.information[np.ix_(free, free)]
        diagonal = np.diag(information)
        scale = np.sqrt(np.where(diagonal > 0, diagonal, 1.0))
        matrix = information / np.outer(scale, scale) + damping * np.eye(scale.size)
        move[free] = np.linalg.solve(matrix, at.gradient[free] / scale) / scale
        move *= min(1.0, longest / max(np.abs(move).max(initial=0.0), 1e-300))
        end = np.maximum(retract(x, move), floor)
        new = expand(end)
        evaluations += 1
        gain = float(new.value - at.value) if np.isfinite(new.value) else -np.inf
        converged = ended(Step(x, end - x, at, gain, float(move @ at.gradient), damping))
        over = converged or (damping if gain < 0 else damping * schedule.less) > HIGHEST
        if gain >= 0:
            x, at, damping = end, new, max(damping * schedule.less, LOWEST)
        else:
            damping = max(damping, AGAIN) * schedule.more
        if over:
            return Maximum(x, float(at.value), at.information, evaluations, converged)
    if not is_finite(at):
        return Maximum(x, -np.inf, np.eye(x.size), evaluations, False)
    return Maximum(x, float(at.value), at.information, evaluations, False)
