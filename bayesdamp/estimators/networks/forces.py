"""The forces of an oscillator with their derivatives, as arrays: what training by hand-made tangents needs."""

from __future__ import annotations

from functools import lru_cache

import jax
import numpy as np
from jax import numpy as jnp

from bayesdamp.physics.oscillator import Oscillator


@lru_cache(maxsize=64)
def _restoring(osc: Oscillator, free: tuple[str, ...]):
    def force(theta, values, known):
        return osc.law.force(theta, {**known, **{name: values[i] for i, name in enumerate(free)}})

    @jax.jit
    def every(theta, values, known):
        value, slope = jax.jvp(lambda x: force(x, values, known), (theta,), (jnp.ones_like(theta),))
        by = jax.jacfwd(lambda v: force(theta, v, known))(values) if free else jnp.zeros((theta.size, 0))
        return value, slope, by

    return every


@lru_cache(maxsize=64)
def _shapes(osc: Oscillator):
    @jax.jit
    def every(omega, epsilon):
        def shapes(x):
            return jnp.stack([term.force(jnp.zeros_like(x), x, epsilon) for term in osc.terms])

        value, slope = jax.jvp(shapes, (omega,), (jnp.ones_like(omega),))
        return value.T, slope.T

    return every


class Forces:
    """Forces per inertia, rad/s², at n angles or velocities.

    free: names of the restoring parameters that are sought; known: the values of the others.
    """

    def __init__(
        self, osc: Oscillator, known: dict[str, float], free: tuple[str, ...], epsilon: float
    ) -> None:
        self._known = {name: jnp.asarray(known[name]) for name in osc.law.parameters if name not in free}
        self._force, self._shape, self._epsilon = _restoring(osc, free), _shapes(osc), jnp.asarray(epsilon)

    def restoring(self, theta: np.ndarray, values: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """F_rest (n,), its slope by θ (n,), and its derivatives by the free parameters (n, k)."""
        return tuple(np.array(x) for x in self._force(theta, values, self._known))  # type: ignore[return-value]

    def shapes(self, omega: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Damping force per unit of each coefficient and its slope by θ̇, both (n, terms)."""
        return tuple(np.array(x) for x in self._shape(omega, self._epsilon))  # type: ignore[return-value]
