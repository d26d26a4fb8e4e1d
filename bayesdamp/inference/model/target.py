"""The posterior of one damping model on one record, as a function of normal scores.

A `Layout` is what compiled code depends on (structure); a `Context` is what it gets (numbers). What is computed of
them (`density`, `linearised`) is a function of (layout; context, z), z the scores of the inferred parameters, shape
(d,). The prior is N(0, 1) in each, but for the coefficients whose priors share an unknown scale (`SharedHalfNormal`).
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from bayesdamp.inference.model.qr_compression import Compressed, compress
from bayesdamp.inference.noise import NOISES, NoiseModel
from bayesdamp.numerics.lazily import jax, jnp, tree
from bayesdamp.physics.integrate import is_exact, plan_of, plan_with_error
from bayesdamp.physics.oscillator import Oscillator
from bayesdamp.physics.solver.plan import Plan
from bayesdamp.physics.solver.steps import MeshPlan
from bayesdamp.priors import SHARED_SIGMAS, HalfNormal, Prior, SharedHalfNormal
from bayesdamp.types import Signal

if TYPE_CHECKING:
    from jax import Array

ABSENT = HalfNormal.model_construct(scale=0.0)
"""The prior of a coefficient that is 0; no study can ask for it."""
SHARED_ABSENT = SharedHalfNormal.model_construct(per_ratio=0.0)
"""The same, of the kind that default priors of coefficients have, so that both are in one program. Its score is N(0, 1)
and shares no scale with the others."""


@dataclass(frozen=True)
class Layout:
    """Oscillator, noise model, names of the inferred parameters and the kinds of their priors."""

    oscillator: Oscillator
    noise_name: str
    names: tuple[str, ...]
    kinds: tuple[type, ...]
    reflected: tuple[bool, ...]

    @property
    def noise(self) -> NoiseModel:
        """The noise model itself."""
        return NOISES.get(self.noise_name)


@tree(["plan", "y", "gaps", "known", "numbers", "scales", "compressed"])
@dataclass(frozen=True)
class Context:
    """The record y, shape (n,), its gaps (s, (n − 1,)), the plan of the solver, what is known, the priors.

    scales: those that coefficients may share, in scores, all equally probable, (s,). compressed: the record as the
    likelihood reads it where samples are many; else it reads all of them.
    """

    plan: Plan
    y: Array
    gaps: Array
    known: Mapping[str, Array]
    numbers: tuple[tuple[Array, ...], ...]
    scales: Array
    compressed: Compressed | None

    def held(self, scale: float) -> Context:
        """The same with the scale that coefficients share held at one value, in scores."""
        return replace(self, scales=jax.device_put(np.full(np.shape(self.scales), float(scale))))

    @cached_property
    def compact(self) -> Context:
        """Without the samples where the likelihood does not read them: then records of all lengths, and their parts,
        share a compilation."""
        if self.compressed is None or not isinstance(self.plan, MeshPlan):
            return self
        steps = np.asarray(self.plan.steps)[: self.compressed.capacity]
        steps, interval, weights, none = jax.device_put(
            (steps, np.zeros(0, int), np.zeros((0, 6)), np.zeros(0))
        )
        plan = MeshPlan(steps, self.plan.count, interval, weights)
        return replace(self, plan=plan, y=none, gaps=none)

    def padded(self, room: int) -> Context:
        """A compact context padded for so many steps."""
        if self.compressed is None or not isinstance(self.plan, MeshPlan):
            return self
        steps = jnp.pad(self.plan.steps, (0, room - self.plan.steps.size))
        return replace(self, plan=replace(self.plan, steps=steps), compressed=self.compressed.padded(room))


@dataclass(frozen=True)
class Target:
    """Prior, trajectory and noise over one record: what is inferred, and from what.

    priors: name to prior, of every inferred parameter, in order; known: name to value of the others; scales: those that
    coefficients with a `SharedHalfNormal` prior may share, in scores, all equally probable.
    """

    signal: Signal
    oscillator: Oscillator
    noise: str
    priors: Mapping[str, Prior]
    known: Mapping[str, float]
    scales: tuple[float, ...] = tuple(map(float, SHARED_SIGMAS))

    def __post_init__(self) -> None:
        missing = self._needed - set(self.priors) - set(self.known)
        if missing:
            raise ValueError(f"neither known nor inferred: {', '.join(sorted(missing))}")

    @property
    def _needed(self) -> set[str]:
        noise = NOISES.get(self.noise)
        return {*self.oscillator.inputs, *noise.parameters, *noise.constants}

    @property
    def names(self) -> tuple[str, ...]:
        """Of the inferred parameters, in the order of the scores."""
        return tuple(self.priors)

    @property
    def live(self) -> tuple[str, ...]:
        """Names of what is inferred, without the coefficients that are 0 at every score."""
        return tuple(n for n, p in self.priors.items() if p not in (ABSENT, SHARED_ABSENT))

    @property
    def shared(self) -> np.ndarray:
        """Which of the scores, (d,), are coefficients whose priors share an unknown scale, without absent ones."""
        return np.array(
            [isinstance(p, SharedHalfNormal) and p.per_ratio > 0 for p in self.priors.values()], bool
        )

    def prior_draws(self, count: int, rng: np.random.Generator) -> np.ndarray:
        """Scores under the prior, (n, d), of either sign where they are reflected."""
        z = rng.standard_normal((count, len(self.names)))
        shared = self.shared
        if shared.any():
            z[:, shared] *= rng.choice(self.scales, count)[:, None]
        return z

    @property
    def layout(self) -> Layout:
        """What compiled code depends on."""
        kinds = tuple(type(p) for p in self.priors.values())
        reflected = tuple(p.reflected for p in self.priors.values())
        return Layout(self.oscillator, self.noise, self.names, kinds, reflected)

    def context(self, plan: Plan, part: slice = slice(None)) -> Context:
        """The numbers of this target with a plan made near the parameters of interest, for a part of its samples."""
        t, y = self.signal.t[part], self.signal.y[part]
        return Context(
            plan,
            jax.device_put(np.asarray(y)),
            jax.device_put(np.diff(t)),
            {n: jax.device_put(float(v)) for n, v in sorted(self.known.items()) if n in self._needed},
            numbers_of(self.priors.values()),
            jax.device_put(np.asarray(self.scales)),
            compress(self.layout.noise, plan, t, y),
        )

    def scores(self, values: Mapping[str, float]) -> np.ndarray:
        """Scores of parameter values, shape (d,), within ±6; what is not given is at its prior's centre."""
        z = [float(p.score(values[n])) if n in values else 0.5 * p.reflected for n, p in self.priors.items()]
        return np.clip(np.nan_to_num(np.asarray(z), nan=0.0, posinf=6.0, neginf=-6.0), -6.0, 6.0)

    def values(self, z: np.ndarray) -> dict[str, np.ndarray]:
        """Inferred parameters at scores z, shape (..., d): name to array of shape (...)."""
        return {n: np.asarray(p.value(z[..., i])) for i, (n, p) in enumerate(self.priors.items())}

    def all_values(self, z: np.ndarray) -> dict[str, float]:
        """Every parameter, known and inferred, at one set of scores."""
        return {
            **{k: float(v) for k, v in self.known.items()},
            **{k: float(v) for k, v in self.values(z).items()},
        }

    def plan(self, z: np.ndarray, tolerance: float, stepped: bool = False) -> tuple[Plan, float]:
        """A plan of the solver near the scores z, within `tolerance` (unit of the record), and its error.

        stepped: in steps, however many cycles there are.
        """
        make = plan_with_error if stepped else plan_of
        return make(self.oscillator, self.all_values(z), self.signal.t, self.signal.quantity, tolerance)

    @property
    def exact_friction(self) -> bool:
        """Whether ε is known to be 0."""
        return "epsilon" not in self.priors and is_exact(self.oscillator, {"epsilon": 1.0, **self.known})


def numbers_of(priors: Iterable[Prior]) -> tuple[tuple[Array, ...], ...]:
    """The numbers of priors as a context has them."""
    return jax.device_put(tuple(tuple(map(float, p.numbers)) for p in priors))
