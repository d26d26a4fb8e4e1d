"""Define the true equation of motion of a simulated record in pure Python, for SciPy's solver."""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from itertools import combinations

import numpy as np
from scipy.optimize import brentq

TERMS = ("viscous", "coulomb", "quadratic")
"""Names of the damping terms."""
COEFFICIENTS = {"viscous": "zeta", "coulomb": "mu_c", "quadratic": "mu_q"}
"""For each damping term, the name of its coefficient."""
SUMS = tuple("+".join(terms) for count in (1, 2, 3) for terms in combinations(TERMS, count))
"""Names of all sums of the three damping terms."""
LAWS = {
    "horizontal_pendulum": ("stiffness", "spring_angle", "gravity"),
    "linear": ("stiffness", "rest_angle"),
    "pendulum": ("stiffness", "rest_angle"),
    "duffing": ("stiffness", "rest_angle", "cubic"),
}
"""For each restoring law, the names of its parameters; both are in the order that `trajectory` expects."""

NODES = [(float(u) + 1, float(w)) for u, w in zip(*np.polynomial.legendre.leggauss(16), strict=True)]
"""Positions from 0 to 2, and weights, of the Gauss-Legendre quadrature that integrates a force over a displacement. It
is exact to rounding up to 2 rad."""

Function = Callable[[float], float]
"""A function of one number, such as a force of the displacement."""


@dataclass(frozen=True)
class Discrepancy:
    """The parts of the true equation of motion that none of the compared laws contains; by default there are none.

    Attributes
    ----------
    term : str
        Name of the extra damping force.
    damping : callable
        Extra damping force (rad/s²) as a function of displacement x from the equilibrium (rad), velocity (rad/s) and
        its sign.
    static_friction : callable
        Static friction of the extra force, as a function of the displacement x, rad/s².
    scale : callable
        Factor on all damping, as a function of the time in s since the release.
    spring : callable
        Extra restoring force, as a function of the displacement x, rad/s².
    """

    term: str = "other"
    damping: Callable[[float, float, float], float] = lambda x, v, turn: 0.0
    static_friction: Function = lambda x: 0.0
    scale: Function = lambda t: 1.0
    spring: Function = lambda x: 0.0


@dataclass(frozen=True)
class Oscillator:
    """An oscillator with the equation of motion θ̈ + F_damp + F_rest = 0 for the angle θ.

    Attributes
    ----------
    restoring : str
        The restoring law, one of `LAWS`.
    parameters : mapping
        The parameters of the restoring law, SI units.
    damping : mapping
        The coefficient of each damping term, by term, SI units.
    epsilon : float
        Width ε of the smoothed sign in Coulomb friction, tanh(v/ε) at the velocity v, in rad/s; 0 for an exact sign.
    discrepancy : Discrepancy
        The parts of the motion that none of the compared laws contains.
    """

    restoring: str
    parameters: Mapping[str, float]
    damping: Mapping[str, float]
    epsilon: float = 0.0
    discrepancy: Discrepancy = field(default_factory=Discrepancy)

    def force(self) -> Function:
        """Return the restoring force F_rest (rad/s²) as a function of the angle θ (rad), without the discrepancy."""
        k, rest, other = self._numbers()
        forces: dict[str, Function] = {
            "horizontal_pendulum": lambda theta: k * (theta - rest) - other * math.cos(theta),
            "linear": lambda theta: k * (theta - rest),
            "pendulum": lambda theta: k * math.sin(theta - rest),
            "duffing": lambda theta: k * (theta - rest) + other * (theta - rest) ** 3,
        }
        return forces[self.restoring]

    def equilibrium(self) -> float:
        """Return the angle (rad) at which the restoring force is zero; an extra spring has no force there either."""
        k, rest, other = self._numbers()
        if self.restoring != "horizontal_pendulum":
            return rest
        reach = abs(other / k) + 1e-9
        return float(brentq(self.force(), rest - reach, rest + reach, xtol=1e-14, rtol=1e-14))  # pyright: ignore[reportArgumentType]

    def potential(self) -> Function:
        """Return the potential energy of all springs as a function of the displacement from the equilibrium (rad).

        The energy is per unit of inertia, in rad²/s². It is computed from the force by Gauss-Legendre quadrature.
        """
        force, zero, extra = self.force(), self.equilibrium(), self.discrepancy.spring

        def potential(x: float) -> float:
            half = 0.5 * x
            return half * sum(w * (force(zero + half * u) + extra(half * u)) for u, w in NODES)

        return potential

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
        """Return the largest force (rad/s²) that dry friction balances at a displacement x (rad) from equilibrium."""
        return self.damping.get("coulomb", 0.0) + self.discrepancy.static_friction(x)

    def _numbers(self) -> list[float]:
        return [*(self.parameters[name] for name in LAWS[self.restoring]), 0.0][:3]
