"""Define an oscillator (a sum of damping terms and a restoring law), and the reference scales of its priors."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import ArrayLike

from bayesdamp.physics.damping import TERMS, DampingTerm, parse_model
from bayesdamp.physics.forces import bracket, by_kernel, frequency_over, newton_many, rest_near
from bayesdamp.physics.restoring import LAWS, RestoringLaw
from bayesdamp.types import FeatureValues, InputError, Reference, System

Parameters = Mapping[str, float | np.ndarray]
"""Values of an oscillator's parameters by name, as scalars or arrays."""
SEARCH_REACH, SEARCH_POINTS = 10.0, 4001
"""Half-width (rad or m) and number of points of the grid on which an equilibrium is searched (conventional)."""
NEWTON_STEPS = 4
"""Number of Newton steps to the exact equilibrium from a position near it; from 0.1 rad away the result is right to
1e-15."""


@dataclass(frozen=True, init=False)
class Oscillator:
    """The oscillator θ̈ + F_damp(θ, θ̇) + F_rest(θ) = 0, with forces per unit of inertia.

    Its methods take the values of its parameters as a mapping of names to numbers.

    Parameters
    ----------
    damping
        Names of the damping terms, or one string with their sum, such as `viscous+coulomb`.
    restoring
        Name of the restoring law.

    Raises
    ------
    InputError
        If `damping` is a string that `parse_model` refuses, for example with an unknown or repeated term.
    """

    damping: tuple[str, ...]
    restoring: str

    def __init__(self, damping: str | Sequence[str], restoring: str) -> None:
        terms = parse_model(damping) if isinstance(damping, str) else tuple(damping)
        object.__setattr__(self, "damping", terms)
        object.__setattr__(self, "restoring", restoring)

    @property
    def terms(self) -> tuple[DampingTerm, ...]:
        """Return the damping terms as objects, in the order of their names in `damping`."""
        return tuple(TERMS.get(name) for name in self.damping)

    @property
    def law(self) -> RestoringLaw:
        """Return the restoring law as an object."""
        return LAWS.get(self.restoring)

    @property
    def coefficients(self) -> tuple[str, ...]:
        """Return the names of the damping coefficients, in the order of the terms."""
        return tuple(term.parameter for term in self.terms)

    @property
    def further(self) -> tuple[str, ...]:
        """Return the names of the damping terms' inferred parameters other than their coefficients.

        Unlike `DampingTerm.further`, they do not include the equilibrium and the reference scales, which are not
        inferred.
        """
        return tuple(p.name for term in self.terms for p in term.inferred)

    @property
    def switches(self) -> bool:
        """Return whether any term's force depends on ε (`DampingTerm.switches`), so that ε is a parameter."""
        return any(term.switches for term in self.terms)

    @property
    def parameters(self) -> tuple[str, ...]:
        """Return the names of all parameters of the motion.

        They are the coefficients, the terms' other parameters, the parameters of the restoring law, epsilon if a term
        needs it, and the angle and velocity at the start (theta0, omega0).
        """
        epsilon = ("epsilon",) if self.switches else ()
        return (*self.coefficients, *self.further, *self.law.parameters, *epsilon, "theta0", "omega0")

    @property
    def scales(self) -> tuple[str, ...]:
        """Return the names of those numbers in `damping.GIVEN` (equilibrium, reference scales) that the terms need."""
        return tuple(dict.fromkeys(n for term in self.terms for n in term.given))

    @property
    def inputs(self) -> tuple[str, ...]:
        """Return the names of all numbers that determine a motion: `parameters`, then `scales`."""
        return (*self.parameters, *self.scales)

    def damping_force(self, theta: ArrayLike, omega: ArrayLike, p: Parameters) -> np.ndarray:
        """Return F_damp(θ, θ̇) in rad/s², for arrays θ and θ̇ of one shape; the parameters p broadcast against it.

        theta, omega: in rad and rad/s (or m for rad). p: the damping coefficients, and what `shapes` needs.
        """
        total = np.zeros(np.shape(omega))
        for term, shape in zip(self.terms, self.shapes(theta, omega, p), strict=True):
            total = total + p[term.parameter] * shape
        return total

    def shapes(self, theta: ArrayLike, omega: ArrayLike, p: Parameters) -> list[np.ndarray]:
        """Return the force of each term per unit of its coefficient, as one array for each term.

        θ and θ̇ are arrays of one shape, against which the parameters p broadcast. p must have the values that the
        terms need: further parameters, the numbers in `scales`, and, if `rest` is one of these, the parameters of the
        restoring law, from which the exact equilibrium is computed. If epsilon is missing in p, it is 0.
        """
        p = self.with_equilibrium(p)
        epsilon = p.get("epsilon", 0.0)
        return [t.force(theta, omega, epsilon, *(p[n] for n in t.further)) for t in self.terms]

    def with_equilibrium(self, p: Parameters) -> Parameters:
        """Return the parameters with `rest` replaced by the exact equilibrium near its value (`newton_many`).

        They are unchanged if no damping term needs the equilibrium. p: parameters by name, among them `rest` and those
        of the restoring law, as numbers or arrays that broadcast.
        """
        if "rest" not in self.scales:
            return p
        shape = np.broadcast_shapes(*(np.shape(p[n]) for n in (*self.law.parameters, "rest")))
        near = np.broadcast_to(p["rest"], shape)
        return {**p, "rest": newton_many(lambda at: self.law.force(at, p), near, NEWTON_STEPS)}

    def equilibrium(self, p: Parameters, near: float = 0.0) -> float:
        """Return the stable equilibrium nearest to `near`; both are in rad, or in m if the displacement is a length.

        p: only the parameters of the restoring law are used. Raises ValueError if there is no stable equilibrium within
        the distance `SEARCH_REACH` of `near`.
        """
        return _equilibrium(
            self.restoring, tuple(float(p[name]) for name in self.law.parameters), float(near)
        )

    def natural_frequency(self, p: Parameters, near: float = 0.0) -> float:
        """Return ω_n = √F′_rest in rad/s at the stable equilibrium nearest to `near` (rad or m).

        p: only the parameters of the restoring law are used. Raises ValueError if there is no stable equilibrium within
        `SEARCH_REACH`.
        """
        at = self.equilibrium(p, near)
        return float(np.sqrt(self.law.slope(at, p)))

    def rough_frequency(self, p: Parameters, near: float = 0.0, reach: float = SEARCH_REACH) -> float:
        """Return ω_n in rad/s with an error of about 0.1 %, with less work than `natural_frequency`.

        It is that of the stable equilibrium nearest to `near`. The slope of the force is its difference quotient over
        the grid step that contains the equilibrium. p: only the parameters of the restoring law are used. Raises
        ValueError if no stable equilibrium is within `reach` of `near` (rad or m).
        """
        force = by_kernel(self.law.kernel, np.array([float(p[name]) for name in self.law.parameters]))
        ends = bracket(force, near, reach, SEARCH_POINTS)
        if ends is None:
            raise _no_rest(self.restoring, near, reach)
        return frequency_over(force, *ends)


