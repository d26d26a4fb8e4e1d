"""Define the base class of damping terms and their registry. Each term is one class in a module of its own.

A damping force F is a force per unit of inertia (rad/s²) in the equation of motion θ̈ + F + restoring force = 0. θ is
an angle in rad; for a displacement in m, read m instead of rad.
"""

from __future__ import annotations

import dis
from abc import ABC
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from itertools import combinations

import numpy as np
from numpy.typing import ArrayLike

from bayesdamp.physics.forces import on_arrays
from bayesdamp.plugins import Plugin, Registry
from bayesdamp.priors import Prior
from bayesdamp.types import InputError, Symbol

NODES_PER_QUARTER = 48
"""Number of Gauss–Legendre nodes in each quarter of a cycle in the integral of the energy that is lost in a cycle
(conventional)."""
SHARP_WIDTH = 1e-9
"""Width ε of the range of velocities in which friction changes its sign, relative to the peak velocity, in
`DampingTerm.work`. It is so small that the friction practically jumps at v = 0 (conventional)."""
EXACT, TINY = 1e-8, 1e-100
"""`EXACT` represents discontinuous friction (ε = 0): with the width ε = `EXACT` · |v|, tanh(v/ε) equals the sign of the
velocity v to rounding. `TINY` is the velocity (rad/s) that replaces v = 0, for which this ε would be 0."""
REFLECTED_MEDIAN = 0.6745
"""Median of |z| for a standard normal number z. A half-normal prior depends on z only by |z|, so that this z gives its
median."""
GIVEN = ("rest", "reference_velocity", "reference_amplitude")
"""Names of numbers on which the force of a damping term may depend besides its parameters: the equilibrium (rad), and
reference scales of velocity (rad/s) and displacement (rad). The caller provides them; they are not fitted."""


# Quadrature nodes and weights for the phase ωt of sin ωt from −π/2 to π/2: one Gauss–Legendre rule on each side of 0.
_X, _W = np.polynomial.legendre.leggauss(NODES_PER_QUARTER)
_QUARTER = 0.25 * np.pi * (_X + 1)
_PHASES = np.concatenate([_QUARTER - 0.5 * np.pi, _QUARTER])
_WEIGHTS = np.concatenate([_W, _W]) * 0.25 * np.pi
TERMS: Registry[DampingTerm] = Registry("bayesdamp.physics.damping", "damping term")
"""All damping terms by name: those that ship with bayesdamp and those that a user adds."""
PAPER_TERMS = ("viscous", "coulomb", "quadratic")
"""Names of the three damping terms in the paper whose claims bayesdamp tests (`bayesdamp.claims`)."""


@dataclass(frozen=True)
class FreeParameter:
    """A parameter of a damping term, other than the coefficient of its force, that is inferred from the record.

    name, unit: name of the parameter, and its unit for an angle in rad. prior: function that returns the prior for a
    reference amplitude (rad or m) and angular frequency (rad/s); the support of the prior must contain all possible
    values. symbol: symbol in reports; by default the name.
    """

    name: str
    unit: str
    prior: Callable[[float, float], Prior]
    symbol: Symbol | None = None


