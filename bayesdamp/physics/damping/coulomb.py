"""Coulomb friction μ_c tanh(θ̇/ε) (paper, equation 3)."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from bayesdamp.numerics.lazily import jnp
from bayesdamp.physics.damping._term import DampingTerm
from bayesdamp.physics.elementary import smooth_sign
from bayesdamp.types import Symbol

if TYPE_CHECKING:
    from jax import Array
    from jax.typing import ArrayLike


class Coulomb(DampingTerm):
    """F = μ_c tanh(θ̇/ε), μ_c in rad/s². With ε = 0 the sign, 0 at rest; sticking is the integrator's."""

    name = "coulomb"
    parameter = "mu_c"
    symbol = Symbol("μc", r"$\mu_c$", "Coulomb friction")
    unit = "rad/s²"
    words = "Coulomb (dry friction)"
    formula = "μc tanh(θ̇/ε)"
    switches = True

    def shape(self, velocity: ArrayLike, epsilon: ArrayLike) -> Array:
        """tanh(θ̇/ε), the sign at ε = 0."""
        velocity = jnp.asarray(velocity)
        smooth = smooth_sign(velocity / jnp.where(epsilon == 0.0, 1.0, epsilon))
        return jnp.where(epsilon == 0.0, jnp.sign(velocity), smooth)

    @staticmethod
    def kernel(x: float, v: float, epsilon: float) -> float:
        """tanh(v/ε)."""
        return math.tanh(v / epsilon)

    def ratio_per_unit(self, amplitude: float, frequency: float) -> float:
        """2/(πω²A): it grows as the amplitude falls."""
        return 2.0 / (math.pi * frequency**2 * amplitude)


PLUGIN = Coulomb()
