"""Where an undamped motion stands still: the stable equilibria of a restoring force.

Found from the force's values (`rest_near`: a bracket, then Brent's method), or from a place that is about right by
Newton's method (`newton`, and `newton_many` for arrays).
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import ArrayLike

from bayesdamp.physics.arrays import slope_of

Force = Callable[[np.ndarray], np.ndarray]
"""Positions (n,) to the restoring force, (n,), in rad/s² or m/s²."""

STEPS = 60
"""In which Newton's method must have come to an equilibrium."""
CLOSE = 1e-13
"""Length of a step, rad or m, from which on it has; as a share of places beyond 1."""


def by_kernel(kernel: Callable[[float, np.ndarray], float], law: np.ndarray) -> Force:
    """The force of a law's kernel at values of its parameters, (r,)."""
    return lambda x: np.array([kernel(at, law) for at in x.tolist()])


def bracket(force: Force, near: float, reach: float, points: int) -> tuple[float, float] | None:
    """Neighbours of a grid within `reach` of `near` that have the nearest stable equilibrium between them; None where
    there is none."""
    grid = near + np.linspace(-reach, reach, points)
    values = force(grid)
    rising = np.flatnonzero((values[:-1] <= 0) & (values[1:] > 0))
    if rising.size == 0:
        return None
    i = rising[np.argmin(np.abs(grid[rising] - near))]
    return float(grid[i]), float(grid[i + 1])


def rest_near(force: Force, near: float, reach: float, points: int = 401) -> float | None:
    """The stable equilibrium nearest to `near` within `reach`, rad or m; None where there is none."""
    from scipy.optimize import brentq

    ends = bracket(force, near, reach, points)
    if ends is None:
        return None
    return float(brentq(lambda x: float(force(np.array([x]))[0]), *ends, xtol=1e-14))  # type: ignore[arg-type]


def frequency_over(force: Force, low: float, high: float) -> float:
    """√F′ between two places about an equilibrium, rad/s; 0 where the force pushes away."""
    below, above = force(np.array([low, high]))
    return float(np.sqrt(max((above - below) / (high - low), 0.0)))


def newton(force_and_slope: Callable[[float], tuple[float, float]], near: float) -> float | None:
    """The stable equilibrium that Newton's method finds from `near`; None where a slope on the way pushes away."""
    x = near
    for _ in range(STEPS):
        force, slope = force_and_slope(x)
        if slope <= 0:
            return None
        step = force / slope
        x -= step
        if abs(step) < CLOSE * max(1.0, abs(x)):
            return x
    return None


def newton_many(force: Force, near: ArrayLike, steps: int) -> np.ndarray:
    """Return the equilibria that so many of Newton's steps find from `near`; force and positions of one shape."""
    x = np.asarray(near, float)
    with np.errstate(all="ignore"):
        for _ in range(steps):
            x = x - force(x) / slope_of(force, x)
    return x
