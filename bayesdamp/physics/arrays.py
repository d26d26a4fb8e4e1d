"""Forces as plain Python functions of numbers, evaluated on NumPy arrays: a force is written once."""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import cache, lru_cache, reduce
from types import FunctionType
from typing import Any

import numpy as np

_NAMES = {
    "acos": "arccos", "acosh": "arccosh", "asin": "arcsin", "asinh": "arcsinh", "atan": "arctan", "atan2": "arctan2",
    "atanh": "arctanh", "fabs": "abs", "pow": "power",
}  # fmt: skip
"""Functions of `math` that NumPy calls by another name."""
CHANGE = 1e-4
"""Step of differences of fourth order, relative to the place: their error is about 1e-12."""


class _Math:
    """`math` for arrays."""

    def __getattr__(self, name: str) -> Any:
        if name == "erf":
            from scipy.special import erf

            return erf
        found = getattr(math, name)
        return getattr(np, _NAMES.get(name, name)) if callable(found) else found


@cache
def _words() -> dict[str, Any]:
    """Return what the names in a force's function stand for."""
    return {
        "math": _Math(),
        "np": np,
        "abs": np.abs,
        "max": lambda *values: reduce(np.maximum, values),
        "min": lambda *values: reduce(np.minimum, values),
        "float": np.asarray,
        "pow": np.power,
    }


@lru_cache(maxsize=256)
def on_arrays(function: Callable[..., Any]) -> Callable[..., np.ndarray]:
    """Return a function of numbers as one of arrays that broadcast; a tuple among its arguments stays one.

    One that decides by `if` or loops over numbers, which arrays cannot do, is called number by number.
    """
    assert isinstance(function, FunctionType)
    made = FunctionType(
        function.__code__, dict(_words()), function.__name__, function.__defaults__, function.__closure__
    )

    def evaluated(*args: Any) -> np.ndarray:
        try:
            return np.asarray(made(*args), float)
        except (ValueError, TypeError, AttributeError):
            return _one_by_one(function, args)

    return evaluated


def _one_by_one(function: Callable[..., Any], args: tuple[Any, ...]) -> np.ndarray:
    flat = [part for a in args for part in (a if isinstance(a, tuple) else (a,))]
    sizes = [len(a) if isinstance(a, tuple) else 0 for a in args]
    shape = np.broadcast_shapes(*(np.shape(part) for part in flat))
    rows = zip(*(np.broadcast_to(part, shape).ravel().tolist() for part in flat), strict=True)

    def called(row: tuple[float, ...]) -> float:
        numbers = iter(row)
        return function(*(tuple(next(numbers) for _ in range(n)) if n else next(numbers) for n in sizes))

    return np.array([called(row) for row in rows], float).reshape(shape)


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
