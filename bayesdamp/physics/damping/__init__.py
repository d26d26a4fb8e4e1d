"""Define the base class of damping terms and their registry. Each term is one class in a module of its own.

A damping force F is a force per unit of inertia (rad/s²) in the equation of motion θ̈ + F + restoring force = 0. θ is
an angle in rad; for a displacement in m, read m instead of rad.
"""

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
"""Number of Gauss–Legendre nodes in each quarter of a cycle in the integral of the energy that is lost in a cycle
(conventional)."""
SHARP_WIDTH = 1e-9
"""Width ε of the sign change of friction, relative to the peak velocity, with which the energy lost by a discontinuous
friction is computed."""
EXACT, TINY = 1e-8, 1e-100
"""`EXACT`: ratio ε/|v| at which tanh(v/ε) equals the sign of v to rounding; it represents friction with ε = 0. `TINY`:
velocity (rad/s) that replaces v = 0 there."""
REFLECTED_MEDIAN = 0.6745
"""Median of |z| for a standard normal z, which is the score of the median of a half-normal prior."""
GIVEN = ("rest", "reference_velocity", "reference_amplitude")
"""Numbers that the force of a damping term may depend on besides its parameters: the equilibrium (rad), and reference
scales of velocity (rad/s) and displacement (rad). They are given, not inferred."""


# Quadrature nodes and weights for the phase of sin ωt from −π/2 to π/2, with the rule on each side of 0.
_X, _W = np.polynomial.legendre.leggauss(NODES_PER_QUARTER)
_QUARTER = 0.25 * math.pi * (_X + 1)
_PHASES = np.concatenate([_QUARTER - 0.5 * math.pi, _QUARTER])
_WEIGHTS = np.concatenate([_W, _W]) * 0.25 * math.pi
TERMS: Registry[DampingTerm] = Registry("bayesdamp.physics.damping", "damping term")
"""All damping terms by name: those that ship with bayesdamp and those that a user adds."""
PAPER_TERMS = ("viscous", "coulomb", "quadratic")
"""Names of the three damping terms in the paper whose claims bayesdamp tests (`bayesdamp.claims`)."""


@dataclass(frozen=True)
class FreeParameter:
    """A parameter of a damping term other than its coefficient, which is inferred from the record.

    name, unit: name of the parameter, and its unit for an angle in rad. prior: function that returns the prior for a
    reference amplitude (rad or m) and angular frequency (rad/s); the support of the prior must contain all possible
    values. symbol: symbol in reports; by default the name.
    """

    name: str
    unit: str
    prior: Callable[[float, float], Prior]
    symbol: Symbol | None = None


