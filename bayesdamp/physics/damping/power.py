"""A power of the velocity with a free exponent.

Coulomb, viscous and quadratic damping have the exponents 0, 1 and 2 (R. E. Mickens, K. O. Oyedeji and S. A. Rucker,
J. Sound Vib. 268, 839 (2003)).
"""

import math
from collections.abc import Mapping

from bayesdamp.physics.damping import DampingTerm, FreeParameter
from bayesdamp.priors import Uniform
from bayesdamp.types import Symbol


class Power(DampingTerm):
    """F = c V |θ̇/V|^p sgn θ̇ with V a reference velocity, c in 1/s; rounded within ε so that it may switch at p = 0.

    The exponent may be a little outside 0 to 3, so that neither value is at an end of its score. A cycle takes
    2√π Γ(1 + p/2)/Γ(3/2 + p/2) c V A (ωA/V)^p.
    """

    name = "power"
    parameter = "c_power"
    symbol = Symbol("c (power)", r"$c_p$", "damping by a power of the velocity")
    unit = "1/s"
    words = "power-law (|v|^p)"
    formula = "c V |θ̇/V|ᵖ sgn θ̇"
    switches = True
    rounded = True
    bounded = False  # its exponent tells more
    inferred = (
        FreeParameter(
            "exponent",
            "1",
            lambda amplitude, frequency: Uniform(low=-0.3, high=3.3),
            Symbol("exponent p", r"exponent $p$", "exponent of the velocity"),
        ),
    )
    given = ("reference_velocity",)

    @staticmethod
    def kernel(x: float, v: float, epsilon: float, p: float = 1.0, scale: float = 1.0) -> float:
        """v ((v² + ε²)/v_ref²)^((p − 1)/2): a power p of the velocity, smooth at rest."""
        return v * ((v * v + epsilon * epsilon) / (scale * scale)) ** (0.5 * (p - 1.0))

    def work(self, amplitude: float, frequency: float, further: Mapping[str, float]) -> float:
        """Return `DampingTerm.work` in closed form."""
        p, peak = further["exponent"], amplitude * frequency
        scale = further.get("reference_velocity", peak)
        shape = 2.0 * math.sqrt(math.pi) * math.gamma(1.0 + 0.5 * p) / math.gamma(1.5 + 0.5 * p)
        return shape * scale * amplitude * (peak / scale) ** p


PLUGIN = Power()
