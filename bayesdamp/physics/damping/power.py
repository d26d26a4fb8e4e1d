"""Damping by a power of the velocity with unknown exponent.

Coulomb, viscous and quadratic damping are the exponents 0, 1 and 2 (R. E. Mickens, K. O. Oyedeji and S. A. Rucker,
J. Sound Vib. 268, 839 (2003)).
"""

import math
from collections.abc import Mapping

from bayesdamp.physics.damping import DampingTerm, FreeParameter
from bayesdamp.priors import Uniform
from bayesdamp.types import Symbol


class Power(DampingTerm):
    """Power-law damping F = c V |θ̇/V|^p sgn θ̇ per unit of inertia, with a reference velocity V and c in 1/s.

    The exponent p is inferred. The force is smoothed within the width ε of the velocity, because it is steep at θ̇ = 0
    if p < 1. The prior of p extends a little beyond 0 and 3, so that neither value is at an end of the prior. A cycle
    of amplitude A (rad) and frequency ω (rad/s) dissipates the energy 2√π Γ(1 + p/2)/Γ(3/2 + p/2) c V A (ωA/V)^p.
    """

    parameter = "c_power"
    symbol = Symbol("c (power)", r"$c_p$", "damping by a power of the velocity")
    unit = "1/s"
    words = "power-law (|v|^p)"
    formula = "c V |θ̇/V|ᵖ sgn θ̇"
    switches = True
    rounded = True
    bounded = False  # an upper limit would depend on the unknown exponent
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
        """Return the damping force per unit of its coefficient c at velocity v: v ((v² + ε²)/V²)^((p − 1)/2).

        For |v| ≫ ε this is V |v/V|^p sgn v. v: in rad/s or m/s. epsilon: width ε, in the unit of v, of the range of
        velocities in which the force is smoothed. p: the exponent. scale: the reference velocity V, in the unit of v.
        The argument x (displacement) has no effect on this term.
        """
        return v * ((v * v + epsilon * epsilon) / (scale * scale)) ** (0.5 * (p - 1.0))

    def work(self, amplitude: float, frequency: float, further: Mapping[str, float]) -> float:
        """Return the energy lost in a cycle for c = 1/s, per unit of inertia (rad²/s²), in closed form.

        amplitude, frequency: in rad and rad/s. further: values of `exponent` and `reference_velocity` (rad/s, by
        default amplitude times frequency), by name.
        """
        p, peak = further["exponent"], amplitude * frequency
        scale = further.get("reference_velocity", peak)
        shape = 2.0 * math.sqrt(math.pi) * math.gamma(1.0 + 0.5 * p) / math.gamma(1.5 + 0.5 * p)
        return shape * scale * amplitude * (peak / scale) ** p


PLUGIN = Power()
