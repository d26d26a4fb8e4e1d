"""tanh out of additions and multiplications alone.

The compiler's own exp, tanh and division each end a fused loop; a step has seven stages and would fall into
dozens of small loops. In batches this form is about twice as fast, at an absolute error below 2e-13.
"""

from __future__ import annotations

import jax
import numpy as np
from jax import Array
from jax import numpy as jnp

_LARGEST = 38.0
"""2|x| from which tanh is 1 in double precision."""
_HALVINGS = 7
_RANGE = _LARGEST / 2**_HALVINGS
_EXP = tuple(
    float(c)
    for c in np.polynomial.Chebyshev.interpolate(lambda u: np.exp(-u), 11, domain=[0.0, _RANGE])
    .convert(kind=np.polynomial.Polynomial)
    .coef
)


def _polynomial(c: tuple[float, ...], x: Array) -> Array:
    """Estrin's scheme: pairs, then pairs of pairs, so that the chain of dependent operations is short."""
    terms = [c[i] + c[i + 1] * x for i in range(0, len(c), 2)]
    power = x * x
    while len(terms) > 1:
        paired = [terms[i] + terms[i + 1] * power for i in range(0, len(terms) - 1, 2)]
        terms = paired + terms[2 * len(paired) :]
        power = power * power
    return terms[0]


@jax.custom_jvp
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
def _jvp(primals: tuple[Array], tangents: tuple[Array]) -> tuple[Array, Array]:
    y = smooth_sign(primals[0])
    return y, (1.0 - y * y) * tangents[0]