def _no_rest(restoring: str, near: float, reach: float) -> ValueError:
    return ValueError(f"the law {restoring} has no stable equilibrium within {reach:g} of {near:.3g}")


@lru_cache(maxsize=4096)
def _equilibrium(restoring: str, values: tuple[float, ...], near: float) -> float:
    p = dict(zip(LAWS.get(restoring).parameters, values))
    law = LAWS.get(restoring)
    rest = rest_near(lambda x: law.force(x, p), near, SEARCH_REACH, SEARCH_POINTS)
    if rest is None:
        raise _no_rest(restoring, near, SEARCH_REACH)
    return rest


def check_restoring(restoring: str, known: Mapping[str, float]) -> None:
    """Raise InputError if a known value is not above 0 and the restoring law requires this (`RestoringLaw.positive`).

    restoring: name of the law. known: known values by name.
    """
    for name in LAWS.get(restoring).positive:
        if name in known and not known[name] > 0:
            raise InputError(f"{name} = {known[name]:g}: it must be above 0 under the law {restoring}")


def reference_of(system: System, features: FeatureValues) -> Reference:
    """Return the reference amplitude (rad or m) and angular frequency (rad/s), with which the widths of priors scale.

    Each is the value that `system` states. Else, if all parameters of the restoring law are known, the frequency is ω_n
    at the equilibrium θ_e; and if theta0 is known too, the amplitude is |θ₀ − θ_e|, unless this is 0. Else it is that
    of the record (the amplitude at its first sample, the mean frequency), rounded to two digits. features: features of
    the record.

    Raises
    ------
    InputError
        If no oscillation about the record's midline is possible with the known parameters of the restoring law.
    """
    amplitude, frequency = system.amplitude, system.frequency
    check_restoring(system.restoring, system.known)
    law, osc = LAWS.get(system.restoring), Oscillator(("viscous",), system.restoring)
    known = {n: system.known[n] for n in law.parameters if n in system.known}
    rest = features.rest
    try:
        if known:
            reach = SEARCH_REACH * max(1.0, features.amplitude)
            osc.rough_frequency(law.start(features.frequency, rest, known), rest, reach)
        if len(known) == len(law.parameters):
            if frequency is None:
                frequency = osc.natural_frequency(system.known, rest)
            if amplitude is None and "theta0" in system.known:
                amplitude = abs(system.known["theta0"] - osc.equilibrium(system.known, rest)) or None
    except (ValueError, ZeroDivisionError):
        each = ", ".join(f"{name} = {value:g}" for name, value in known.items())
        raise InputError(
            f"{each}: with these values the law {law.name} has no stable equilibrium near the record's midline "
            f"({rest:.3g}); correct the values or leave them out, so that they are inferred"
        ) from None
    return Reference(
        amplitude or float(f"{features.amplitude:.1e}"), frequency or float(f"{features.frequency:.1e}")
    )
