"""Stribeck friction: dry friction that increases from its kinetic to its static value as the velocity goes to zero.

See B. Armstrong-Hélouvry, P. Dupont and C. Canudas de Wit, Automatica 30, 1083 (1994).
"""

import math
from collections.abc import Mapping

import scipy  # loads its modules when they are used

from bayesdamp.physics.damping import DampingTerm, FreeParameter
from bayesdamp.priors import HalfNormal, LogUniform
from bayesdamp.types import Symbol

SLOWEST, FASTEST = 0.02, 1.0
"""Smallest and largest Stribeck velocity in its prior, relative to the reference peak velocity. With a smaller one,
friction exceeds its kinetic value only very near the turning points; with a larger one, during the whole cycle."""


class Stribeck(DampingTerm):
    """Stribeck friction F = μ_k [1 + s exp(−(θ̇/v_s)²)] tanh(θ̇/ε) per unit of inertia.

    μ_k is the kinetic friction in rad/s², (1 + s) μ_k the static friction, and v_s the Stribeck velocity in rad/s. ε is
    the width of the range of velocities θ̇ in which the friction changes its sign. A cycle of amplitude A (rad) and
    frequency ω (rad/s) dissipates the energy 4 μ_k A [1 + s D(a)/a] with a = ωA/v_s and Dawson's integral D.
    """

    parameter = "mu_k"
    symbol = Symbol("μk", r"$\mu_k$", "kinetic friction")
    unit = "rad/s²"
    words = "Stribeck friction"
    formula = "μk [1 + s exp(−(θ̇/vs)²)] tanh(θ̇/ε)"
    switches = True
    inferred = (
        FreeParameter(
            "static_excess",
            "1",
            lambda amplitude, frequency: HalfNormal(scale=1.0),
            Symbol("static excess", "static excess", "ratio of static to kinetic friction, minus 1"),
        ),
        FreeParameter(
            "stribeck_velocity",
            "rad/s",
            lambda amplitude, frequency: LogUniform(
                low=SLOWEST * amplitude * frequency, high=FASTEST * amplitude * frequency
            ),
            Symbol("Stribeck velocity", "Stribeck velocity", "velocity of Stribeck friction"),
        ),
    )
    reduces = (("static_excess", 0.0),)

    @staticmethod
    def kernel(x: float, v: float, epsilon: float, excess: float = 0.0, slow: float = 1.0) -> float:
        """Return the friction per unit of its coefficient μ_k at velocity v: (1 + s exp(−(v/v_s)²)) tanh(v/ε).

        v: in rad/s or m/s. epsilon: width ε > 0, in the unit of v, of the range of velocities in which the friction
        changes its sign. excess: s, the excess of the static friction over the kinetic friction, relative to the
        kinetic friction. slow: the Stribeck velocity v_s, in the unit of v. The argument x (displacement) has no effect
        on this term.
        """
        return (1.0 + excess * math.exp(-(v * v) / (slow * slow))) * math.tanh(v / epsilon)

    def work(self, amplitude: float, frequency: float, further: Mapping[str, float]) -> float:
        """Return the energy lost in a cycle for μ_k = 1 rad/s², per unit of inertia (rad²/s²), in closed form.

        amplitude, frequency: in rad and rad/s. further: values of `static_excess` (s) and `stribeck_velocity` (v_s,
        rad/s), by name.
        """
        a = amplitude * frequency / further["stribeck_velocity"]
        return 4.0 * amplitude * (1.0 + further["static_excess"] * float(scipy.special.dawsn(a)) / a)


PLUGIN = Stribeck()
