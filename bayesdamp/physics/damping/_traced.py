"""A kernel in plain Python, run on JAX's arrays: what is written once is compiled by Numba and traced by JAX alike."""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import cache, lru_cache, reduce
from types import FunctionType
from typing import TYPE_CHECKING, Any

from bayesdamp.numerics.lazily import jax, jnp
from bayesdamp.physics.elementary import cosine, sine, smooth_sign

if TYPE_CHECKING:
    from jax import Array

_NAMES = {
    "acos": "arccos", "acosh": "arccosh", "asin": "arcsin", "asinh": "arcsinh", "atan": "arctan", "atan2": "arctan2",
    "atanh": "arctanh", "fabs": "abs", "pow": "power",
}  # fmt: skip
"""Functions of `math` that have another name among arrays."""


def _erf(x: Array) -> Array:
    from jax.scipy.special import erf

    return erf(x)


_FAST = {"cos": cosine, "sin": sine, "tanh": smooth_sign, "erf": _erf}


class _Math:
    """`math` for arrays."""

    def __getattr__(self, name: str) -> Any:
        if name in _FAST:
            return lambda x: _FAST[name](jnp.asarray(x, float))
        found = getattr(math, name)
        return getattr(jnp, _NAMES.get(name, name)) if callable(found) else found


def _largest(*values: Any) -> Array:
    return reduce(jnp.maximum, values)


def _smallest(*values: Any) -> Array:
    return reduce(jnp.minimum, values)


@cache
def _words() -> dict[str, Any]:
    """What the names in a kernel stand for."""
    return {
        "math": _Math(),
        "np": jnp,
        "abs": jnp.abs,
        "max": _largest,
        "min": _smallest,
        "float": jnp.asarray,
        "pow": jnp.power,
    }


@lru_cache(maxsize=256)
def on_arrays(kernel: Callable[..., Any]) -> Callable[..., Array]:
    """The kernel as a function of arrays, with the same arguments."""
    assert isinstance(kernel, FunctionType)
    made = FunctionType(
        kernel.__code__, dict(_words()), kernel.__name__, kernel.__defaults__, kernel.__closure__
    )
    return lambda *args: jnp.asarray(made(*args), float)


@lru_cache(maxsize=256)
def why_not(kernel: Callable[..., Any], arguments: int) -> str:
    """Why JAX cannot trace a kernel of so many arguments, in a clause; empty where it can."""
    scalar = jax.ShapeDtypeStruct((), float)
    try:
        jax.eval_shape(on_arrays(kernel), *[scalar] * arguments)
    except jax.errors.ConcretizationTypeError:
        return "its kernel decides by `if`, `and`, `or` or a loop: write it with max, min and abs, or give a `force`"
    except Exception as error:  # whatever a user's function raises
        return f"its kernel does not run on arrays ({type(error).__name__}): give a `force` that does"
    return ""
