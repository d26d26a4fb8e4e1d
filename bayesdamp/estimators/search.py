"""Small searches: bounded Brent whose bracket widens by itself, least squares above a floor, a term's parameters."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from itertools import product

import numpy as np

from bayesdamp.numerics.levenberg_marquardt import Expansion, Schedule, Step, levenberg_marquardt
from bayesdamp.priors import Prior

SCORE = 3.5
"""How far from the middle of its prior a term's further parameter is looked for, in normal scores."""


@dataclass(frozen=True)
class Found:
    """x, the evaluations it took, the cost after each, and whether the search converged."""

    x: np.ndarray
    evaluations: int
    costs: np.ndarray
    converged: bool


def brent(cost: Callable[[float], float], guess: float, unit: float, factor: float = 3.0) -> Found:
    """The minimum of `cost` over x ≥ 0 (paper, section 3.3: Brent's method with bounded search).

    The bracket is [guess/factor, guess·factor] and moves on where the minimum is at its end. unit: a value of
    x that is small but matters; the search starts no lower.
    """
    from scipy.optimize import minimize_scalar

    costs: list[float] = []

    def counted(x: float) -> float:
        costs.append(cost(x))
        return costs[-1]

    centre = max(guess, unit)
    low, high = centre / factor, centre * factor
    x, converged = centre, False
    for _ in range(12):
        result = minimize_scalar(
            counted, bounds=(low, high), method="bounded", options={"xatol": 1e-9 * max(centre, unit)}
        )
        x = float(result.x)  # pyright: ignore[reportAttributeAccessIssue]
        margin = 1e-3 * (high - low)
        if x > high - margin:
            low, high = x / factor, high * factor**2
        elif x < low + margin and low > 0.0:
            low, high = (low / factor**3 if low > unit / factor else 0.0), x * factor
        else:
            converged = bool(result.success)  # pyright: ignore[reportAttributeAccessIssue]
            break
        centre = max(x, unit)
    if low == 0.0 and counted(0.0) <= counted(x):
        x = 0.0
    return Found(np.array([x]), len(costs), np.array(costs), converged)


Evaluate = Callable[[np.ndarray], tuple[np.ndarray, np.ndarray]]
STEPS = 400
SCHEDULE = Schedule(less=0.1, more=10.0)
"""Near its end the residuals of a refined fit are nearly linear: large factors save steps."""
STILL, SAME, LEVEL = 1e-9, 1e-13, 1e-12
"""A search has converged with a step of this share of what changes the residuals as much as all of them are now, of
this share of the parameters, or that lowers their sum of squares by this share."""


def least_squares(evaluate: Evaluate, start: np.ndarray, floor: np.ndarray) -> Found:
    """The least squares of residuals over x ≥ floor, elementwise, from `start` (k,), by Levenberg–Marquardt.

    evaluate: x to residuals (n,) and their Jacobian (n, k); residuals that are not finite refuse a step.
    """
    costs: list[float] = []

    def expand(x: np.ndarray) -> Expansion:
        r, jacobian = evaluate(x)
        cost = float(r @ r) if np.all(np.isfinite(r)) else np.inf
        costs.append(min(cost, costs[-1]) if costs else cost)
        return Expansion(-cost, -2 * jacobian.T @ r, 2 * jacobian.T @ jacobian)

    def ended(step: Step) -> bool:
        cost = -step.at.value
        scale = np.sqrt(np.diag(step.at.information) / 2)
        small = bool(np.all(np.abs(step.move) * scale <= STILL * np.sqrt(cost)))
        if step.gain > 0:
            return small or step.gain < LEVEL * cost or step.gain == cost
        return small or bool(np.all(np.abs(step.move) <= SAME * np.abs(step.x))) or cost == 0.0

    found = levenberg_marquardt(expand, start, floor, ended, limit=STEPS, schedule=SCHEDULE)
    return Found(found.x, len(costs), np.array(costs), found.converged)


def least_over_further(
    priors: Mapping[str, Prior], cost: Callable[[dict[str, float]], float]
) -> dict[str, float]:
    """Values of these parameters with the least cost: variable projection (Golub and Pereyra 1973) where the cost is
    what the best coefficients leave. Nelder and Mead's search over their scores, from the best of a grid."""
    from scipy.optimize import minimize

    if not priors:
        return {}

    def values(z: np.ndarray) -> dict[str, float]:
        bounded = np.clip(z, -SCORE, SCORE)
        return {
            n: float(p.value(np.abs(x) if p.reflected else x)) for (n, p), x in zip(priors.items(), bounded)
        }

    def at(z: np.ndarray) -> float:
        return cost(values(z)) * (1.0 + float(np.sum(np.maximum(np.abs(z) - SCORE, 0.0))))

    starts = [np.array(z) for z in product(*[(-1.0, 0.1, 1.0)] * len(priors))]
    first = min(starts, key=at)
    found = minimize(at, first, method="Nelder-Mead", options={"xatol": 1e-5, "fatol": 0.0, "maxfev": 400})
    return values(found.x)
