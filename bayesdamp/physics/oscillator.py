"""An oscillator: a sum of damping terms and a restoring law."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import ArrayLike

from bayesdamp.physics.damping import TERMS, DampingTerm, parse_model
from bayesdamp.physics.rest import bracket, by_kernel, frequency_over, newton_many, rest_near
from bayesdamp.physics.restoring import LAWS, RestoringLaw

Parameters = Mapping[str, float | np.ndarray]
REACH, POINTS = 10.0, 4001
"""How far an equilibrium is looked for, rad, and at how many angles."""
NEWTON = 4
"""Steps from about where a motion comes to rest to where it does so: from a tenth of a radian within 1e-15."""


@dataclass(frozen=True, init=False)
class Oscillator:
    """θ̈ + F_damp(θ̇) + F_rest(θ) = 0; parameters are a mapping of names to numbers.

    damping: names of the damping terms, or their sum in words, `viscous+coulomb`; restoring: name of the restoring law.
    Raises InputError for such a sum of unknown terms.
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
        """Names of the terms' parameters beside their coefficients."""
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
        """What terms take that is no parameter, of `GIVEN`."""
        return tuple(dict.fromkeys(n for term in self.terms for n in term.given))

    @property
    def inputs(self) -> tuple[str, ...]:
        """Every number that a trajectory needs: parameters and scales."""
        return (*self.parameters, *self.scales)

    def damping_force(self, theta: ArrayLike, omega: ArrayLike, p: Parameters) -> np.ndarray:
        """F_damp(θ, θ̇) in rad/s²; θ and θ̇ of one shape, parameters broadcast against it."""
        forces = zip(self.terms, self.shapes(theta, omega, p), strict=True)
        return sum((p[t.parameter] * one for t, one in forces), np.zeros(np.shape(omega)))

    def shapes(self, theta: ArrayLike, omega: ArrayLike, p: Parameters) -> list[np.ndarray]:
        """Each term's force per unit of its coefficient; θ and θ̇ of one shape."""
        p = self.settled(p)
        epsilon = p.get("epsilon", 1.0)
        return [t.force(theta, omega, epsilon, *(p[n] for n in t.further)) for t in self.terms]

    def settled(self, p: Parameters) -> Parameters:
        """With `rest`, where a term asks for it, moved to the equilibrium near it: Newton's method."""
        if "rest" not in self.scales:
            return p
        shape = np.broadcast_shapes(*(np.shape(p[n]) for n in (*self.law.parameters, "rest")))
        near = np.broadcast_to(p["rest"], shape)
        return {**p, "rest": newton_many(lambda at: self.law.force(at, p), near, NEWTON)}

    def equilibrium(self, p: Parameters, near: float = 0.0) -> float:
        """The stable rest position nearest to `near`, in rad.

        Raises ValueError where the law has none within 10 rad.
        """
        return _equilibrium(
            self.restoring, tuple(float(p[name]) for name in self.law.parameters), float(near)
        )

    def natural_frequency(self, p: Parameters, near: float = 0.0) -> float:
        """ω_n = √F′_rest at the equilibrium, rad/s."""
        at = self.equilibrium(p, near)
        return float(np.sqrt(self.law.slope(at, p)))

    def rough_frequency(self, p: Parameters, near: float = 0.0, reach: float = REACH) -> float:
        """The same to some per mille, rad/s: for limits alone. Raises ValueError as `equilibrium` does, where there is
        none within reach."""
        force = by_kernel(self.law.kernel, np.array([float(p[name]) for name in self.law.parameters]))
        ends = bracket(force, near, reach, POINTS)
        if ends is None:
            raise no_rest(self.restoring, near)
        return frequency_over(force, *ends)


def no_rest(restoring: str, near: float) -> ValueError:
    """What is raised where a law has no equilibrium."""
    return ValueError(f"{restoring} has no stable equilibrium within {REACH:g} rad of {near:.3g}")


@lru_cache(maxsize=4096)
def _equilibrium(restoring: str, values: tuple[float, ...], near: float) -> float:
    p = dict(zip(LAWS.get(restoring).parameters, values))
    law = LAWS.get(restoring)
    found = rest_near(lambda x: law.force(x, p), near, REACH, POINTS)
    if found is None:
        raise no_rest(restoring, near)
    return found
