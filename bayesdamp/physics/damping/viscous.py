"""Viscous damping 2ζθ̇, proportional to the velocity θ̇ (equation 2 of the paper whose claims bayesdamp tests)."""

from bayesdamp.physics.damping import DampingTerm
from bayesdamp.types import Symbol


class Viscous(DampingTerm):
    """Viscous damping F = 2ζθ̇ per unit of inertia, with the decay rate ζ in 1/s.

    ζ is the usual dimensionless damping ratio times the natural frequency ω_n, as in the paper whose claims bayesdamp
    tests.
    """

    parameter = "zeta"
    symbol = Symbol("ζ", r"$\zeta$", "decay rate")
    unit = "1/s"
    words = "viscous"
    formula = "2ζθ̇"

    @staticmethod
    def kernel(x: float, v: float, epsilon: float) -> float:
        """Return the damping force per unit of its coefficient ζ at velocity v (rad/s or m/s), which is 2v.

        The arguments x (displacement) and epsilon have no effect on this term.
        """
        return 2.0 * v

    def ratio_per_unit(self, amplitude: float, frequency: float) -> float:
        """Return the damping ratio 1/ω of viscous damping for ζ = 1/s.

        The frequency ω is in rad/s; the amplitude has no effect.
        """
        return 1.0 / frequency


PLUGIN = Viscous()
