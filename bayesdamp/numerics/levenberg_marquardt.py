"""Maximise a function within lower bounds by the Levenberg–Marquardt method.

A step s solves (H + λ diag H) s = g, where g is the gradient and H the information (minus the Hessian). λ, the damping
parameter, decreases after a step that does not decrease the function, and increases after any other (Levenberg 1944,
Marquardt 1963; Moré 1977 for the scaling).
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

FIRST_LAMBDA, MIN_LAMBDA, MAX_LAMBDA = 1e-3, 1e-12, 1e12
"""Initial, smallest and largest value of λ, the damping parameter of Levenberg–Marquardt steps. A search ends when λ
would exceed the largest (conventional)."""
MIN_BEFORE_GROWTH = 1e-9
"""If λ, the damping parameter of Levenberg–Marquardt steps, is below this when a step is rejected, it is raised to this
value before it is multiplied. Otherwise it would need many rejected steps to become large enough (conventional)."""


class Schedule(NamedTuple):
    """Factors by which λ, the damping parameter of Levenberg–Marquardt steps, is multiplied (conventional).

    less: factor after an accepted step. more: factor after a rejected step.
    """

    less: float = 0.2
    more: float = 6.0


Retract = Callable[[np.ndarray, np.ndarray], np.ndarray]
"""A function of a point (d,) and a step (d,) that returns the point at which the step ends, (d,). It may return another
point than their sum, so that a long step follows a curve."""


class Expansion(NamedTuple):
    """Value of a function at a point, its gradient (d,), and its information (minus the Hessian) (d, d)."""

    value: float
    gradient: np.ndarray
    information: np.ndarray


Expand = Callable[[np.ndarray], Expansion]
"""A function that returns the value, gradient and information of the maximised function at a point, (d,)."""


class Step(NamedTuple):
    """One trial step of a Levenberg–Marquardt search.

    x: start point, (d,). move: end point minus x, (d,); the end point is the result of the `Retract` function (which
    maps a start point and a step to a point), moved into the bounds. at: expansion of the function at x. gain: increase
    of the function by the step; −inf if its value or its information is not finite at the end point. expected: the
    increase to first order, gradient times the step before `Retract` and bounds. damping: λ, the damping parameter of
    the step (see `levenberg_marquardt`).
    """

    x: np.ndarray
    move: np.ndarray
    at: Expansion
    gain: float
    expected: float
    damping: float


@dataclass(frozen=True)
class Maximum:
    """Result of a maximisation by `levenberg_marquardt`.

    x: end point, (d,). value: function value there; −inf if the value or the information at the start is not finite.
    information: minus the Hessian there, (d, d); the identity if the value is −inf. converged: True if the convergence
    criterion ended the search; False if the step limit or λ above `MAX_LAMBDA` ended it, or if the value is −inf.
    """

    x: np.ndarray
    value: float
    information: np.ndarray
    converged: bool


def straight_on(x: np.ndarray, step: np.ndarray) -> np.ndarray:
    """Return x + step, (d,): the default end point of a step of `levenberg_marquardt`, without following a curve."""
    return x + step


def levenberg_marquardt(
    expand: Expand,
    x: np.ndarray,
    floor: np.ndarray,
    has_converged: Callable[[Step], bool],
    *,
    limit: int,
    longest: float = np.inf,
    schedule: Schedule = Schedule(),  # noqa: B008 - frozen
    retract: Retract = straight_on,
) -> Maximum:
    """Search for a local maximum of a function over x ≥ floor, elementwise, by damped Newton steps.

    A step s solves (H + λ diag H) s = g with the gradient g and the information H (minus the Hessian). It is rejected
    if it decreases the function, or ends where the value or the information is not finite. λ, the damping parameter,
    decreases after an accepted step and increases after a rejected one. The search ends if `has_converged` returns
    True, after `limit` steps, or if λ exceeds `MAX_LAMBDA`.

    Parameters
    ----------
    expand
        Function that returns the value, gradient and information at a point, (d,).
    x
        Start point, (d,); components below their bounds are set to them.
    floor
        Lower bounds, (d,); −inf for an unbounded coordinate.
    has_converged
        Convergence criterion, called after each trial step, also a rejected one: it returns True if the search ends.
    limit
        Largest number of trial steps, rejected ones included.
    longest
        Largest allowed absolute component of a step, before `retract`; a longer step is scaled down.
    schedule
        Factors by which λ changes.
    retract
        Function that returns the end point of a step.

    Returns
    -------
    Maximum
        The end point of the last accepted step, the best point of the search; its value is −inf if the function is not
        finite at the start.
    """

    def is_finite(at: Expansion) -> bool:
        return bool(np.isfinite(at.value) and np.all(np.isfinite(at.information)))

    x = np.maximum(x, floor)
    at, damping = expand(x), FIRST_LAMBDA
    for _ in range(limit):
        if not is_finite(at):
            break
        # Components at their bound whose gradient points below it stay there.
        free = np.flatnonzero(~((x <= floor) & (at.gradient <= 0)))
        move = np.zeros_like(x)
        # Scale each component by its curvature: then λ diag H is λ times the identity.
        information = at.information[np.ix_(free, free)]
        diagonal = np.diag(information)
        scale = np.sqrt(np.where(diagonal > 0, diagonal, 1.0))
        matrix = information / np.outer(scale, scale) + damping * np.eye(scale.size)
        move[free] = np.linalg.solve(matrix, at.gradient[free] / scale) / scale
        move *= min(1.0, longest / max(np.abs(move).max(initial=0.0), 1e-300))
        end = np.maximum(retract(x, move), floor)
        new = expand(end)
        gain = float(new.value - at.value) if is_finite(new) else -np.inf
        converged = has_converged(Step(x, end - x, at, gain, float(move @ at.gradient), damping))
        stopping = converged or (damping if gain < 0 else damping * schedule.less) > MAX_LAMBDA
        if gain >= 0:
            x, at, damping = end, new, max(damping * schedule.less, MIN_LAMBDA)
        else:
            damping = max(damping, MIN_BEFORE_GROWTH) * schedule.more
        if stopping:
            return Maximum(x, float(at.value), at.information, converged)
    if not is_finite(at):
        return Maximum(x, -np.inf, np.eye(x.size), False)
    return Maximum(x, float(at.value), at.information, False)
