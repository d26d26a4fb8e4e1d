"""Quadratic damping μ_q θ̇|θ̇|, air drag (paper, equation 4)."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from bayesdamp.numerics.lazily import jnp
from bayesdamp.physics.damping._term import DampingTerm
from bayesdamp.types import Symbol

if TYPE_CHECKING:
    from jax import Array
    from jax.typing import ArrayLike


class Quadratic(DampingTerm):
    """F = μ_q θ̇|θ̇|, μ_q in 1/rad."""

    name = "quadratic"
    parameter = "mu_q"
    symbol = Symbol("μq", r"$\mu_q$", "quadratic damping")
    unit = "1/rad"
    words = "quadratic (drag)"
    formula = "μq θ̇|θ̇|"

    def shape(self, velocity: ArrayLike, epsilon: ArrayLike) -> Array:
        """θ̇|θ̇|."""
        velocity = jnp.asarray(velocity)
        return velocity * jnp.abs(velocity)

    @staticmethod
    def kernel(x: float, v: float, epsilon: float) -> float:
        """v|v|."""
        return v * abs(v)

    def ratio_per_unit(self, amplitude: float, frequency: float) -> float:
        """4A/(3π)."""
        return 4.0 * amplitude / (3.0 * math.pi)


PLUGIN = Quadratic()
