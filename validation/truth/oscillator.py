"""The oscillator that a simulated record truly comes from, in plain Python for SciPy's solver."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

from scipy.optimize import brentq

TERMS = ("viscous", "coulomb", "quadratic")
COEFFICIENTS = {"viscous": "zeta", "coulomb": "mu_c", "quadratic": "mu_q"}
SUMS = (
    "viscous", "coulomb", "quadratic", "viscous+coulomb", "viscous+quadratic", "coulomb+quadratic",
    "viscous+coulomb+quadratic",
)  # fmt: skip
LAWS = {
    "horizontal_pendulum": ("stiffness", "spring_angle", "gravity"),
    "linear": ("stiffness", "rest_angle"),
    "pendulum": ("stiffness", "rest_angle"),
    "duffing": ("stiffness", "rest_angle", "cubic"),
}
"""Restoring laws and their parameters, in the order that the rivals' fits take."""

Function = Callable[[float], float]


@dataclass(frozen=True)
class Discrepancy:
    """What a record has that no candidate law has; each part is None where it has none.

    damping: (displacement x from the equilibrium in rad, velocity v in rad/s, sign of the velocity) to an extra
    damping force, rad/s², and term, the name of its share. held: x to what it adds to the friction that holds at rest.
    scale: time in s since the release to a factor on all damping.
    spring, potential: x to an extra restoring force, rad/s², and its potential, rad²/s².
    """

    term: str = ""
    damping: Callable[[float, float, float], float] | None = None
    held: Function | None = None
    scale: Function | None = None
    spring: Function | None = None
    potential: Function | None = None


@dataclass(frozen=True)
class Oscillator:
    """θ̈ + F_damp + F_rest = 0.

    restoring: one of LAWS. parameters: its parameters, SI units. damping: term to its coefficient, only terms of the
    sum. epsilon: velocity within which Coulomb friction turns over, rad/s; 0 for an exact sign.
    """

    restoring: str
    parameters: Mapping[str, float]
    damping: Mapping[str, float]
    epsilon: float = 0.0
    discrepancy: Discrepancy = field(default_factory=Discrepancy)

    def force(self) -> Function:
        """F_rest(θ) of the law alone, rad/s²."""
        k, rest, other = self._numbers()
        forces: dict[str, Function] = {
            "horizontal_pendulum": lambda theta: k * (theta - rest) - other * math.cos(theta),
            "linear": lambda theta: k * (theta - rest),
            "pendulum": lambda theta: k * math.sin(theta - rest),
            "duffing": lambda theta: k * (theta - rest) + other * (theta - rest) ** 3,
        }
        return forces[self.restoring]

    def equilibrium(self) -> float:
        """The angle at which the law has no force, rad. An extra spring has none there either."""
        k, rest, other = self._numbers()
        if self.restoring != "horizontal_pendulum":
            return rest
        reach = abs(other / k) + 1e-9
        return float(brentq(self.force(), rest - reach, rest + reach, xtol=1e-14, rtol=1e-14))  # pyright: ignore[reportArgumentType]

    def potential(self) -> Function:
        """Potential energy per inertia of a displacement from the equilibrium, rad²/s², all springs together.

        In forms without a difference of large numbers, so that small amplitudes keep their digits.
        """
        k, _, other = self._numbers()
        zero, extra = self.equilibrium(), self.discrepancy.potential
        sine, cosine = math.sin(zero), math.cos(zero)

        def pendulum(x: float) -> float:
            return 2 * k * math.sin(0.5 * x) ** 2

        def horizontal(x: float) -> float:
            # −γ [sin(θ) − sin(θ_eq) − x cos θ_eq] with k(θ_eq − θ_s) = γ cos θ_eq
            return 0.5 * k * x * x + other * (2 * sine * math.sin(0.5 * x) ** 2 + cosine * _x_minus_sine(x))

        potentials: dict[str, Function] = {
            "horizontal_pendulum": horizontal,
            "linear": lambda x: 0.5 * k * x * x,
            "pendulum": pendulum,
            "duffing": lambda x: 0.5 * k * x * x + 0.25 * other * x**4,
        }
        law = potentials[self.restoring]
        return law if extra is None else lambda x: law(x) + extra(x)

    def acceleration(self) -> Callable[[float, float, float, float], float]:
        """θ̈ in rad/s² of (time in s since the release, angle in rad, velocity in rad/s, sign of the velocity)."""
        zeta, friction, drag = (self.damping.get(term, 0.0) for term in TERMS)
        force, zero, eps, odd = self.force(), self.equilibrium(), self.epsilon, self.discrepancy
        more, scale, spring = odd.damping, odd.scale, odd.spring
        tanh = math.tanh

        def plain(t: float, theta: float, v: float, sign: float) -> float:
            turn = tanh(v / eps) if eps else sign
            return -force(theta) - 2 * zeta * v - friction * turn - drag * v * abs(v)

        def general(t: float, theta: float, v: float, sign: float) -> float:
            turn = tanh(v / eps) if eps else sign
            x = theta - zero
            loss = 2 * zeta * v + friction * turn + drag * v * abs(v)
            if more is not None:
                loss += more(x, v, turn)
            if scale is not None:
                loss *= scale(t)
            return -force(theta) - loss - (spring(x) if spring is not None else 0.0)

        return plain if more is None and scale is None and spring is None else general

    def held(self, x: float) -> float:
        """Force that dry friction can hold at a displacement, rad/s²."""
        more = self.discrepancy.held
        return self.damping.get("coulomb", 0.0) + (more(x) if more is not None else 0.0)

    def _numbers(self) -> tuple[float, float, float]:
        given = [self.parameters[name] for name in LAWS[self.restoring]]
        return given[0], given[1], given[2] if len(given) == 3 else 0.0


def _x_minus_sine(x: float) -> float:
    """x − sin x, with all digits at small x."""
    if abs(x) > 0.3:
        return x - math.sin(x)
    square = x * x
    return x * square / 6 * (1 - square / 20 * (1 - square / 42 * (1 - square / 72 * (1 - square / 110))))
