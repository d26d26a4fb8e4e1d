"""Viscous damping 2ζθ̇ (paper, equation 2)."""

from __future__ import annotations

from bayesdamp.physics.damping import DampingTerm
from bayesdamp.types import Symbol


class Viscous(DampingTerm):
    """F = 2ζθ̇ with the decay rate ζ in 1/s. The paper's ζ is ω_n times the usual (dimensionless) damping ratio."""

    name = "viscous"
    parameter = "zeta"
    symbol = Symbol("ζ", r"$\zeta$", "decay rate")
    unit = "1/s"
    words = "viscous"
    formula = "2ζθ̇"

    @staticmethod
    def kernel(x: float, v: float, epsilon: float) -> float:
        """Return 2v."""
        return 2.0 * v

    def ratio_per_unit(self, amplitude: float, frequency: float) -> float:
        """Return 1/ω, which does not depend on the amplitude."""
        return 1.0 / frequency


PLUGIN = Viscous()
