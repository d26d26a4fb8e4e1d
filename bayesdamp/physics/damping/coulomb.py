"""Coulomb friction (dry friction): a force with the sign of the velocity and a constant magnitude.

It is equation 3 of the paper whose claims bayesdamp tests.
"""

import math

from bayesdamp.physics.damping import DampingTerm
from bayesdamp.types import Symbol


class Coulomb(DampingTerm):
    """Coulomb friction F = μ_c tanh(θ̇/ε) per unit of inertia, with μ_c in rad/s².

    ε is the width of the range of velocities θ̇ in which the friction changes its sign. With ε = 0 the tanh is the sign
    of θ̇, and the body may stick.
    """

    parameter = "mu_c"
    symbol = Symbol("μc", r"$\mu_c$", "Coulomb friction")
    unit = "rad/s²"
    words = "Coulomb (dry friction)"
    formula = "μc tanh(θ̇/ε)"
    switches = True

    @staticmethod
    def kernel(x: float, v: float, epsilon: float) -> float:
        """Return the friction per unit of its coefficient μ_c at velocity v (rad/s or m/s), which is tanh(v/ε).

        epsilon: width ε > 0, in the unit of v, of the range of velocities in which the friction changes its sign. The
        argument x (displacement) has no effect on this term.
        """
        return math.tanh(v / epsilon)

    def ratio_per_unit(self, amplitude: float, frequency: float) -> float:
        """Return the equivalent viscous damping ratio 2/(πω²A) of Coulomb friction for μ_c = 1 rad/s².

        The amplitude A is in rad, the frequency ω in rad/s.
        """
        return 2.0 / (math.pi * frequency**2 * amplitude)


PLUGIN = Coulomb()
