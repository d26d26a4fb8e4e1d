"""cos, sin and tanh out of additions and multiplications alone.

The compiler's own are calls that a loop over a batch cannot vectorise, and they (with exp and division) break a step's
seven stages into dozens of small loops. In these forms a batch of trajectories runs several times faster.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np
from numpy.polynomial import Chebyshev, Polynomial

from bayesdamp.numerics.lazily import custom_jvp, jnp

if TYPE_CHECKING:
    from jax import Array
    from jax.typing import ArrayLike


def _power_series(function, degree: int, low: float, high: float) -> tuple[float, ...]:
    fitted = Chebyshev.interpolate(function, degree, domain=[low, high])
    return tuple(float(c) for c in fitted.convert(kind=Polynomial).coef)


def _polynomial(c: tuple[float, ...], x: Array) -> Array:
    """Estrin's scheme: pairs, then pairs of pairs, so that the chain of dependent operations is short."""
    terms = [c[i] + c[i + 1] * x for i in range(0, len(c), 2)]
    power = x * x
    while len(terms) > 1:
        paired = [terms[i] + terms[i + 1] * power for i in range(0, len(terms) - 1, 2)]
        terms = paired + terms[2 * len(paired) :]
        power = power * power
    return terms[0]


_PI_HIGH = 3.141592653589793
_PI_LOW = 1.2246467991473532e-16
_COS = tuple((-1.0) ** k / math.factorial(2 * k) for k in range(14))
"""Taylor's coefficients in x²; on [−π/2, π/2] the first one left out is below 1e-17."""


def _cosine(x: Array) -> Array:
    turns = jnp.round(x * (1.0 / _PI_HIGH))
    rest = (x - turns * _PI_HIGH) - turns * _PI_LOW
    odd = turns - 2.0 * jnp.floor(0.5 * turns)
    return (1.0 - 2.0 * odd) * _polynomial(_COS, rest * rest)


def _sine(x: Array) -> Array:
    return _cosine(x - 0.5 * _PI_HIGH)


@custom_jvp
def cosine(x: ArrayLike) -> Array:
    """cos(x), x in rad of any shape, within 1e-15 for |x| up to 1e3."""
    return _cosine(jnp.asarray(x, float))


@cosine.defjvp
def _cosine_jvp(primals: tuple[Array], tangents: tuple[Array]) -> tuple[Array, Array]:
    return cosine(primals[0]), -sine(primals[0]) * tangents[0]


@custom_jvp
def sine(x: ArrayLike) -> Array:
    """sin(x), x in rad of any shape, within 1e-15 for |x| up to 1e3."""
    return _sine(jnp.asarray(x, float))


@sine.defjvp
def _sine_jvp(primals: tuple[Array], tangents: tuple[Array]) -> tuple[Array, Array]:
    return sine(primals[0]), cosine(primals[0]) * tangents[0]


_LARGEST = 38.0
"""2|x| from which tanh is 1 in double precision."""
_HALVINGS = 7
_EXP = _power_series(lambda u: np.exp(-u), 11, 0.0, _LARGEST / 2**_HALVINGS)


@custom_jvp
def smooth_sign(x: Array) -> Array:
    """tanh(x), any shape, within 2e-13."""
    decay = _polynomial(_EXP, jnp.minimum(jnp.abs(x) * 2.0, _LARGEST) * 2.0**-_HALVINGS)
    for _ in range(_HALVINGS):
        decay = decay * decay
    # Newton's iteration for 1/d, d = (1 + decay)/2 in [1/2, 1], from the best straight line.
    d = 0.5 + 0.5 * decay
    inverse = 48.0 / 17.0 - 32.0 / 17.0 * d
    for _ in range(4):
        inverse = inverse * (2.0 - d * inverse)
    size = 0.5 * (1.0 - decay) * inverse
    return jnp.where(x < 0.0, -size, size)


@smooth_sign.defjvp
def _smooth_sign_jvp(primals: tuple[Array], tangents: tuple[Array]) -> tuple[Array, Array]:
    y = smooth_sign(primals[0])
    return y, (1.0 - y * y) * tangents[0]
