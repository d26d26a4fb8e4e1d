"""Stribeck friction: dry friction that rises from its kinetic to its static value as the velocity goes to zero
(B. Armstrong-Hélouvry, P. Dupont and C. Canudas de Wit, Automatica 30, 1083 (1994))."""

import math
from collections.abc import Mapping

from scipy.special import dawsn

from bayesdamp.physics.damping._term import DampingTerm, FreeParameter
from bayesdamp.priors import HalfNormal, LogUniform
from bayesdamp.types import Symbol

SLOWEST, FASTEST = 0.02, 1.0
"""Stribeck velocities that are possible, as shares of the reference's peak velocity: below, friction is static nowhere
but at the turning points; above, everywhere."""


class Stribeck(DampingTerm):
    """F = μ_k [1 + s exp(−(θ̇/v_s)²)] tanh(θ̇/ε), kinetic friction μ_k in rad/s², static friction (1 + s) μ_k, Stribeck
    velocity v_s in rad/s. A cycle takes 4 μ_k A [1 + s D(a)/a], a = ωA/v_s, D Dawson's integral."""

    name = "stribeck"
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
            Symbol("static excess", "static excess", "static over kinetic friction, less one"),
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
        """(1 + s exp(−(v/v_s)²)) tanh(v/ε) (Stribeck 1902)."""
        return (1.0 + excess * math.exp(-(v * v) / (slow * slow))) * math.tanh(v / epsilon)

    def work(self, amplitude: float, frequency: float, further: Mapping[str, float]) -> float:
        """In closed form; see `DampingTerm.work`."""
        a = amplitude * frequency / further["stribeck_velocity"]
        return 4.0 * amplitude * (1.0 + further["static_excess"] * float(dawsn(a)) / a)


PLUGIN = Stribeck()
