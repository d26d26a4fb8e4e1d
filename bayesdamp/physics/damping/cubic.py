"""Cubic damping: a force μ₃ θ̇³ that grows with the cube of the velocity θ̇, as in the rolling of ships.

See J. F. Dalzell, J. Ship Res. 22, 178 (1978).
"""

from bayesdamp.physics.damping import DampingTerm
from bayesdamp.types import Symbol


class Cubic(DampingTerm):
    """Cubic damping F = μ₃ θ̇³ per unit of inertia, with μ₃ in s/rad².

    A cycle of amplitude A (rad) and frequency ω (rad/s) dissipates the energy 3π/4 μ₃ ω³ A⁴.
    """

    parameter = "mu_3"
    symbol = Symbol("μ₃", r"$\mu_3$", "cubic damping")
    unit = "s/rad²"
    words = "cubic (v³)"
    formula = "μ₃ θ̇³"

    @staticmethod
    def kernel(x: float, v: float, epsilon: float) -> float:
        """Return the damping force per unit of its coefficient μ₃ at velocity v (rad/s or m/s), which is v³.

        The arguments x (displacement) and epsilon have no effect on this term.
        """
        return v * v * v

    def ratio_per_unit(self, amplitude: float, frequency: float) -> float:
        """Return the equivalent viscous damping ratio 3A²ω/8 of cubic damping for μ₃ = 1 s/rad².

        The amplitude A is in rad, the frequency ω in rad/s.
        """
        return 3.0 / 8.0 * amplitude**2 * frequency


PLUGIN = Cubic()
