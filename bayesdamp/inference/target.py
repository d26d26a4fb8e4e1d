"""The posterior of one damping model on one record, as a function of normal scores.

A `Layout` is what compiled code depends on (structure); a `Context` is what it gets (numbers). Everything is
a function of (layout; context, z), z the scores of the inferred parameters, shape (d,): the prior is N(0, 1)
in each.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache, partial

import jax
import numpy as np
from jax import Array
from jax import numpy as jnp

from bayesdamp.inference import condensed as condensing
from bayesdamp.inference.condensed import Condensed, condense
from bayesdamp.inference.noise import NOISES, NoiseModel, NormalNoise
from bayesdamp.physics.integrate import MeshPlan, Plan, is_exact, nodes, plan_with_error, record
from bayesdamp.physics.oscillator import Oscillator
from bayesdamp.priors import HalfNormal, Prior
from bayesdamp.types import Signal

ABSENT = HalfNormal.model_construct(scale=0.0)
"""The prior of a coefficient that is 0; no study can ask for it."""
LOG_2PI = float(np.log(2 * np.pi))


@dataclass(frozen=True)
class Layout:
    """Oscillator, noise model, names of the inferred parameters and the kinds of their priors."""

    oscillator: Oscillator
    noise_name: str
    names: tuple[str, ...]
    kinds: tuple[type, ...]
    folded: tuple[bool, ...]

    @property
    def noise(self) -> NoiseModel:
        return NOISES.get(self.noise_name)


@partial(
    jax.tree_util.register_dataclass,
    data_fields=["plan", "y", "gaps", "known", "numbers", "condensed"],
    meta_fields=[],
)
@dataclass(frozen=True)
class Context:
    """The record y, shape (n,), its gaps (s, (n − 1,)), the plan of the solver, what is known, the priors.

    condensed: the record as the likelihood reads it where samples are many; else it reads all of them.
    """

    plan: Plan
    y: Array
    gaps: Array
    known: Mapping[str, Array]
    numbers: tuple[tuple[Array, ...], ...]
    condensed: Condensed | None

    @cached_property
    def lean(self) -> Context:
        """Without the samples where the likelihood does not read them: then records of all lengths, and their parts,
        share a compilation."""
        if self.condensed is None or not isinstance(self.plan, MeshPlan):
            return self
        plan = MeshPlan(
            self.plan.steps[: self.condensed.room], self.plan.count, jnp.zeros(0, int), jnp.zeros((0, 6))
        )
        return replace(self, plan=plan, y=jnp.zeros(0), gaps=jnp.zeros(0))

    def in_room(self, room: int) -> Context:
        """A lean context with room for so many steps."""
        if self.condensed is None or not isinstance(self.plan, MeshPlan):
            return self
        steps = jnp.pad(self.plan.steps, (0, room - self.plan.steps.size))
        return replace(self, plan=replace(self.plan, steps=steps), condensed=self.condensed.in_room(room))


@dataclass(frozen=True)
class Target:
    """Prior, trajectory and noise over one record: what is inferred, and from what.

    priors: name to prior, of every inferred parameter, in order; known: name to value of the others.
    """

    signal: Signal
    oscillator: Oscillator
    noise: str
    priors: Mapping[str, Prior]
    known: Mapping[str, float]

    def __post_init__(self) -> None:
        missing = self._needed - set(self.priors) - set(self.known)
        if missing:
            raise ValueError(f"neither known nor inferred: {', '.join(sorted(missing))}")

    @property
    def _needed(self) -> set[str]:
        noise = NOISES.get(self.noise)
        return {*self.oscillator.parameters, *noise.parameters, *noise.constants}

    @property
    def names(self) -> tuple[str, ...]:
        return tuple(self.priors)

    @property
    def live(self) -> tuple[str, ...]:
        """Names of what is inferred, without the coefficients that are 0 at every score."""
        return tuple(n for n, p in self.priors.items() if p != ABSENT)

    @property
    def layout(self) -> Layout:
        kinds = tuple(type(p) for p in self.priors.values())
        folded = tuple(p.folded for p in self.priors.values())
        return Layout(self.oscillator, self.noise, self.names, kinds, folded)

    def context(self, plan: Plan, part: slice = slice(None)) -> Context:
        """The numbers of this target with a plan made near the parameters of interest, for a part of its samples."""
        t, y = self.signal.t[part], self.signal.y[part]
        return Context(
            plan,
            jnp.asarray(y),
            jnp.asarray(np.diff(t)),
            {name: jnp.asarray(float(v)) for name, v in sorted(self.known.items()) if name in self._needed},
            tuple(tuple(jnp.asarray(float(x)) for x in p.numbers) for p in self.priors.values()),
            condense(self.layout.noise, plan, t, y),
        )

    def scores(self, values: Mapping[str, float]) -> np.ndarray:
        """Scores of parameter values, shape (d,), within ±6; what is not given is at its prior's centre."""
        z = [float(p.score(values[n])) if n in values else 0.5 * p.folded for n, p in self.priors.items()]
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

    def plan(self, z: np.ndarray, tolerance: float) -> tuple[Plan, float]:
        """A plan of the solver near the scores z, within `tolerance` (unit of the record), and its error."""
        values = self.all_values(z)
        return plan_with_error(self.oscillator, values, self.signal.t, self.signal.quantity, tolerance)

    @property
    def exact_friction(self) -> bool:
        """Whether ε is known to be 0."""
        return "epsilon" not in self.priors and is_exact(self.oscillator, {"epsilon": 1.0, **self.known})


