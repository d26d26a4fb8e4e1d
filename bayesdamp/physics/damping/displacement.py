"""Viscous damping that grows with the square of the displacement: (θ − θ_e)² θ̇ at angle θ, with equilibrium θ_e.

It is the nonlinear term of the van der Pol oscillator (B. van der Pol, Phil. Mag. 2, 978 (1926)).
"""

from bayesdamp.physics.damping import DampingTerm
from bayesdamp.types import Symbol


class Displacement(DampingTerm):
    """Damping F = c (θ − θ_e)² θ̇ per unit of inertia, with the equilibrium θ_e and c in 1/(s rad²).

    A cycle of amplitude A (rad) and frequency ω (rad/s) dissipates the energy π c ω A⁴/4, which is proportional to A⁴
    as for cubic damping.
    """

    parameter = "c_xxv"
    symbol = Symbol("c (x²v)", r"$c_{xxv}$", "damping that grows with the square of the displacement")
    unit = "1/(s rad²)"
    words = "displacement-dependent (x²v)"
    formula = "c (θ − θe)² θ̇"
    given = ("rest",)
    twin = "cubic"

    @staticmethod
    def kernel(x: float, v: float, epsilon: float, rest: float = 0.0) -> float:
        """Return the damping force per unit of its coefficient c at displacement x and velocity v: (x − x_e)² v.

        x, v: in rad and rad/s, or in m and m/s. rest: the equilibrium x_e, in the unit of x. The argument epsilon has
        no effect on this term.
        """
        return (x - rest) * (x - rest) * v

    def ratio_per_unit(self, amplitude: float, frequency: float) -> float:
        """Return the equivalent viscous damping ratio A²/(8ω) of this damping for c = 1/(s rad²).

        The amplitude A is in rad, the frequency ω in rad/s.
        """
        return amplitude**2 / (8.0 * frequency)


PLUGIN = Displacement()
