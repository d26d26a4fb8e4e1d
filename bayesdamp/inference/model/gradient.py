"""Gradient and curvature of the log posterior, the trajectory's part by forward tangents."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING

from bayesdamp.inference.model.density import (
    Streamed,
    finite,
    log_noise,
    log_prior,
    moving_scores,
    parameters,
    prior_precision,
    reading,
)
from bayesdamp.inference.model.linearised import Line, by_scores, linearise
from bayesdamp.inference.model.target import Context, Layout
from bayesdamp.numerics.lazily import jax, jnp

if TYPE_CHECKING:
    from jax import Array


def value_and_gradient(layout: Layout, context: Context, z: Array) -> tuple[Array, Array]:
    """Log posterior and its gradient by z; the trajectory's part by forward tangents."""
    streamed = reading(layout, context).streamed
    if streamed is not None:
        return _streamed_gradient(layout, context, streamed, z)
    e, tangents = by_scores(layout, context, linearise(layout, context, z), z)
    noise_part = jax.value_and_grad(partial(log_noise, layout, context), argnums=(0, 1))
    value, (by_e, by_z) = noise_part(e, z)
    gradient = (
        (by_z - prior_precision(layout, context, z) * z)
        .at[jnp.asarray(moving_scores(layout), int)]
        .add(tangents @ by_e)
    )
    return value + log_prior(layout, context, z), gradient


def _streamed_gradient(layout: Layout, context: Context, streamed: Streamed, z: Array) -> tuple[Array, Array]:
    """`value_and_gradient` of a likelihood that needs sums of squares alone."""
    moving = jnp.asarray(moving_scores(layout), int)

    def sums(moved: Array) -> dict[str, Array]:
        return streamed.sums(parameters(layout, context, z.at[moving].set(moved)))

    push = jax.vmap(lambda v: jax.jvp(sums, (z[moving],), (v,)), out_axes=(None, 0))
    found, slopes = push(jnp.eye(moving.size))
    density = jax.value_and_grad(
        lambda s, at: finite(streamed.density(s, parameters(layout, context, at))), argnums=(0, 1)
    )
    value, (by_sum, by_z) = density(found, z)
    gradient = (
        (by_z - prior_precision(layout, context, z) * z)
        .at[moving]
        .add(sum(by_sum[name] * slopes[name] for name in slopes))
    )
    return value + log_prior(layout, context, z), gradient


def curvature(layout: Layout, context: Context, line: Line, z: Array) -> tuple[Array, Array, Array]:
    """Log posterior, gradient (d,) and the Gauss–Newton information (d, d), the prior's included.

    line: what `linearise` gives at z.
    """
    e, tangents = by_scores(layout, context, line, z)
    p = parameters(layout, context, z)
    noise_fun = partial(log_noise, layout, context)
    value, (by_e, by_z) = jax.value_and_grad(noise_fun, argnums=(0, 1))(e, z)
    moving = jnp.asarray(moving_scores(layout), int)
    precision = prior_precision(layout, context, z)
    gradient = (by_z - precision * z).at[moving].add(tangents @ by_e)
    root = reading(layout, context).root
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
    return value + log_prior(layout, context, z), gradient, information + jnp.diag(precision)
