"""Quadratic damping μ_q θ̇|θ̇| at the velocity θ̇, such as air drag (equation 4 of the paper that bayesdamp tests)."""

import math

from bayesdamp.physics.damping import DampingTerm
from bayesdamp.types import Symbol


class Quadratic(DampingTerm):
    """Quadratic damping F = μ_q θ̇|θ̇| per unit of inertia, with μ_q in 1/rad."""

    parameter = "mu_q"
    symbol = Symbol("μq", r"$\mu_q$", "quadratic damping")
    unit = "1/rad"
    words = "quadratic (drag)"
    formula = "μq θ̇|θ̇|"

    @staticmethod
    def kernel(x: float, v: float, epsilon: float) -> float:
        """Return the damping force per unit of its coefficient μ_q at velocity v (rad/s or m/s), which is v|v|.

        The arguments x (displacement) and epsilon have no effect on this term.
        """
        return v * abs(v)

    def ratio_per_unit(self, amplitude: float, frequency: float) -> float:
        """Return the equivalent viscous damping ratio 4A/(3π) of quadratic damping for μ_q = 1/rad.

        The amplitude A is in rad; the frequency has no effect.
        """
        return 4.0 * amplitude / (3.0 * math.pi)


PLUGIN = Quadratic()
