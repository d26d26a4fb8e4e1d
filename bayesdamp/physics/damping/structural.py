"""Structural (hysteretic) damping: a force proportional to the displacement that opposes the velocity.

The loss in a cycle does not depend on its frequency (T. J. Reid, J. R. Aeronaut. Soc. 60, 283 (1956)).
"""

import math

from bayesdamp.physics.damping import DampingTerm
from bayesdamp.types import Symbol


class Structural(DampingTerm):
    """F = κ |θ − θ_e| tanh(θ̇/ε), κ in 1/s²: a cycle takes 2κA², a loss factor of 2κ/(πω²).

    Unlike the complex stiffness of the frequency domain it is causal and has solutions. In a free decay the amplitude
    falls exponentially, as with viscous damping; only the shape within a cycle distinguishes the two.
    """

    name = "structural"
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
        """|x − x₀| tanh(v/ε)."""
        return abs(x - rest) * math.tanh(v / epsilon)

    def ratio_per_unit(self, amplitude: float, frequency: float) -> float:
        """Return 1/(πω²): the same at every amplitude."""
        return 1.0 / (math.pi * frequency**2)


PLUGIN = Structural()
