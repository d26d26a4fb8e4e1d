"""Define what a damping term is, and register the terms: one class in one module each, found by name."""

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

NODES = 48
"""Number of nodes of Gauss and Legendre's rule in a quarter of a cycle."""
SHARP = 1e-9
"""Width, in peak velocities, of the switch of a force where its limit of a jump is wanted."""
EXACT, TINY = 1e-8, 1e-100
"""Width over the velocity at which a force has its full value to rounding, and the velocity (rad/s) in place of 0."""
REFLECTED_MEDIAN = 0.6745
"""Score of the median of a folded normal."""
GIVEN = ("rest", "reference_velocity", "reference_amplitude")
"""What a kernel may need besides parameters: the rest position, and scales of velocity and displacement."""


_X, _W = np.polynomial.legendre.leggauss(NODES)
_QUARTER = 0.25 * math.pi * (_X + 1)
_PHASES = np.concatenate([_QUARTER - 0.5 * math.pi, _QUARTER])
_WEIGHTS = np.concatenate([_W, _W]) * 0.25 * math.pi
TERMS: Registry[DampingTerm] = Registry("bayesdamp.physics.damping", "damping term")
PAPER_TERMS = ("viscous", "coulomb", "quadratic")


@dataclass(frozen=True)
class FreeParameter:
    """A parameter of a term besides its coefficient.

    name, unit: its name, and its unit for an angle in rad. prior: the prior as a function of a reference amplitude (rad
    or m) and frequency (rad/s); its support contains the possible values. symbol: how it is written; by default its
    name.
    """

    name: str
    unit: str
    prior: Callable[[float, float], Prior]
    symbol: Symbol | None = None


class DampingTerm(ABC):
    """A force coefficient · kernel(θ, θ̇; further parameters) that takes energy out of the oscillation."""

    name: str
    parameter: str
    unit: str
    """Unit of the coefficient for an angle in rad; `m` in place of rad for a record in metres."""
    symbol: Symbol | None = None
    """How the coefficient is written; by default its name."""
    words: str = ""
    """Words for the term in a sentence; by default its name."""
    formula: str = ""
    """The force as a report shows it."""
    switches: bool = False
    """Whether the shape jumps with the sign of the velocity within the width ε."""
    rounded: bool = False
    """Whether ε rounds off a shape that is steep at rest, instead of a jump. For ε = 0 the kernel still does so within
    a small share of the peak velocity."""
    inferred: tuple[FreeParameter, ...] = ()
    """Parameters besides the coefficient, in the kernel's order."""
    given: tuple[str, ...] = ()
    """Arguments of the kernel after these, of `GIVEN`."""
    bounded: bool = True
    """Whether a verdict without the term gives an upper limit of its share of the energy."""
    twin: str = ""
    """A term that takes as much energy at every amplitude: only the shape within a cycle distinguishes the two."""
    reduces: tuple[tuple[str, float], ...] = ()
    """Values of parameters at which the term is a simpler one; the upper limit is for what it has beyond that."""

    @property
    def placed(self) -> bool:
        """Whether its force depends on the position."""
        if "rest" in self.given:
            return True
        first = self.kernel.__code__.co_varnames[0]
        # Newer versions of Python load two variables at once.
        loaded = (
            i.argval if isinstance(i.argval, tuple) else (i.argval,)
            for i in dis.get_instructions(self.kernel)
        )
        return any(first in names for names in loaded)

    @property
    def further(self) -> tuple[str, ...]:
        """Names of the kernel's arguments besides θ, θ̇ and ε."""
        return (*(p.name for p in self.inferred), *self.given)

    @staticmethod
    def kernel(x: float, v: float, epsilon: float) -> float:
        """Force per unit of the coefficient at one displacement x (rad) and velocity v (rad/s), ε > 0 (rad/s).

        Plain Python with `math` and `np` alone: compiled kernels are made of it, and `force`. After ε it takes the
        term's `further` parameters.
        """
        raise NotImplementedError

    def force(self, x: ArrayLike, v: ArrayLike, epsilon: ArrayLike, *further: ArrayLike) -> np.ndarray:
        """Return the force per unit of the coefficient at displacements x (rad) and velocities v (rad/s) of one shape.

        further: values of the arguments in `further`. With ε = 0 a force that switches jumps, and is 0 at rest.
        """
        v = np.asarray(v, float)
        sharp = np.where(v == 0.0, 1.0, EXACT * np.abs(v))
        width = np.where(np.asarray(epsilon) == 0.0, sharp, epsilon)
        values = (np.asarray(value, float) for value in further)
        return on_arrays(self.kernel)(np.asarray(x, float), v, width, *values)

    def ratio_per_unit(self, amplitude: float, frequency: float) -> float:
        """Return the equivalent viscous damping ratio per unit of the coefficient, at an amplitude in rad.

        It follows from the energy lost in a cycle of a harmonic motion with a frequency in rad/s. Where a term gives no
        closed form, this is by quadrature at the medians of the further parameters' priors.
        """
        medians = {p.name: median(p.prior(amplitude, frequency)) for p in self.inferred}
        return self.work(amplitude, frequency, medians) / (2 * math.pi * (frequency * amplitude) ** 2)

    def work(self, amplitude: float, frequency: float, further: Mapping[str, float]) -> float:
        """Return the energy lost in a cycle x = A sin ωt per unit of the coefficient and inertia, rad²/s².

        Parameters
        ----------
        amplitude, frequency
            In rad and rad/s.
        further
            Values of the parameters by name; the arguments in `given` have by default their value for this motion.
        """
        peak = amplitude * frequency
        known = {"rest": 0.0, "reference_velocity": peak, "reference_amplitude": amplitude, **further}
        force, rest = self.at({n: known[n] for n in self.further}), known["rest"]
        total = 0.0
        for phase, weight in zip(_PHASES, _WEIGHTS, strict=True):
            x, v = rest + amplitude * math.sin(phase), peak * math.cos(phase)
            total += weight * math.cos(phase) * (force(x, v, SHARP * peak) - force(x, -v, SHARP * peak))
        return float(amplitude * total)

    def at(self, further: Mapping[str, float]) -> Callable[[float, float, float], float]:
        """Return the shape as a function of (x, v, ε) at values of further parameters by name; ε = 0 is the sign."""
        kernel, values = self.kernel, [further[n] for n in self.further]

        def force(x: float, v: float, epsilon: float) -> float:
            v = v or TINY
            return kernel(x, v, epsilon or EXACT * abs(v), *values)

        return force


