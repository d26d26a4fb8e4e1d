"""Find the stable equilibria of a restoring force.

`rest_near` uses the force's values (a bracket, then Brent's method); `newton`, and `newton_many` for arrays, start from
a place nearby.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import scipy  # loads its modules when they are used
from numpy.typing import ArrayLike

from bayesdamp.physics.arrays import slope_of

Force = Callable[[np.ndarray], np.ndarray]
"""The restoring force, (n,), in rad/s² or m/s², at positions (n,)."""

STEPS = 60
"""Largest number of steps of Newton's method."""
CLOSE = 1e-13
"""Length of a step, rad or m, at which Newton's method has converged; relative for places beyond 1."""


def by_kernel(kernel: Callable[[float, np.ndarray], float], law: np.ndarray) -> Force:
    """Return the force of a law's kernel at values of its parameters, (r,)."""
    return lambda x: np.array([kernel(at, law) for at in x.tolist()])


def bracket(force: Force, near: float, reach: float, points: int) -> tuple[float, float] | None:
    """Return two neighbours of a grid with the nearest stable equilibrium between them; None where there is none.

    near, reach, points: centre, half width and number of points of the grid.
    """
    grid = near + np.linspace(-reach, reach, points)
    values = force(grid)
    rising = np.flatnonzero((values[:-1] <= 0) & (values[1:] > 0))
    if rising.size == 0:
        return None
    i = rising[np.argmin(np.abs(grid[rising] - near))]
    return float(grid[i]), float(grid[i + 1])


def rest_near(force: Force, near: float, reach: float, points: int = 401) -> float | None:
    """Return the stable equilibrium nearest to `near` within `reach`, rad or m; None where there is none."""
    ends = bracket(force, near, reach, points)
    if ends is None:
        return None
    return float(scipy.optimize.brentq(lambda x: float(force(np.array([x]))[0]), *ends, xtol=1e-14))  # type: ignore[arg-type]


def frequency_over(force: Force, low: float, high: float) -> float:
    """Return √F′ between two places about an equilibrium, rad/s; 0 where the force pushes away."""
    below, above = force(np.array([low, high]))
    return float(np.sqrt(max((above - below) / (high - low), 0.0)))


def newton(force_and_slope: Callable[[float], tuple[float, float]], near: float) -> float | None:
    """Return the stable equilibrium that Newton's method finds from `near`; None where the force pushes away."""
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
    """Return the equilibria after some steps of Newton's method from `near`; force and positions have one shape."""
    x = np.asarray(near, float)
    with np.errstate(all="ignore"):
        for _ in range(steps):
            x = x - force(x) / slope_of(force, x)
    return x
