"""Evaluate forces, plain Python functions of numbers, on arrays; find the stable equilibria of a restoring force.

`rest_near` uses the force's values (a bracket, then Brent's method); `newton`, and `newton_many` for arrays, start from
a place nearby.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from functools import lru_cache, reduce
from types import FunctionType
from typing import Any

import numpy as np
import scipy  # loads its modules when they are used
from numpy.typing import ArrayLike

_NAMES = {
    "acos": "arccos", "acosh": "arccosh", "asin": "arcsin", "asinh": "arcsinh", "atan": "arctan", "atan2": "arctan2",
    "atanh": "arctanh", "fabs": "abs", "pow": "power",
}  # fmt: skip
"""Functions of `math` with another name in NumPy."""
Force = Callable[[np.ndarray], np.ndarray]
"""The restoring force, (n,), in rad/s² or m/s², at positions (n,)."""
STEPS, CLOSE = 60, 1e-13
"""Largest number of steps of Newton's method, and length of a step, rad or m (relative beyond 1), at which it has
converged."""
CHANGE = 1e-4
"""Step of differences of fourth order, relative to the place: their error is about 1e-12."""
CENTRE = 20
"""Points on either side of the centre of a grid that are tried before the whole grid."""


class _Math:
    """`math` for arrays."""

    def __getattr__(self, name: str) -> Any:
        if name == "erf":
            return scipy.special.erf
        value = getattr(math, name)
        return getattr(np, _NAMES.get(name, name)) if callable(value) else value


_GLOBALS: dict[str, Any] = {
    "math": _Math(),
    "np": np,
    "abs": np.abs,
    "max": lambda *values: reduce(np.maximum, values),
    "min": lambda *values: reduce(np.minimum, values),
    "float": np.asarray,
    "pow": np.power,
}
"""The meaning of names in a force's function on arrays."""


@lru_cache(maxsize=256)
def on_arrays(function: Callable[..., Any]) -> Callable[..., np.ndarray]:
    """Return a function of numbers as a function of arrays that broadcast; a tuple among its arguments stays a tuple.

    A function that decides by `if` or loops over numbers, which arrays cannot do, is called number by number.
    """
    assert isinstance(function, FunctionType)
    array_function = FunctionType(
        function.__code__, dict(_GLOBALS), function.__name__, function.__defaults__, function.__closure__
    )

    def evaluate(*args: Any) -> np.ndarray:
        try:
            return np.asarray(array_function(*args), float)
        except (ValueError, TypeError, AttributeError):
            pass
        flat = [part for a in args for part in (a if isinstance(a, tuple) else (a,))]
        sizes = [len(a) if isinstance(a, tuple) else 0 for a in args]
        shape = np.broadcast_shapes(*(np.shape(part) for part in flat))
        values = []
        for row in zip(*(np.broadcast_to(part, shape).ravel().tolist() for part in flat), strict=True):
            numbers = iter(row)
            values.append(
                function(*(tuple(next(numbers) for _ in range(n)) if n else next(numbers) for n in sizes))
            )
        return np.array(values, float).reshape(shape)

    return evaluate


def slope_of(
    function: Callable[[np.ndarray], np.ndarray], x: np.ndarray, step: float | None = None
) -> np.ndarray:
    """Return the derivative of an elementwise function at x, any shape, by differences of fourth order.

    step: by default a ten-thousandth of x, or of 1 where x is smaller.
    """
    h = CHANGE * np.maximum(1.0, np.abs(x)) if step is None else step
    near = function(x + h) - function(x - h)
    far = function(x + 2 * h) - function(x - 2 * h)
    return (8.0 * near - far) / (12.0 * h)


def by_kernel(kernel: Callable[[float, Sequence[float]], float], law: np.ndarray) -> Force:
    """Return the force of a law's kernel at values of its parameters, (r,)."""
    values, on_array = tuple(law.tolist()), on_arrays(kernel)
    return lambda x: on_array(x, values) if x.size > 1 else np.array([kernel(x.item(), values)])


def bracket(force: Force, near: float, reach: float, points: int) -> tuple[float, float] | None:
    """Return two neighbours of a grid with the nearest stable equilibrium between them; None where there is none.

    near, reach, points: centre, half width and number of points of the grid.
    """
    grid = near + np.linspace(-reach, reach, points)
    for some in (grid[points // 2 - CENTRE : points // 2 + CENTRE + 1], grid):
        values = force(some)
        rising = np.flatnonzero((values[:-1] <= 0) & (values[1:] > 0))
        if rising.size:
            i = rising[np.argmin(np.abs(some[rising] - near))]
            return float(some[i]), float(some[i + 1])
    return None


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
