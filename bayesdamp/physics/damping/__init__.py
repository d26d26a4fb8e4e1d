"""Define the base class of damping terms and their registry. Each term is one class in a module of its own."""

from __future__ import annotations

import dis
import math
from abc import ABC
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from itertools import combinations

import numpy as np
from numpy.typing import ArrayLike

from bayesdamp.physics.forces import on_arrays
from bayesdamp.plugins import Registry
from bayesdamp.priors import Prior
from bayesdamp.types import InputError, Symbol

NODES_PER_QUARTER = 48
"""Number of Gauss–Legendre nodes in a quarter of a cycle, for the energy lost in a cycle (conventional)."""
SHARP_WIDTH = 1e-9
"""Switching width ε, relative to the peak velocity, with which the work of an abrupt switch is computed."""
EXACT, TINY = 1e-8, 1e-100
"""Ratio ε/|v| at which tanh(v/ε) equals the sign of v to rounding, and the velocity (rad/s) that replaces v = 0."""
REFLECTED_MEDIAN = 0.6745
"""Median of |z| for a standard normal z."""
GIVEN = ("rest", "reference_velocity", "reference_amplitude")
"""Numbers that a kernel may need besides parameters: the equilibrium, and reference scales of velocity and
displacement."""


# Quadrature nodes and weights for the phase of sin ωt from −π/2 to π/2, with the rule on each side of 0.
_X, _W = np.polynomial.legendre.leggauss(NODES_PER_QUARTER)
_QUARTER = 0.25 * math.pi * (_X + 1)
_PHASES = np.concatenate([_QUARTER - 0.5 * math.pi, _QUARTER])
_WEIGHTS = np.concatenate([_W, _W]) * 0.25 * math.pi
TERMS: Registry[DampingTerm] = Registry("bayesdamp.physics.damping", "damping term")
"""All damping terms, by name."""
PAPER_TERMS = ("viscous", "coulomb", "quadratic")
"""Names of the three terms of the paper."""


@dataclass(frozen=True)
class FreeParameter:
    """A parameter of a damping term other than its coefficient.

    name, unit: its name, and its unit for an angle in rad. prior: function that returns the prior for a reference
    amplitude (rad or m) and frequency (rad/s); the prior's support must contain all possible values. symbol: symbol in
    reports; by default the name.
    """

    name: str
    unit: str
    prior: Callable[[float, float], Prior]
    symbol: Symbol | None = None


