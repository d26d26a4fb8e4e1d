"""Structural (hysteretic) damping: a force proportional to the displacement that opposes the velocity.

The energy loss per cycle does not depend on the frequency (T. J. Reid, J. R. Aeronaut. Soc. 60, 283 (1956)).
"""

import math

from bayesdamp.physics.damping import DampingTerm
from bayesdamp.types import Symbol


class Structural(DampingTerm):
    """Structural damping F = κ |θ − θ_e| tanh(θ̇/ε) per unit of inertia, with the equilibrium θ_e and κ in 1/s².

    ε is the width of the range of velocities θ̇ in which the force changes its sign. A cycle of amplitude A (rad)
    dissipates the energy 2κA². This is a loss factor of 2κ/(πω²) at the frequency ω (rad/s). Unlike a complex
    stiffness, this force is causal and defined in the time domain. In a free decay the amplitude falls exponentially,
    as with viscous damping; only the motion within a cycle distinguishes the two.
    """

    parameter = "kappa"
    symbol = Symbol("κ", r"$\kappa$", "structural damping")
    unit = "1/s²"
    words = "structural (rate independent)"
    formula = "κ |θ − θe| tanh(θ̇/ε)"
    switches = True
    given = ("rest",)
    twin = "viscous"

    @staticmethod
    def kernel(x: float, v: float, epsilon: float, rest: float = 0.0) -> float:
        """Return the damping force per unit of its coefficient κ at displacement x and velocity v: |x − x_e| tanh(v/ε).

        x, v: in rad and rad/s, or in m and m/s. epsilon: width ε > 0, in the unit of v, of the range of velocities in
        which the force changes its sign. rest: the equilibrium x_e, in the unit of x.
        """
        return abs(x - rest) * math.tanh(v / epsilon)

    def ratio_per_unit(self, amplitude: float, frequency: float) -> float:
        """Return the equivalent viscous damping ratio per unit of the coefficient κ, 1/(πω²), with κ in 1/s².

        The frequency ω is in rad/s; the amplitude has no effect.
        """
        return 1.0 / (math.pi * frequency**2)


PLUGIN = Structural()
