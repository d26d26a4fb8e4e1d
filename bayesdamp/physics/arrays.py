"""Evaluate forces, plain Python functions of numbers, on NumPy arrays: a force is written once."""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import lru_cache, reduce
from types import FunctionType
from typing import Any

import numpy as np
import scipy  # loads its modules when they are used

_NAMES = {
    "acos": "arccos", "acosh": "arccosh", "asin": "arcsin", "asinh": "arcsinh", "atan": "arctan", "atan2": "arctan2",
    "atanh": "arctanh", "fabs": "abs", "pow": "power",
}  # fmt: skip
"""Functions of `math` with another name in NumPy."""
CHANGE = 1e-4
"""Step of differences of fourth order, relative to the place: their error is about 1e-12."""


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
