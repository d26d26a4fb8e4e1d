"""Evaluate scalar force functions on arrays, and find the stable equilibria of a restoring force.

`rest_near` brackets the nearest equilibrium on a grid and then uses Brent's method. `newton` (scalars) and
`newton_many` (arrays) use Newton's method from a position close to the equilibrium. Forces are per unit of inertia.
"""

from collections.abc import Callable, Sequence
from functools import lru_cache, reduce
from types import FunctionType
from typing import Any

import numpy as np
import scipy  # loads its modules when they are used
from numpy.typing import ArrayLike

Force = Callable[[np.ndarray], np.ndarray]
"""A function that returns the restoring force per unit of inertia, (n,), in rad/s² or m/s², at positions (n,) in rad or
m."""
MAX_STEPS, CONVERGED_STEP = 60, 1e-13
"""Limits of Newton's method in `newton`: the greatest number of steps, and the length of a step (rad or m) below which
the method has converged. For positions above 1 this length is relative to the position (conventional)."""
RELATIVE_STEP = 1e-4
"""Step of the fourth-order difference quotient in `slope_of`. For |x| > 1 the step is relative to |x|. The error of the
derivative is then about 1e-12."""
CENTRE_POINTS = 20
"""Number of grid points on either side of the centre among which `bracket` searches first for an equilibrium. It
searches the whole grid only if it finds none there."""


class _Math:
    """Replacement of the module `math`, whose functions accept arrays."""

    def __getattr__(self, name: str) -> Any:
        return scipy.special.erf if name == "erf" else getattr(np, name)


def with_names(function: Callable[..., Any], mathematics: Any) -> Callable[..., Any]:
    """Return a copy of a scalar function that takes its mathematical functions from another module.

    In the copy, the names `math`, `np`, `abs`, `max`, `min` and `pow` refer to this module, and `float` returns its
    argument unchanged; other global names of the function's own module are not defined. The copy can, for example,
    accept arrays. mathematics: the module, with functions abs, maximum, minimum and pow.
    """
    assert isinstance(function, FunctionType)
    names = {
        "math": mathematics,
        "np": mathematics,
        "abs": mathematics.abs,
        "max": lambda *values: reduce(mathematics.maximum, values),
        "min": lambda *values: reduce(mathematics.minimum, values),
        "float": lambda value: value,
        "pow": mathematics.pow,
    }
    return FunctionType(
        function.__code__, names, function.__name__, function.__defaults__, function.__closure__
    )


@lru_cache(maxsize=256)
def on_arrays(function: Callable[..., Any]) -> Callable[..., np.ndarray]:
    """Return a version of a scalar function that accepts arrays and broadcasts them.

    If an argument is a tuple, the function receives a tuple, and each element may be an array. The function may use no
    global names but `math` and `np`. If it does not work on arrays, for example because it has an `if`, it is called
    once for each element.
    """
    array_function = with_names(function, _Math())

    def evaluate(*args: Any) -> np.ndarray:
        try:
            return np.asarray(array_function(*args), float)
        except (ValueError, TypeError, AttributeError):
            pass
        shape = np.broadcast_shapes(
            *(np.shape(part) for a in args for part in (a if isinstance(a, tuple) else (a,)))
        )

        def elements(a: Any) -> Any:
            if isinstance(a, tuple):
                return list(zip(*map(elements, a), strict=True)) or [()] * int(np.prod(shape))
            return np.broadcast_to(a, shape).ravel().tolist()

        values = [function(*row) for row in zip(*map(elements, args), strict=True)]
        return np.array(values, float).reshape(shape)

    return evaluate


def slope_of(
    function: Callable[[np.ndarray], np.ndarray], x: np.ndarray, step: float | None = None
) -> np.ndarray:
    """Return the derivative of an elementwise function at x (any shape), by a fourth-order central difference.

    step: step of the difference; by default `RELATIVE_STEP` times the larger of 1 and |x|.
    """
    h = RELATIVE_STEP * np.maximum(1.0, np.abs(x)) if step is None else step
    near = function(x + h) - function(x - h)
    far = function(x + 2 * h) - function(x - 2 * h)
    return (8.0 * near - far) / (12.0 * h)


def by_kernel(kernel: Callable[[float, Sequence[float]], float], law: np.ndarray) -> Force:
    """Return the restoring force as a function of the position only, which maps positions (n,) to forces (n,).

    kernel: function of a position and the law's parameters that returns the force (`RestoringLaw.kernel`). law: values
    of these parameters, in the order of the law's `parameters`, (r,).
    """
    values, on_array = tuple(law.tolist()), on_arrays(kernel)
    return lambda x: on_array(x, values) if x.size != 1 else np.array([kernel(x.item(), values)])


def bracket(force: Force, near: float, reach: float, points: int) -> tuple[float, float] | None:
    """Return the grid points below and above the stable equilibrium nearest to `near`; None if the grid has none.

    force: restoring force as a function of the position; at a stable equilibrium it changes from negative to positive.
    near, reach, points: centre and half-width (rad or m) and number of points of the grid.
    """
    grid = near + np.linspace(-reach, reach, points)
    for part in (grid[points // 2 - CENTRE_POINTS : points // 2 + CENTRE_POINTS + 1], grid):
        values = force(part)
        rising = np.flatnonzero((values[:-1] <= 0) & (values[1:] > 0))
        if rising.size:
            i = rising[np.argmin(np.abs(part[rising] - near))]
            return float(part[i]), float(part[i + 1])
    return None


def rest_near(force: Force, near: float, reach: float, points: int = 401) -> float | None:
    """Return the stable equilibrium nearest to `near` within the distance `reach`; None if there is none.

    force: restoring force as a function of the position. near, reach and result: in rad or m. points: number of points
    of the grid on which the equilibrium is searched.
    """
    ends = bracket(force, near, reach, points)
    if ends is None:
        return None
    return float(scipy.optimize.brentq(lambda x: float(force(np.array([x]))[0]), *ends, xtol=1e-14))  # type: ignore[arg-type]


def frequency_over(force: Force, low: float, high: float) -> float:
    """Return the natural frequency √F′ in rad/s, where F′ is the mean slope of the force from `low` to `high`.

    force: restoring force per unit of inertia. low, high: positions in rad or m. The result is 0 if F′ < 0.
    """
    below, above = force(np.array([low, high]))
    return float(np.sqrt(max((above - below) / (high - low), 0.0)))


def newton(force_and_slope: Callable[[float], tuple[float, float]], near: float) -> float | None:
    """Return the stable equilibrium that Newton's method reaches from the position `near` (both in rad or m).

    force_and_slope: function that returns the restoring force at a position, and its derivative by the position. The
    result is None if this derivative is not positive at a position on the way, or if the method has not converged after
    `MAX_STEPS` steps.
    """
    x = near
    for _ in range(MAX_STEPS):
        force, slope = force_and_slope(x)
        if slope <= 0:
            return None
        step = force / slope
        x -= step
        if abs(step) < CONVERGED_STEP * max(1.0, abs(x)):
            return x
    return None


def newton_many(force: Force, near: ArrayLike, steps: int) -> np.ndarray:
    """Return the positions after a fixed number of Newton steps towards zero restoring force, in the shape of `near`.

    force: function that returns the restoring force at positions. near: positions at the start, in rad or m, any shape.
    steps: number of steps. Convergence is not checked. If the
    method has converged, the results are equilibria, stable or not.
    """
    x = np.asarray(near, float)
    with np.errstate(all="ignore"):
        for _ in range(steps):
            x = x - force(x) / slope_of(force, x)
    return x
