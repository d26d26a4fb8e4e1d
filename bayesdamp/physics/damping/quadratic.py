"""Quadratic damping μ_q θ̇|θ̇|, air drag (paper, equation 4)."""

from __future__ import annotations

import math

from bayesdamp.physics.damping import DampingTerm
from bayesdamp.types import Symbol


class Quadratic(DampingTerm):
    """F = μ_q θ̇|θ̇|, μ_q in 1/rad."""

    name = "quadratic"
    parameter = "mu_q"
    symbol = Symbol("μq", r"$\mu_q$", "quadratic damping")
    unit = "1/rad"
    words = "quadratic (drag)"
    formula = "μq θ̇|θ̇|"

    @staticmethod
    def kernel(x: float, v: float, epsilon: float) -> float:
        """Return v|v|."""
        return v * abs(v)

    def ratio_per_unit(self, amplitude: float, frequency: float) -> float:
        """Return 4A/(3π), with the amplitude A."""
        return 4.0 * amplitude / (3.0 * math.pi)


PLUGIN = Quadratic()