def median(prior: Prior) -> float:
    """Return the median of a prior."""
    return float(prior.value(np.asarray(REFLECTED_MEDIAN if prior.reflected else 0.0)))


def parse_model(name: str) -> tuple[str, ...]:
    """Return the terms of a sum such as `viscous+coulomb`, in their order.

    Raises
    ------
    InputError
        For an unknown, repeated or missing term, and for two terms with a parameter of the same name.
    """
    terms = tuple(part.strip() for part in name.split("+"))
    if len(set(terms)) != len(terms) or not all(terms):
        raise InputError(f"damping model {name!r} must be a sum of different terms, such as viscous+coulomb")
    owner: dict[str, str] = {}
    for term in terms:
        for parameter in TERMS.get(term).inferred:
            if parameter.name in owner:
                both = f"{owner[parameter.name]} and {term} both have a parameter {parameter.name!r}"
                raise InputError(f"damping model {name!r}: {both}; compare them one by one")
            owner[parameter.name] = term
    return terms


def others() -> list[str]:
    """Return the terms that ship besides the paper's."""
    return [name for name in TERMS.names() if TERMS.ships(name) and name not in PAPER_TERMS]


def words_of(term: str) -> str:
    """Return the words for a term in a sentence, without an article, so that "damping" can follow.

    It is the term's name where it has no words or is not known here.
    """
    words = (TERMS.get(term).words if term in TERMS.names() else "") or term
    first, _, rest = words.partition(" ")
    return rest if rest and first.lower() in ("a", "an", "the") else words


def twins_of(term: str) -> list[str]:
    """Return the terms that take as much energy at every amplitude as this one."""
    names = TERMS.present()
    own = [TERMS.get(term).twin] if term in names else []
    return [n for n in names if n != term and (n in own or TERMS.get(n).twin == term)]


def all_sums() -> list[str]:
    """Return the seven sums of the paper's terms, single ones first."""
    return ["+".join(c) for n in (1, 2, 3) for c in combinations(PAPER_TERMS, n)]