class DampingTerm(ABC):
    """A damping force: coefficient · kernel(θ, θ̇, ε, further parameters)."""

    name: str
    parameter: str
    unit: str
    """Unit of the coefficient for an angle in rad; for a record in metres, `m` replaces `rad`."""
    symbol: Symbol | None = None
    """Symbol of the coefficient in reports; by default its name."""
    words: str = ""
    """Name of the term in sentences; by default `name`."""
    formula: str = ""
    """The force, coefficient included, as a report shows it."""
    switches: bool = False
    """Whether the force jumps with the sign of the velocity (dry friction), within the width ε."""
    rounded: bool = False
    """Whether ε does not smooth a jump, but the steep slope of a continuous force at v = 0. Such a term is smoothed
    within a small fraction of the peak velocity also if ε = 0."""
    inferred: tuple[FreeParameter, ...] = ()
    """Parameters other than the coefficient, in the order of the kernel's arguments after ε."""
    given: tuple[str, ...] = ()
    """Names of `GIVEN` that the kernel takes as arguments after the parameters in `inferred`."""
    bounded: bool = True
    """Whether a verdict without this term gives an upper limit for its fraction of the dissipated energy."""
    twin: str = ""
    """Name of a term whose energy loss per cycle depends on the amplitude in the same way; only the motion within a
    cycle distinguishes the two."""
    reduces: tuple[tuple[str, float], ...] = ()
    """Parameter values at which the term reduces to a simpler one; the upper limit is for the part of the force beyond
    that."""

    @property
    def placed(self) -> bool:
        """Return whether the force depends on the position."""
        if "rest" in self.given:
            return True
        first = self.kernel.__code__.co_varnames[0]
        # Since Python 3.13 one instruction can load two variables.
        loaded = (
            i.argval if isinstance(i.argval, tuple) else (i.argval,)
            for i in dis.get_instructions(self.kernel)
        )
        return any(first in names for names in loaded)

    @property
    def further(self) -> tuple[str, ...]:
        """Return the names of the kernel's arguments after θ, θ̇ and ε."""
        return (*(p.name for p in self.inferred), *self.given)

    @staticmethod
    def kernel(x: float, v: float, epsilon: float) -> float:
        """Return the force per unit of the coefficient at one displacement x (rad) and velocity v (rad/s).

        ε > 0 is in rad/s; after it come the arguments in `further`. It may use only plain Python, `math` and `np`,
        because its source is compiled.
        """
        raise NotImplementedError

    def force(self, x: ArrayLike, v: ArrayLike, epsilon: ArrayLike, *further: ArrayLike) -> np.ndarray:
        """Return the force per unit of the coefficient, at displacements x (rad) and velocities v (rad/s) of one shape.

        further: values of the arguments in `further`. With ε = 0, dry friction jumps with the sign of v and is 0 at v =
        0.
        """
        v = np.asarray(v, float)
        sharp = np.where(v == 0.0, 1.0, EXACT * np.abs(v))
        width = np.where(np.asarray(epsilon) == 0.0, sharp, epsilon)
        values = (np.asarray(value, float) for value in further)
        return on_arrays(self.kernel)(np.asarray(x, float), v, width, *values)

    def ratio_per_unit(self, amplitude: float, frequency: float) -> float:
        """Return the equivalent viscous damping ratio per unit of the coefficient, W / (2π ω² A²).

        W is the energy lost in a cycle of a harmonic motion with amplitude A (rad) and frequency ω (rad/s). By default
        the further parameters are at the medians of their priors; a term may override this with a closed form.
        """
        medians = {p.name: median(p.prior(amplitude, frequency)) for p in self.inferred}
        return self.work(amplitude, frequency, medians) / (2 * math.pi * (frequency * amplitude) ** 2)

    def work(self, amplitude: float, frequency: float, further: Mapping[str, float]) -> float:
        """Return the energy lost in a cycle x = A sin ωt, per unit of the coefficient and of the inertia, in rad²/s².

        Parameters
        ----------
        amplitude, frequency
            Amplitude A in rad and frequency ω in rad/s.
        further
            Values of the arguments in `further`, by name. Those in `given` may be missing; the default is their value
            for this motion.
        """
        peak = amplitude * frequency
        known = {"rest": 0.0, "reference_velocity": peak, "reference_amplitude": amplitude, **further}
        force, rest = self.at({n: known[n] for n in self.further}), known["rest"]
        total = 0.0
        for phase, weight in zip(_PHASES, _WEIGHTS, strict=True):
            x, v = rest + amplitude * math.sin(phase), peak * math.cos(phase)
            total += (
                weight
                * math.cos(phase)
                * (force(x, v, SHARP_WIDTH * peak) - force(x, -v, SHARP_WIDTH * peak))
            )
        return float(amplitude * total)

    def at(self, further: Mapping[str, float]) -> Callable[[float, float, float], float]:
        """Return the kernel as a function of (x, v, ε) only, with these values of the further arguments.

        With ε = 0 dry friction jumps with the sign of v, and is that of a tiny positive v at v = 0.
        """
        kernel, values = self.kernel, [further[n] for n in self.further]

        def force(x: float, v: float, epsilon: float) -> float:
            v = v or TINY
            return kernel(x, v, epsilon or EXACT * abs(v), *values)

        return force


def median(prior: Prior) -> float:
    """Return the median of a prior distribution."""
    return float(prior.value(np.asarray(REFLECTED_MEDIAN if prior.reflected else 0.0)))


def parse_model(name: str) -> tuple[str, ...]:
    """Return the names of the terms in a sum such as `viscous+coulomb`, in the same order.

    Raises
    ------
    InputError
        If a term is unknown, repeated or empty, or if two terms have an inferred parameter of the same name.
    """
    terms = tuple(part.strip() for part in name.split("+"))
    if len(set(terms)) != len(terms) or not all(terms):
        raise InputError(f"damping model {name!r} must be a sum of different terms, such as viscous+coulomb")
    owner: dict[str, str] = {}
    for term in terms:
        for parameter in TERMS.get(term).inferred:
            if parameter.name in owner:
                both = f"{owner[parameter.name]} and {term} both have a parameter {parameter.name!r}"
                raise InputError(f"damping model {name!r}: {both}; use only one of the two")
            owner[parameter.name] = term
    return terms


def others() -> list[str]:
    """Return the names of the terms that ship with bayesdamp, except the three terms of the paper."""
    return [name for name in TERMS.names() if TERMS.ships(name) and name not in PAPER_TERMS]


def words_of(term: str) -> str:
    """Return the words by which a sentence names a term, without an article, so that "damping" can follow.

    If the term has no `words`, or is not registered, this is its name.
    """
    words = (TERMS.get(term).words if term in TERMS.names() else "") or term
    first, _, rest = words.partition(" ")
    return rest if rest and first.lower() in ("a", "an", "the") else words


def twins_of(term: str) -> list[str]:
    """Return the names of all terms that this term names as its twin, or that name it (see `DampingTerm.twin`)."""
    names = TERMS.present()
    own = [TERMS.get(term).twin] if term in names else []
    return [n for n in names if n != term and (n in own or TERMS.get(n).twin == term)]


def all_sums() -> list[str]:
    """Return all seven sums of the paper's three terms, single terms first."""
    return ["+".join(c) for n in (1, 2, 3) for c in combinations(PAPER_TERMS, n)]