def parameters(layout: Layout, context: Context, z: Array) -> dict[str, Array]:
    """Every parameter at the scores z."""
    inferred = {
        name: kind.transform(z[i], *context.numbers[i])
        for i, (name, kind) in enumerate(zip(layout.names, layout.kinds, strict=True))
    }
    return {**context.known, **inferred}


def residual(layout: Layout, context: Context, z: Array) -> Array:
    """Record minus trajectory, shape (n,)."""
    return context.y - record(layout.oscillator, context.plan, parameters(layout, context, z))


def misfit(layout: Layout, context: Context, p: Mapping[str, Array]) -> Array:
    """What the likelihood is a function of, shape (c,): the residuals or, condensed, what has their sums of squares."""
    if context.condensed is None or not isinstance(context.plan, MeshPlan):
        return context.y - record(layout.oscillator, context.plan, p)
    return context.condensed.misfit(nodes(layout.oscillator, context.plan.steps, context.plan.count, p))


def _noise(layout: Layout, context: Context) -> tuple[Callable[..., Array], Callable[..., Array]]:
    """Log density and root of the information, both of a misfit (c,) and the parameters."""
    noise, condensed = layout.noise, context.condensed
    if condensed is not None and isinstance(noise, NormalNoise):
        return partial(condensing.log_likelihood, noise, condensed), partial(
            condensing.information_root, noise, condensed
        )
    return (
        lambda e, p: noise.log_likelihood(e, context.gaps, p),
        lambda v, p: noise.information_root(v, context.gaps, p),
    )


def _log_noise(layout: Layout, context: Context, e: Array, z: Array) -> Array:
    """Log density of the record from its misfit, shape ()."""
    return _finite(_noise(layout, context)[0](e, parameters(layout, context, z)))


def _finite(density: Array) -> Array:
    return jnp.where(jnp.isfinite(density), density, -jnp.inf)


@dataclass(frozen=True)
class _Sums:
    """A likelihood that needs no more of a trajectory than sums of squares.

    sums: parameters to these by name; density: of these and the parameters, log density of the record.
    """

    sums: Callable[[Mapping[str, Array]], dict[str, Array]]
    density: Callable[[Mapping[str, Array], Mapping[str, Array]], Array]


def _sums(layout: Layout, context: Context) -> _Sums | None:
    """None where the likelihood reads all samples."""
    noise, condensed, plan = layout.noise, context.condensed, context.plan
    if condensed is None or not isinstance(noise, NormalNoise) or not isinstance(plan, MeshPlan):
        return None
    return _Sums(
        partial(condensed.sums_along, layout.oscillator, plan.steps, plan.count),
        partial(condensing.of_sums, noise, condensed),
    )


def log_likelihood(layout: Layout, context: Context, z: Array) -> Array:
    """Log density of the record in nats, shape (); −∞ where the trajectory escapes."""
    streamed = _sums(layout, context)
    if streamed is not None:
        p = parameters(layout, context, z)
        return _finite(streamed.density(streamed.sums(p), p))
    return _log_noise(layout, context, misfit(layout, context, parameters(layout, context, z)), z)


