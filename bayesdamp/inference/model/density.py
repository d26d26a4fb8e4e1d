"""Log prior, likelihood and posterior of a target at its scores, and their gradient."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, TypeAlias

import numpy as np

from bayesdamp.inference.model import qr_compression as compression
from bayesdamp.inference.model.target import Context, Layout
from bayesdamp.inference.noise import NormalNoise
from bayesdamp.numerics.lazily import jnp
from bayesdamp.physics.solver.steps import MeshPlan, nodes
from bayesdamp.priors import SharedHalfNormal, shared_log_density, shared_precision

if TYPE_CHECKING:
    from jax import Array

Arrays: TypeAlias = "Mapping[str, Array]"
"""Arrays by name: parameters, or sums of squares."""

LOG_2PI, LOG_2 = float(np.log(2 * np.pi)), float(np.log(2.0))


def parameters(layout: Layout, context: Context, z: Array) -> dict[str, Array]:
    """Every parameter at the scores z."""
    inferred = {
        name: kind.transform(z[i], *context.numbers[i])
        for i, (name, kind) in enumerate(zip(layout.names, layout.kinds, strict=True))
    }
    return {**context.known, **inferred}


def residual(layout: Layout, context: Context, z: Array) -> Array:
    """Record minus trajectory, shape (n,)."""
    return context.y - context.plan.record(layout.oscillator, parameters(layout, context, z))


@dataclass(frozen=True)
class Streamed:
    """A likelihood that needs no more of a trajectory than sums of squares.

    sums: parameters to these by name; density: of these and the parameters, log density of the record.
    """

    sums: Callable[[Arrays], dict[str, Array]]
    density: Callable[[Arrays, Arrays], Array]


@dataclass(frozen=True)
class Reading:
    """How the likelihood reads a record.

    misfit: parameters to the residuals or, compressed, to what has their sums of squares, shape (c,); of_nodes: the
    same from the values at the solver's nodes, (m + 1, 3), a straight line in them, where its steps are the plan's own.
    density, root: of a misfit (c,) and the parameters, the log density of the record and a root of its information.
    streamed: the same from sums of squares alone, where the record is compressed.
    """

    misfit: Callable[[Arrays], Array]
    density: Callable[[Array, Arrays], Array]
    root: Callable[[Array, Arrays], Array]
    of_nodes: Callable[[Array], Array] | None = None
    streamed: Streamed | None = None


def reading(layout: Layout, context: Context) -> Reading:
    """The one place that knows whether a record is compressed."""
    noise, compressed, plan = layout.noise, context.compressed, context.plan
    if compressed is None or not isinstance(noise, NormalNoise) or not isinstance(plan, MeshPlan):
        return Reading(
            lambda p: context.y - plan.record(layout.oscillator, p),
            lambda e, p: noise.log_likelihood(e, context.gaps, p),
            lambda v, p: noise.information_root(v, context.gaps, p),
            (lambda state: context.y - plan.of_nodes(state)) if isinstance(plan, MeshPlan) else None,
        )
    return Reading(
        lambda p: compressed.misfit(nodes(layout.oscillator, plan.steps, plan.count, p)),
        partial(compression.log_likelihood, noise, compressed),
        partial(compression.information_root, noise, compressed),
        compressed.misfit,
        Streamed(
            partial(compressed.sums_along, layout.oscillator, plan.steps, plan.count),
            partial(compression.of_sums, noise, compressed),
        ),
    )


def log_noise(layout: Layout, context: Context, e: Array, z: Array) -> Array:
    """Log density of the record from its misfit, shape ()."""
    return finite(reading(layout, context).density(e, parameters(layout, context, z)))


def finite(density: Array) -> Array:
    """The log density, −∞ where it is not a number."""
    return jnp.where(jnp.isfinite(density), density, -jnp.inf)


def log_likelihood(layout: Layout, context: Context, z: Array) -> Array:
    """Log density of the record in nats, shape (); −∞ where the trajectory escapes."""
    read, p = reading(layout, context), parameters(layout, context, z)
    if read.streamed is not None:
        return finite(read.streamed.density(read.streamed.sums(p), p))
    return log_noise(layout, context, read.misfit(p), z)


def _shared(layout: Layout, context: Context) -> tuple[Array, Array] | None:
    """Indices of the coefficients of a kind that shares a scale, (m,), and which of them are present, (m,) of bool;
    None where no coefficient is of this kind."""
    places = [i for i, kind in enumerate(layout.kinds) if kind is SharedHalfNormal]
    if not places:
        return None
    return jnp.asarray(places, int), jnp.stack([context.numbers[i][0] > 0 for i in places])


def log_prior(layout: Layout, context: Context, z: Array) -> Array:
    """Log density of the scores, shape (); of reflected ones as if they could have either sign."""
    normal = -0.5 * jnp.sum(z**2) - 0.5 * z.size * LOG_2PI
    found = _shared(layout, context)
    if found is None:
        return normal
    places, present = found
    count, squares = jnp.sum(present), jnp.sum(jnp.where(present, z[places] ** 2, 0.0))
    both_signs = shared_log_density(squares, count, context.scales) - count * LOG_2
    return normal + 0.5 * squares + 0.5 * count * LOG_2PI + both_signs


def prior_precision(layout: Layout, context: Context, z: Array) -> Array:
    """What each score is multiplied by to give minus the slope of its log prior, (d,).

    It is also a curvature that the log prior nowhere exceeds: that of the normal which touches it at z from below.
    """
    found = _shared(layout, context)
    if found is None:
        return jnp.ones(z.size)
    places, present = found
    count, squares = jnp.sum(present), jnp.sum(jnp.where(present, z[places] ** 2, 0.0))
    own = jnp.where(present, shared_precision(squares, count, context.scales), 1.0)
    return jnp.ones(z.size).at[places].set(own)


def log_posterior(layout: Layout, context: Context, z: Array) -> Array:
    """Log prior plus log likelihood (not normalised), shape ()."""
    return log_prior(layout, context, z) + log_likelihood(layout, context, z)


def moving_scores(layout: Layout) -> list[int]:
    """Indices of the scores that move the trajectory; the others are the noise's."""
    return [i for i, name in enumerate(layout.names) if name in layout.oscillator.parameters]


def moving_values(layout: Layout, context: Context, z: Array) -> Array:
    """Values of the inferred parameters that move the trajectory, shape (k,)."""
    p = parameters(layout, context, z)
    return jnp.stack([p[layout.names[i]] for i in moving_scores(layout)])
