"""Define the true oscillator of a simulated record in pure Python, for SciPy's solver."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

from scipy.optimize import brentq

TERMS = ("viscous", "coulomb", "quadratic")
"""Names of the damping terms."""
COEFFICIENTS = {"viscous": "zeta", "coulomb": "mu_c", "quadratic": "mu_q"}
"""Name of the coefficient of each damping term."""
SUMS = (
    "viscous", "coulomb", "quadratic", "viscous+coulomb", "viscous+quadratic", "coulomb+quadratic",
    "viscous+coulomb+quadratic",
)  # fmt: skip
"""Names of all sums of the three damping terms."""
LAWS = {
    "horizontal_pendulum": ("stiffness", "spring_angle", "gravity"),
    "linear": ("stiffness", "rest_angle"),
    "pendulum": ("stiffness", "rest_angle"),
    "duffing": ("stiffness", "rest_angle", "cubic"),
}
"""Restoring laws and their parameters, in the order that `trajectory` expects."""

Function = Callable[[float], float]
"""A function of one number, such as a force of the displacement."""


@dataclass(frozen=True)
class Discrepancy:
    """The parts of a motion that none of the compared laws contains; by default there are none.

    Attributes
    ----------
    term : str
        Name of the extra damping force.
    damping : callable
        Extra damping force (rad/s²) of displacement x from the equilibrium (rad), velocity (rad/s) and its sign.
    static_friction : callable
        Part of the static friction at x that is due to the extra force, rad/s².
    scale : callable
        Factor on all damping at a time in s since the release.
    spring, potential : callable
        Extra restoring force at x, rad/s², and its potential, rad²/s².
    """

    term: str = "other"
    damping: Callable[[float, float, float], float] = lambda x, v, turn: 0.0
    static_friction: Function = lambda x: 0.0
    scale: Function = lambda t: 1.0
    spring: Function = lambda x: 0.0
    potential: Function = lambda x: 0.0


@dataclass(frozen=True)
class Oscillator:
    """The oscillator θ̈ + F_damp + F_rest = 0.

    Attributes
    ----------
    restoring : str
        The restoring law, one of `LAWS`.
    parameters : mapping
        The parameters of the restoring law, SI units.
    damping : mapping
        The coefficient of each term of the sum, SI units.
    epsilon : float
        Width of the smoothed sign in Coulomb friction, rad/s; 0 for an exact sign.
    discrepancy : Discrepancy
        The parts that none of the compared laws contains.
    """

    restoring: str
    parameters: Mapping[str, float]
    damping: Mapping[str, float]
    epsilon: float = 0.0
    discrepancy: Discrepancy = field(default_factory=Discrepancy)

    def force(self) -> Function:
        """Return the function F_rest(θ) of the restoring law, without the discrepancy, from rad to rad/s²."""
        k, rest, other = self._numbers()
        forces: dict[str, Function] = {
            "horizontal_pendulum": lambda theta: k * (theta - rest) - other * math.cos(theta),
            "linear": lambda theta: k * (theta - rest),
            "pendulum": lambda theta: k * math.sin(theta - rest),
            "duffing": lambda theta: k * (theta - rest) + other * (theta - rest) ** 3,
        }
        return forces[self.restoring]

    def equilibrium(self) -> float:
        """Return the angle (rad) at which the restoring force is zero; that of an extra spring is zero there too."""
        k, rest, other = self._numbers()
        if self.restoring != "horizontal_pendulum":
            return rest
        reach = abs(other / k) + 1e-9
        return float(brentq(self.force(), rest - reach, rest + reach, xtol=1e-14, rtol=1e-14))  # pyright: ignore[reportArgumentType]

    def potential(self) -> Function:
        """Return the potential energy of all springs as a function of the displacement from the equilibrium (rad).

        It is per unit of inertia, rad²/s². The expressions avoid differences of large numbers, so that they are
        accurate at small amplitudes.
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
        return lambda x: law(x) + extra(x)

    def acceleration(self) -> Callable[[float, float, float, float], float]:
        """Return θ̈ (rad/s²) as a function of time (s since the release), angle (rad), velocity (rad/s) and its sign."""
        zeta, friction, drag = (self.damping.get(term, 0.0) for term in TERMS)
        force, zero, eps, odd = self.force(), self.equilibrium(), self.epsilon, self.discrepancy

        def acceleration(t: float, theta: float, v: float, sign: float) -> float:
            turn, x = math.tanh(v / eps) if eps else sign, theta - zero
            loss = 2 * zeta * v + friction * turn + drag * v * abs(v) + odd.damping(x, v, turn)
            return -force(theta) - loss * odd.scale(t) - odd.spring(x)

        return acceleration

    def static_friction(self, x: float) -> float:
        """Return the largest force (rad/s²) that dry friction can balance, at a displacement x (rad) from rest."""
        return self.damping.get("coulomb", 0.0) + self.discrepancy.static_friction(x)

    def _numbers(self) -> tuple[float, float, float]:
        given = [self.parameters[name] for name in LAWS[self.restoring]]
        return given[0], given[1], given[2] if len(given) == 3 else 0.0


def _x_minus_sine(x: float) -> float:
    """Return x − sin x, accurate also at small x."""
    if abs(x) > 0.3:
        return x - math.sin(x)
    square = x * x
    return x * square / 6 * (1 - square / 20 * (1 - square / 42 * (1 - square / 72 * (1 - square / 110))))