class DampingTerm(Plugin, ABC):
    """A damping force per unit of inertia: coefficient · kernel(θ, θ̇, ε, further arguments).

    name: name of the term. parameter: name of the coefficient. ε is the width of the range of velocities (rad/s) about
    0 in which dry friction changes its sign.
    """

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
    """Whether the force depends on ε, the width of the range of velocities about 0 in which the force is smoothed. This
    is true for a force that jumps with the sign of the velocity, such as dry friction. It is also true for a force that
    is continuous but steep at v = 0; `rounded` is then true."""
    rounded: bool = False
    """Whether the force is continuous but steep at v = 0, so that ε, the width in velocity, smooths its slope and not a
    jump. Such a force is smoothed within a small fraction of the peak velocity even if ε = 0."""
    inferred: tuple[FreeParameter, ...] = ()
    """The parameters other than the coefficient that are inferred from the record. `kernel` takes them after ε, in this
    order."""
    given: tuple[str, ...] = ()
    """Names of the numbers that the force needs besides parameters: "rest" (the equilibrium), "reference_velocity" or
    "reference_amplitude". `kernel` takes them as its last arguments, after the parameters in `inferred`."""
    bounded: bool = True
    """Whether an analysis whose model lacks this term reports an upper limit of the fraction of the dissipated energy
    that this term could cause. It has no effect for viscous, Coulomb and quadratic damping, and for terms that a user
    adds."""
    twin: str = ""
    """Name of another term whose energy loss per cycle depends on the amplitude in the same way, so that only the
    motion within a cycle distinguishes the two; "" if there is none."""
    reduces: tuple[tuple[str, float], ...] = ()
    """Pairs of a parameter's name and a value. With these values the term equals a simpler term, for example Coulomb
    friction. Fits start at these values. The upper limit of such a term (`bounded`) is then for the part of its force
    beyond the simpler term."""

    @property
    def placed(self) -> bool:
        """Whether the force depends on the position θ; some estimators then refuse the term.

        This is assumed if `given` has "rest", or if the code of `kernel` reads its first argument.
        """
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

        epsilon: width ε > 0 in rad/s of the range of velocities about 0 in which the force is smoothed. A term with
        further parameters takes them as arguments after ε, in the order of `further`. Each term must define this
        method. It may use only plain Python, `math` and `np`, because its source is compiled.
        """
        raise NotImplementedError

    def force(self, x: ArrayLike, v: ArrayLike, epsilon: ArrayLike, *further: ArrayLike) -> np.ndarray:
        """Return the force per unit of the coefficient at displacements x (rad) and velocities v (rad/s).

        x and v have the same shape, which is also the shape of the result. epsilon: width ε (rad/s) of the range of
        velocities about 0 in which the force is smoothed. With ε = 0, dry friction jumps with the sign of v and is 0 at
        v = 0. further: values of the arguments named in `DampingTerm.further`, in this order. epsilon and these values
        are numbers, or arrays of the shape of v.
        """
        v = np.asarray(v, float)
        sharp = np.where(v == 0.0, 1.0, EXACT * np.abs(v))
        width = np.where(np.asarray(epsilon) == 0.0, sharp, epsilon)
        values = (np.asarray(value, float) for value in further)
        return on_arrays(self.kernel)(np.asarray(x, float), v, width, *values)

    def ratio_per_unit(self, amplitude: float, frequency: float) -> float:
        """Return the equivalent viscous damping ratio of the term for a coefficient of 1: W / (2π ω² A²).

        W is the energy lost in a cycle of a harmonic motion with amplitude A (rad) and angular frequency ω (rad/s).
        Other inferred parameters of the term are at the medians of their priors for this A and ω; the equilibrium is 0,
        and the reference scales are those of this motion. A term may override this method with a closed form.
        """
        medians = {p.name: median(p.prior(amplitude, frequency)) for p in self.inferred}
        return self.work(amplitude, frequency, medians) / (2 * np.pi * (frequency * amplitude) ** 2)

    def work(self, amplitude: float, frequency: float, further: Mapping[str, float]) -> float:
        """Return the energy lost in a cycle x = θ_e + A sin ωt, for coefficient 1 and per unit of inertia, in rad²/s².

        Dry friction jumps with the sign of the velocity here.

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
        """Return the force per unit of the coefficient as a function of (x, v, ε), with all other arguments fixed.

        further: values of the other arguments of `kernel`, by name (`DampingTerm.further`). x: displacement; v:
        velocity; ε: width of the range of velocities in which the force is smoothed. With ε = 0 the function returns
        dry friction that jumps with the sign of v. At v = 0, where this is undefined, it returns the friction of a tiny
        positive velocity.
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

    where: text with which error messages begin, such as the place of the name in a file.

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
    """Return the names, sorted, of the damping terms that ship with bayesdamp except viscous, Coulomb and quadratic."""
    return [name for name in TERMS.names() if TERMS.ships(name) and name not in PAPER_TERMS]


def words_of(term: str) -> str:
    """Return the name of a damping term as it is written in a sentence, such as "Coulomb (dry friction)".

    The result is `DampingTerm.words` without an article (a, an, the) at its beginning, or `term` itself if the term has
    no `words` or is not registered. The word "damping" can follow it. term: name of the term in the registry.
    """
    words = (TERMS.get(term).words if term in TERMS.names() else "") or term
    first, _, rest = words.partition(" ")
    return rest if rest and first.lower() in ("a", "an", "the") else words


def twins_of(term: str) -> list[str]:
    """Return the names of all terms whose energy loss depends on the amplitude in the same way as that of a term.

    Only the motion within a cycle can distinguish such terms. They are those declared by `DampingTerm.twin`: the twin
    of the given term if it is registered, and all terms that declare the given term as their twin; [] if there are
    none. term: name of the given term, which need not be registered.
    """
    names = TERMS.present()
    own = [TERMS.get(term).twin] if term in names else []
    return [n for n in names if n != term and (n in own or TERMS.get(n).twin == term)]


def all_sums() -> list[str]:
    """Return the names of all seven sums of viscous, Coulomb and quadratic damping, such as `viscous+coulomb`.

    Single terms come first, then sums of two and of three terms.
    """
    return ["+".join(c) for n in (1, 2, 3) for c in combinations(PAPER_TERMS, n)]