class DampingTerm(ABC):
    """A damping force per unit of inertia: coefficient · kernel(θ, θ̇, ε, further arguments).

    name: name of the term. parameter: name of the coefficient. ε is the width of the velocity (rad/s) within which dry
    friction changes its sign.
    """

    name: str
    parameter: str
    unit: str
    """Unit of the coefficient for an angle in rad; for a record in metres, `m` replaces `rad`."""
    symbol: Symbol | None = None
    """Symbol of the coefficient in reports; None to show its name `parameter`."""
    words: str = ""
    """Name of the term in sentences of a report; "" to use `name`."""
    formula: str = ""
    """Formula of the force, including the coefficient, for reports."""
    switches: bool = False
    """Whether the force depends on ε: it jumps with the sign of the velocity, as dry friction does, or is continuous
    but steep at v = 0 (then `rounded` is true). ε is the width of the velocity within which this is smoothed."""
    rounded: bool = False
    """Whether ε does not smooth a jump, but the steep slope of a continuous force at v = 0. Such a term is smoothed
    within a small fraction of the peak velocity even if ε = 0."""
    inferred: tuple[FreeParameter, ...] = ()
    """The inferred parameters other than the coefficient, in the order in which the kernel takes them after ε."""
    given: tuple[str, ...] = ()
    """Those names in `GIVEN` that the kernel takes as further arguments, after the parameters in `inferred`."""
    bounded: bool = True
    """Whether an analysis without this term states an upper limit of the fraction of the dissipated energy that this
    term could have."""
    twin: str = ""
    """Name of another term whose energy loss per cycle depends on the amplitude in the same way, so that only the
    motion within a cycle distinguishes the two; "" if there is none."""
    reduces: tuple[tuple[str, float], ...] = ()
    """Names of parameters, and the values at which the term reduces to a simpler one. The upper limit of such a term
    (`bounded`) is for the part of its force beyond that of the simpler term."""

    @property
    def placed(self) -> bool:
        """Whether the force depends on the position θ."""
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
        """Names of the kernel's arguments after θ, θ̇ and ε: those in `inferred`, then those in `given`."""
        return (*(p.name for p in self.inferred), *self.given)

    @staticmethod
    def kernel(x: float, v: float, epsilon: float) -> float:
        """Return the force per unit of the coefficient at one displacement x (rad) and velocity v (rad/s).

        epsilon: the width ε > 0 in rad/s. A term with further parameters takes them as arguments after ε, in the order
        of `further`. The method may use only plain Python, `math` and `np`, because its source is compiled.
        """
        raise NotImplementedError

    def force(self, x: ArrayLike, v: ArrayLike, epsilon: ArrayLike, *further: ArrayLike) -> np.ndarray:
        """Return the force per unit of the coefficient at displacements x (rad) and velocities v (rad/s).

        x and v have the same shape, which is that of the result. epsilon: the width ε (rad/s). further: values of the
        arguments named in `DampingTerm.further`. With ε = 0, dry friction jumps with the sign of v and is 0 at v = 0.
        """
        v = np.asarray(v, float)
        sharp = np.where(v == 0.0, 1.0, EXACT * np.abs(v))
        width = np.where(np.asarray(epsilon) == 0.0, sharp, epsilon)
        values = (np.asarray(value, float) for value in further)
        return on_arrays(self.kernel)(np.asarray(x, float), v, width, *values)

    def ratio_per_unit(self, amplitude: float, frequency: float) -> float:
        """Return the equivalent viscous damping ratio of the term for a coefficient of 1: W / (2π ω² A²).

        W is the energy lost in a cycle of a harmonic motion with amplitude A (rad) and angular frequency ω (rad/s).
        Other parameters of the term are at the medians of their priors. A term may override this method with a closed
        form.
        """
        medians = {p.name: median(p.prior(amplitude, frequency)) for p in self.inferred}
        return self.work(amplitude, frequency, medians) / (2 * math.pi * (frequency * amplitude) ** 2)

    def work(self, amplitude: float, frequency: float, further: Mapping[str, float]) -> float:
        """Return the energy lost in a cycle x = θ_e + A sin ωt, per unit of coefficient and inertia, in rad²/s².

        Parameters
        ----------
        amplitude, frequency
            Amplitude A in rad and angular frequency ω in rad/s.
        further
            Values of the arguments named in `DampingTerm.further`, by name. Those in `given` may be missing: the
            equilibrium is then 0, and the reference scales are those of this motion (ωA and A).
        """
        peak = amplitude * frequency
        known = {"rest": 0.0, "reference_velocity": peak, "reference_amplitude": amplitude, **further}
        x, v = known["rest"] + amplitude * np.sin(_PHASES), peak * np.cos(_PHASES)
        there, back = (
            self.force(x, way * v, SHARP_WIDTH * peak, *(known[n] for n in self.further))
            for way in (1.0, -1.0)
        )
        return float(amplitude * np.sum(_WEIGHTS * np.cos(_PHASES) * (there - back)))

    def at(self, further: Mapping[str, float]) -> Callable[[float, float, float], float]:
        """Return the kernel as a function of (x, v, ε) only, with the further arguments fixed at these values, by name.

        With ε = 0 the function gives dry friction that jumps with the sign of v; at v = 0 it gives the friction of a
        tiny positive velocity, because dry friction is undefined there.
        """
        kernel, values = self.kernel, [further[n] for n in self.further]

        def force(x: float, v: float, epsilon: float) -> float:
            v = v or TINY
            return kernel(x, v, epsilon or EXACT * abs(v), *values)

        return force


def median(prior: Prior) -> float:
    """Return the median of a parameter's prior distribution, in the unit of the parameter."""
    return float(prior.value(np.asarray(REFLECTED_MEDIAN if prior.reflected else 0.0)))


def parse_model(name: str, where: str = "") -> tuple[str, ...]:
    """Split the name of a sum of damping terms, such as `viscous+coulomb`, into the names of its terms.

    `where` begins the messages of errors.

    Raises
    ------
    InputError
        If a term is unknown, repeated or empty, or if two terms have an inferred parameter of the same name.
    """
    terms = tuple(part.strip() for part in name.split("+"))
    if len(set(terms)) != len(terms) or not all(terms):
        raise InputError(
            f"damping model {name!r} must be a sum of different terms, such as viscous+coulomb", where
        )
    owner: dict[str, str] = {}
    for term in terms:
        for parameter in TERMS.get(term, where).inferred:
            if parameter.name in owner:
                both = f"{owner[parameter.name]} and {term} both have a parameter {parameter.name!r}"
                raise InputError(f"damping model {name!r}: {both}; use only one of the two", where)
            owner[parameter.name] = term
    return terms


def others() -> list[str]:
    """Return the names of all damping terms that ship with bayesdamp, except viscous, Coulomb and quadratic damping."""
    return [name for name in TERMS.names() if TERMS.ships(name) and name not in PAPER_TERMS]


def words_of(term: str) -> str:
    """Return the name of a damping term as it is written in a sentence, such as "Coulomb (dry friction)".

    It has no article, and the word "damping" can follow it. term: name of the term in the registry. The result is
    `DampingTerm.words`, or `term` itself if the term has no `words` or is not registered.
    """
    words = (TERMS.get(term).words if term in TERMS.names() else "") or term
    first, _, rest = words.partition(" ")
    return rest if rest and first.lower() in ("a", "an", "the") else words


def twins_of(term: str) -> list[str]:
    """Return the names of all terms whose energy loss depends on the amplitude in the same way as that of a term.

    They are its `DampingTerm.twin` and all terms whose `twin` it is; [] for an unknown term without any.
    """
    names = TERMS.present()
    own = [TERMS.get(term).twin] if term in names else []
    return [n for n in names if n != term and (n in own or TERMS.get(n).twin == term)]


def all_sums() -> list[str]:
    """Return the names of all seven sums of viscous, Coulomb and quadratic damping, single terms first."""
    return ["+".join(c) for n in (1, 2, 3) for c in combinations(PAPER_TERMS, n)]
