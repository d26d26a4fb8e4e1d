"""An oscillator: a sum of damping terms and a restoring law."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache

import jax
import numpy as np
from jax import Array
from jax import numpy as jnp
from jax.typing import ArrayLike
from scipy.optimize import brentq

from bayesdamp.machine.programs import Program
from bayesdamp.physics.damping import TERMS, DampingTerm
from bayesdamp.physics.restoring import LAWS, RestoringLaw, Scalar

Parameters = Mapping[str, Scalar]
ROOM = 4096
"""Angles in one call of a compiled force."""


@dataclass(frozen=True)
class Oscillator:
    """θ̈ + F_damp(θ̇) + F_rest(θ) = 0; parameters are a mapping of names to scalars (a pytree).

    damping: names of the damping terms; restoring: name of the restoring law.
    """

    damping: tuple[str, ...]
    restoring: str

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

    def damping_force(self, omega: ArrayLike, p: Parameters) -> Array:
        """F_damp(θ̇) in rad/s², of the shape of θ̇."""
        epsilon = p.get("epsilon", 1.0)
        return sum((p[t.parameter] * t.shape(omega, epsilon) for t in self.terms), jnp.zeros_like(omega))

    def acceleration(self, theta: ArrayLike, omega: ArrayLike, p: Parameters) -> Array:
        """θ̈ in rad/s²; θ and θ̇ of one shape."""
        return -self.damping_force(omega, p) - self.law.force(theta, p)

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
        known = {name: float(p[name]) for name in self.law.parameters}
        return float(np.sqrt(restoring_force(self.restoring, np.array([at]), known)[1][0]))


@lru_cache(maxsize=4096)
def _equilibrium(restoring: str, values: tuple[float, ...], near: float) -> float:
    grid = near + np.linspace(-10.0, 10.0, 4001)
    p = dict(zip(LAWS.get(restoring).parameters, values))
    force = restoring_force(restoring, grid, p)[0]
    rising = np.flatnonzero((force[:-1] <= 0) & (force[1:] > 0))
    if rising.size == 0:
        raise ValueError(f"{restoring} has no stable equilibrium within 10 rad of {near:.3g}")
    i = rising[np.argmin(np.abs(grid[rising] - near))]

    def force_of(x: float) -> float:
        return float(restoring_force(restoring, np.array([x]), p)[0][0])

    root = brentq(force_of, grid[i], grid[i + 1], xtol=1e-14)
    return float(root)  # type: ignore[arg-type]


def restoring_force(
    restoring: str, theta: np.ndarray, p: Mapping[str, float]
) -> tuple[np.ndarray, np.ndarray]:
    """F_rest and F′_rest of a law by its name at angles (n,), each (n,); one compiled program whatever their number."""
    n = theta.size
    padded = np.pad(theta, (0, -n % ROOM), mode="edge")
    found = [_restoring_force(restoring)(part, dict(p)) for part in np.split(padded, padded.size // ROOM)]
    force, slope = (np.concatenate(values)[:n] for values in zip(*found, strict=True))
    return force, slope


@lru_cache(maxsize=64)
def _restoring_force(restoring: str):
    law = LAWS.get(restoring)

    def both(theta: Array, p: Parameters) -> tuple[Array, Array]:
        return jax.vmap(jax.value_and_grad(lambda x: law.force(x, p)))(theta)

    return Program(both, "restoring_force", restoring)


@lru_cache(maxsize=64)
def damping_shapes(osc: Oscillator):
    """Compiled: the terms' shapes at velocities (n,), (terms, n): (velocities, ε) -> shapes."""

    def every(omega: Array, epsilon: Array) -> Array:
        return jnp.stack([term.shape(omega, epsilon) for term in osc.terms])

    return Program(every, "damping_shapes", osc)
