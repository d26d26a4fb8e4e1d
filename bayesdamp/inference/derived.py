"""Quantities that follow from a posterior's draws."""

from __future__ import annotations

from collections.abc import Mapping

import jax
import numpy as np
from jax import numpy as jnp

from bayesdamp.physics.oscillator import Oscillator


def natural_frequency(osc: Oscillator, values: Mapping[str, np.ndarray | float], near: float) -> np.ndarray:
    """ω_n = √F′_rest at the equilibrium that Newton's method finds from `near` (rad), rad/s.

    values: the restoring law's parameters, scalars or arrays of one shape; the result has that shape, nan where
    there is no stable equilibrium.
    """
    names = osc.law.parameters
    arrays = np.broadcast_arrays(*[np.asarray(values[n], float) for n in names])

    def one(*numbers):
        p = dict(zip(names, numbers, strict=True))

        def force(x):
            return osc.law.force(x, p)

        slope = jax.grad(force)
        x = jax.lax.fori_loop(0, 30, lambda _, x: x - force(x) / slope(x), jnp.asarray(float(near)))
        return jnp.sqrt(slope(x))

    flat = jax.jit(jax.vmap(one))(*[jnp.asarray(a.ravel()) for a in arrays])
    return np.asarray(flat).reshape(arrays[0].shape)
