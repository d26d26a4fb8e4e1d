"""Two small searches: bounded Brent whose bracket widens by itself, and Levenberg–Marquardt above a floor."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.optimize import minimize_scalar


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


def levenberg(evaluate: Evaluate, start: np.ndarray, floor: np.ndarray, rounds: int = 80) -> Found:
    """The least squares of residuals over x ≥ floor, elementwise, from `start` (k,).

    evaluate: x to residuals (n,) and their Jacobian (n, k); residuals that are not finite refuse a step.
    A parameter at its floor whose gradient holds it there takes no part in a step.
    """
    x = np.maximum(start, floor)
    r, jacobian = evaluate(x)
    cost = _cost(r)
    costs, damping, converged = [cost], 1e-3, False
    for _ in range(rounds):
        if not (np.isfinite(cost) and np.all(np.isfinite(jacobian))):
            break
        gradient, hessian = jacobian.T @ r, jacobian.T @ jacobian
        moving = ~((x <= floor) & (gradient > 0))
        diagonal = np.where(np.diag(hessian) > 0, np.diag(hessian), 1.0)
        scale = np.sqrt(diagonal[moving])
        matrix = hessian[np.ix_(moving, moving)] / np.outer(scale, scale)
        accepted, small = False, False
        for _ in range(14):
            step = np.zeros_like(x)
            step[moving] = (
                -np.linalg.solve(matrix + damping * np.eye(scale.size), gradient[moving] / scale) / scale
            )
            there = np.maximum(x + step, floor)
            # The step in units of what changes the residuals as much as all of them are now.
            small = bool(np.all(np.abs(there - x) * np.sqrt(diagonal) <= 1e-9 * np.sqrt(cost)))
            relative = np.abs(there - x) <= 1e-13 * np.abs(x)
            r_new, j_new = evaluate(there)
            new = _cost(r_new)
            costs.append(min(new, cost))
            if new < cost:
                gain = (cost - new) / cost
                x, r, jacobian, cost = there, r_new, j_new, new
                damping, accepted = max(damping / 10, 1e-12), True
                small = small or gain < 1e-12
                break
            if small or np.all(relative):
                small = True
                break
            damping *= 10
        if small or cost == 0.0:
            converged = True
            break
        if not accepted:
            break
    return Found(x, len(costs), np.array(costs), converged)


def _cost(r: np.ndarray) -> float:
    total = float(r @ r) if np.all(np.isfinite(r)) else np.inf
    return total if np.isfinite(total) else np.inf