def log_prior(z: Array) -> Array:
    """Normalised log density of the scores, shape ()."""
    return -0.5 * jnp.sum(z**2) - 0.5 * z.size * LOG_2PI


def log_posterior(layout: Layout, context: Context, z: Array) -> Array:
    """Log prior plus log likelihood (not normalised), shape ()."""
    return log_prior(z) + log_likelihood(layout, context, z)


def moving_scores(layout: Layout) -> list[int]:
    """Indices of the scores that move the trajectory; the others are the noise's."""
    return [i for i, name in enumerate(layout.names) if name in layout.oscillator.parameters]


def moving_values(layout: Layout, context: Context, z: Array) -> Array:
    """Values of the inferred parameters that move the trajectory, shape (k,)."""
    p = parameters(layout, context, z)
    return jnp.stack([p[layout.names[i]] for i in moving_scores(layout)])


Line = tuple[Array, Array, Array]
"""Misfit (c,), its derivatives (k, c) by what moves the trajectory, and the values of that (k,)."""


def linearise(layout: Layout, context: Context, z: Array) -> Line:
    """The misfit and its derivatives by forward tangents: all that curvature and gradient need of the solver."""
    names = [layout.names[i] for i in moving_scores(layout)]
    p = parameters(layout, context, z)

    def fun(x: Array) -> Array:
        return misfit(layout, context, {**p, **dict(zip(names, x, strict=True))})

    x = moving_values(layout, context, z)
    push = jax.vmap(lambda v: jax.jvp(fun, (x,), (v,)), out_axes=(None, 0))
    e, slopes = push(jnp.eye(x.size))
    return e, slopes, x


@partial(jax.tree_util.register_dataclass, data_fields=["triangles", "at"], meta_fields=[])
@dataclass(frozen=True)
class TightLine:
    """What sums of squares need of a linearised trajectory.

    triangles: R (r, k + 1) by the name of a sum, which is |R (dx, 1)|² a step dx (k,) from the values `at` (k,).
    """

    triangles: Mapping[str, Array]
    at: Array


def tight(layout: Layout, context: Context, line: Line) -> Line | TightLine:
    """The linearisation in as few numbers as the likelihood allows."""
    if _sums(layout, context) is None or context.condensed is None:
        return line
    e, slopes, x = line
    columns = np.concatenate([np.asarray(slopes), np.asarray(e)[None]])
    parts = [context.condensed.split(column) for column in columns]
    triangles = {
        name: jnp.asarray(
            np.linalg.qr(np.stack([np.asarray(part[name]) for part in parts], axis=1), mode="r")
        )
        for name in parts[0]
    }
    return TightLine(triangles, x)


def linearised_log_posterior(layout: Layout, context: Context, line: Line | TightLine, z: Array) -> Array:
    """Log posterior with the trajectory replaced by its linearisation; priors and noise are exact."""
    if isinstance(line, TightLine):
        streamed = _sums(layout, context)
        assert streamed is not None
        by = jnp.append(moving_values(layout, context, z) - line.at, 1.0)
        sums = {name: jnp.sum((triangle @ by) ** 2) for name, triangle in line.triangles.items()}
        return log_prior(z) + streamed.density(sums, parameters(layout, context, z))
    e, slopes, x = line
    moved = e + (moving_values(layout, context, z) - x) @ slopes
    return log_prior(z) + _noise(layout, context)[0](moved, parameters(layout, context, z))


def _by_scores(layout: Layout, context: Context, line: Line, z: Array) -> tuple[Array, Array]:
    """Misfit (c,) and its derivatives by the scores that move the trajectory, shape (k, c)."""
    values = partial(moving_values, layout, context)
    slope = jax.jvp(values, (z,), (jnp.ones_like(z),))[1]  # each value is a function of its own score
    return line[0], slope[:, None] * line[1]


def value_and_gradient(layout: Layout, context: Context, z: Array) -> tuple[Array, Array]:
    """Log posterior and its gradient by z; the trajectory's part by forward tangents."""
    streamed = _sums(layout, context)
    if streamed is not None:
        return _streamed_gradient(layout, context, streamed, z)
    e, tangents = _by_scores(layout, context, linearise(layout, context, z), z)
    noise_part = jax.value_and_grad(partial(_log_noise, layout, context), argnums=(0, 1))
    value, (by_e, by_z) = noise_part(e, z)
    gradient = (by_z - z).at[jnp.asarray(moving_scores(layout), int)].add(tangents @ by_e)
    return value + log_prior(z), gradient


