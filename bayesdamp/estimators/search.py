"""Small searches: bounded Brent with a bracket that widens, and a search over a term's further parameters."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from itertools import product

import numpy as np
import scipy  # loads its modules when they are used

from bayesdamp.priors import Prior

SCORE = 3.5
"""Farthest distance from the middle of its prior at which a term's further parameter is searched, in normal scores."""


def brent(cost: Callable[[float], float], guess: float, unit: float) -> tuple[float, np.ndarray]:
    """Find the minimum of `cost` over x ≥ 0 (paper, section 3.3: Brent's method with bounded search).

    The bracket is [guess/3, 3·guess] and moves on if the minimum is at its end.

    Parameters
    ----------
    cost
        The function to minimise.
    guess
        Where the search starts, but no lower than `unit`.
    unit
        A value of x that is small but matters.

    Returns
    -------
    float, ndarray
        The best x, and the cost of each evaluation.
    """
    costs: list[float] = []

    def counted(x: float) -> float:
        costs.append(cost(x))
        return costs[-1]

    factor = 3.0
    centre = max(guess, unit)
    low, high = centre / factor, centre * factor
    x = centre
    for _ in range(12):
        result = scipy.optimize.minimize_scalar(
            counted, bounds=(low, high), method="bounded", options={"xatol": 1e-9 * max(centre, unit)}
        )
        x = float(result.x)  # pyright: ignore[reportAttributeAccessIssue]
        margin = 1e-3 * (high - low)
        if x > high - margin:
            low, high = x / factor, high * factor**2
        elif x < low + margin and low > 0.0:
            low, high = (low / factor**3 if low > unit / factor else 0.0), x * factor
        else:
            break
        centre = max(x, unit)
    if low == 0.0 and counted(0.0) <= counted(x):
        x = 0.0
    return x, np.array(costs)


def search_further(
    priors: Mapping[str, Prior], cost: Callable[[dict[str, float]], float]
) -> dict[str, float]:
    """Find the values of these parameters with the least cost.

    This is variable projection (Golub and Pereyra 1973) if the cost is what the best coefficients leave. Nelder and
    Mead's search runs over the parameters' normal scores, from the best point of a grid.
    """
    if not priors:
        return {}

    def values(z: np.ndarray) -> dict[str, float]:
        bounded = np.clip(z, -SCORE, SCORE)
        return {
            n: float(p.value(np.abs(x) if p.reflected else x)) for (n, p), x in zip(priors.items(), bounded)
        }

    def bounded_cost(z: np.ndarray) -> float:
        return cost(values(z)) * (1.0 + float(np.sum(np.maximum(np.abs(z) - SCORE, 0.0))))

    starts = [np.array(z) for z in product(*[(-1.0, 0.1, 1.0)] * len(priors))]
    options = {"xatol": 1e-5, "fatol": 0.0, "maxfev": 400}
    result = scipy.optimize.minimize(
        bounded_cost, min(starts, key=bounded_cost), method="Nelder-Mead", options=options
    )
    return values(result.x)
