"""Define an oscillator: a sum of damping terms and a restoring law. The scales of its priors."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import ArrayLike

from bayesdamp.physics.damping import TERMS, DampingTerm, parse_model
from bayesdamp.physics.forces import bracket, by_kernel, frequency_over, newton_many, rest_near
from bayesdamp.physics.restoring import LAWS, RestoringLaw
from bayesdamp.types import FeaturesSeen, InputError, Reference, System

Parameters = Mapping[str, float | np.ndarray]
REACH, POINTS = 10.0, 4001
"""Distance, rad, and number of angles of the search for an equilibrium."""
NEWTON = 4
"""Steps to the equilibrium from a place near it: from a tenth of a radian within 1e-15."""


@dataclass(frozen=True, init=False)
class Oscillator:
    """The oscillator θ̈ + F_damp(θ̇) + F_rest(θ) = 0; its parameters are a mapping of names to numbers.

    Parameters
    ----------
    damping
        Names of the damping terms, or their sum, `viscous+coulomb`.
    restoring
        Name of the restoring law.

    Raises
    ------
    InputError
        For a sum with unknown terms.
    """

    damping: tuple[str, ...]
    restoring: str

    def __init__(self, damping: str | Sequence[str], restoring: str) -> None:
        terms = parse_model(damping) if isinstance(damping, str) else tuple(damping)
        object.__setattr__(self, "damping", terms)
        object.__setattr__(self, "restoring", restoring)

    @property
    def terms(self) -> tuple[DampingTerm, ...]:
        """The damping terms themselves."""
        return tuple(TERMS.get(name) for name in self.damping)

    @property
    def law(self) -> RestoringLaw:
        """The restoring law itself."""
        return LAWS.get(self.restoring)

    @property
    def coefficients(self) -> tuple[str, ...]:
        """Names of the damping coefficients, in the order of the terms."""
        return tuple(term.parameter for term in self.terms)

    @property
    def further(self) -> tuple[str, ...]:
        """Names of the terms' parameters besides their coefficients."""
        return tuple(p.name for term in self.terms for p in term.inferred)

    @property
    def switches(self) -> bool:
        """Whether ε matters: a term jumps with the sign of the velocity."""
        return any(term.switches for term in self.terms)

    @property
    def parameters(self) -> tuple[str, ...]:
        """Every parameter that a trajectory needs."""
        epsilon = ("epsilon",) if self.switches else ()
        return (*self.coefficients, *self.further, *self.law.parameters, *epsilon, "theta0", "omega0")

    @property
    def scales(self) -> tuple[str, ...]:
        """Names in `GIVEN` that terms need besides parameters."""
        return tuple(dict.fromkeys(n for term in self.terms for n in term.given))

    @property
    def inputs(self) -> tuple[str, ...]:
        """Every number that a trajectory needs: parameters and scales."""
        return (*self.parameters, *self.scales)

    def damping_force(self, theta: ArrayLike, omega: ArrayLike, p: Parameters) -> np.ndarray:
        """Return F_damp(θ, θ̇) in rad/s²; θ and θ̇ of one shape, parameters broadcast against it."""
        total = np.zeros(np.shape(omega))
        for term, shape in zip(self.terms, self.shapes(theta, omega, p), strict=True):
            total = total + p[term.parameter] * shape
        return total

    def shapes(self, theta: ArrayLike, omega: ArrayLike, p: Parameters) -> list[np.ndarray]:
        """Return each term's force per unit of its coefficient; θ and θ̇ of one shape."""
        p = self.settled(p)
        epsilon = p.get("epsilon", 1.0)
        return [t.force(theta, omega, epsilon, *(p[n] for n in t.further)) for t in self.terms]

    def settled(self, p: Parameters) -> Parameters:
        """Return parameters with `rest`, where a term needs it, at the equilibrium near it (Newton's method)."""
        if "rest" not in self.scales:
            return p
        shape = np.broadcast_shapes(*(np.shape(p[n]) for n in (*self.law.parameters, "rest")))
        near = np.broadcast_to(p["rest"], shape)
        return {**p, "rest": newton_many(lambda at: self.law.force(at, p), near, NEWTON)}

    def equilibrium(self, p: Parameters, near: float = 0.0) -> float:
        """Return the stable equilibrium nearest to `near`, in rad. Raises ValueError for none within 10 rad."""
        return _equilibrium(
            self.restoring, tuple(float(p[name]) for name in self.law.parameters), float(near)
        )

    def natural_frequency(self, p: Parameters, near: float = 0.0) -> float:
        """Return ω_n = √F′_rest at the equilibrium, rad/s."""
        at = self.equilibrium(p, near)
        return float(np.sqrt(self.law.slope(at, p)))

    def rough_frequency(self, p: Parameters, near: float = 0.0, reach: float = REACH) -> float:
        """Return ω_n to some per mille, rad/s, for limits alone. Raises ValueError for no equilibrium within reach."""
        force = by_kernel(self.law.kernel, np.array([float(p[name]) for name in self.law.parameters]))
        ends = bracket(force, near, reach, POINTS)
        if ends is None:
            raise _no_rest(self.restoring, near)
        return frequency_over(force, *ends)


def _no_rest(restoring: str, near: float) -> ValueError:
    return ValueError(f"{restoring} has no stable equilibrium within {REACH:g} rad of {near:.3g}")


@lru_cache(maxsize=4096)
def _equilibrium(restoring: str, values: tuple[float, ...], near: float) -> float:
    p = dict(zip(LAWS.get(restoring).parameters, values))
    law = LAWS.get(restoring)
    rest = rest_near(lambda x: law.force(x, p), near, REACH, POINTS)
    if rest is None:
        raise _no_rest(restoring, near)
    return rest


def reference_of(system: System, features: FeaturesSeen) -> Reference:
    """Return the amplitude and frequency that prior widths scale with: given, else the system's, else the record's.

    Raises
    ------
    InputError
        Where no motion about the record's midline is possible with the known parameters of the restoring law.
    """
    amplitude, frequency = system.amplitude, system.frequency
    law, osc = LAWS.get(system.restoring), Oscillator(("viscous",), system.restoring)
    known = {n: system.known[n] for n in law.parameters if n in system.known}
    rest = features.rest
    try:
        if known:
            reach = REACH * max(1.0, features.amplitude)
            osc.rough_frequency(law.start(features.frequency, rest, known), rest, reach)
        if len(known) == len(law.parameters):
            if frequency is None:
                frequency = osc.natural_frequency(system.known, rest)
            if amplitude is None and "theta0" in system.known:
                amplitude = abs(system.known["theta0"] - osc.equilibrium(system.known, rest)) or None
    except (ValueError, ZeroDivisionError):
        each = ", ".join(f"{name} = {value:g}" for name, value in known.items())
        raise InputError(
            f"{each}: the law {law.name} then has no stable equilibrium near the record's midline "
            f"({rest:.3g}); give values with which it oscillates there, or leave them free"
        ) from None
    return Reference(
        amplitude or float(f"{features.amplitude:.1e}"), frequency or float(f"{features.frequency:.1e}")
    )