def _streamed_gradient(layout: Layout, context: Context, streamed: _Sums, z: Array) -> tuple[Array, Array]:
    """`value_and_gradient` of a likelihood that needs sums of squares alone."""
    moving = jnp.asarray(moving_scores(layout), int)

    def sums(moved: Array) -> dict[str, Array]:
        return streamed.sums(parameters(layout, context, z.at[moving].set(moved)))

    push = jax.vmap(lambda v: jax.jvp(sums, (z[moving],), (v,)), out_axes=(None, 0))
    found, slopes = push(jnp.eye(moving.size))
    density = jax.value_and_grad(
        lambda s, at: _finite(streamed.density(s, parameters(layout, context, at))), argnums=(0, 1)
    )
    value, (by_sum, by_z) = density(found, z)
    gradient = (by_z - z).at[moving].add(sum(by_sum[name] * slopes[name] for name in slopes))
    return value + log_prior(z), gradient


def curvature(layout: Layout, context: Context, line: Line, z: Array) -> tuple[Array, Array, Array]:
    """Log posterior, gradient (d,) and the Gauss–Newton information (d, d), the prior's identity included.

    line: what `linearise` gives at z.
    """
    e, tangents = _by_scores(layout, context, line, z)
    p = parameters(layout, context, z)
    noise_fun = partial(_log_noise, layout, context)
    value, (by_e, by_z) = jax.value_and_grad(noise_fun, argnums=(0, 1))(e, z)
    moving = jnp.asarray(moving_scores(layout), int)
    gradient = (by_z - z).at[moving].add(tangents @ by_e)
    root = _noise(layout, context)[1]
    roots = jax.vmap(lambda v: root(v, p))(tangents)
    # The noise parameters enter through few scalars: their exact curvature at a fixed misfit is cheap.
    still = [i for i in range(z.size) if i not in moving_scores(layout)]
    information = jnp.zeros((z.size, z.size)).at[jnp.ix_(moving, moving)].set(roots @ roots.T)
    if still:
        index = jnp.asarray(still, int)
        hessian = -jax.hessian(lambda zn: noise_fun(e, z.at[index].set(zn)))(z[index])
        lowest, vectors = jnp.linalg.eigh(0.5 * (hessian + hessian.T))
        positive = (vectors * jnp.maximum(lowest, 0.0)) @ vectors.T
        information = information.at[jnp.ix_(index, index)].set(positive)
    return value + log_prior(z), gradient, information + jnp.eye(z.size)


@dataclass(frozen=True)
class Compiled:
    """The functions of one layout, compiled once for all records of a shape.

    The solver is in two programs only, `linearise` and `batch`: compiling is most of what a short run costs.
    """

    linearise: Callable[[Context, Array], Line]
    curvature: Callable[[Context, Array], tuple[Array, Array, Array]]
    batch: Callable[[Context, Array], Array]
    tight: Callable[[Context, Array], Line | TightLine]
    linearised_batch: Callable[[Context, Line | TightLine, Array], Array]


@lru_cache(maxsize=64)
def compiled(layout: Layout) -> Compiled:
    """Compiled functions of a layout: (context, z) or, for batches, (context, z of shape (b, d))."""
    lines = jax.jit(partial(linearise, layout))
    curved = jax.jit(partial(curvature, layout))
    batch = jax.jit(jax.vmap(partial(log_posterior, layout), in_axes=(None, 0)))
    straight = jax.jit(jax.vmap(partial(linearised_log_posterior, layout), in_axes=(None, None, 0)))

    def curvature_at(context: Context, z: Array) -> tuple[Array, Array, Array]:
        return curved(context.lean, lines(context.lean, z), z)

    return Compiled(
        linearise=lambda context, z: lines(context.lean, z),
        curvature=curvature_at,
        tight=lambda context, z: tight(layout, context.lean, lines(context.lean, z)),
        batch=lambda context, z: batch(context.lean, z),
        linearised_batch=lambda context, line, z: straight(context.lean, line, z),
    )
