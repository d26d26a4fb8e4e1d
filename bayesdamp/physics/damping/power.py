"""A power of the velocity with a free exponent: Coulomb's, viscous and quadratic damping are its 0, 1 and 2
(R. E. Mickens, K. O. Oyedeji and S. A. Rucker, J. Sound Vib. 268, 839 (2003))."""

from bayesdamp.physics.damping._term import DampingTerm, FreeParameter
from bayesdamp.priors import Uniform
from bayesdamp.types import Symbol


class Power(DampingTerm):
    """F = c V |θ̇/V|^p sgn θ̇ with V a reference velocity, c in 1/s; rounded within ε so that it may switch at p = 0.

    The exponent may be a little outside 0 to 3, so that neither end is where its score ends.
    """

    name = "power"
    parameter = "c_power"
    symbol = Symbol("c (power)", r"$c_p$", "damping by a power of the velocity")
    unit = "1/s"
    words = "power-law (|v|^p)"
    formula = "c V |θ̇/V|ᵖ sgn θ̇"
    switches = True
    bounded = False  # its exponent says more
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


PLUGIN = Power()
