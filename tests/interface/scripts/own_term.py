"""A damping term of one's own, proportional to the cube of the velocity."""
# pyright: reportUnknownMemberType=false

from jax import Array
from jax import numpy as jnp
from jax.typing import ArrayLike

import bayesdamp as bd
from bayesdamp.physics.damping import TERMS


class Cubic(bd.DampingTerm):
    name, parameter, unit = "cubic", "mu_3", "s/rad²"

    def shape(self, velocity: ArrayLike, epsilon: ArrayLike) -> Array:
        return jnp.asarray(velocity) ** 3

    def ratio_per_unit(self, amplitude: float, frequency: float) -> float:
        return 3 / 8 * amplitude**2 * frequency


TERMS.add("cubic", Cubic())
signal = bd.simulate({"cubic": 0.08}, "linear", stiffness=20.0, duration=6.0, samples=150, noise_sd=0.003)
print(bd.fit(signal, bd.Model("cubic", noise="gaussian")))
