"""The likelihood as a function of the parameters themselves, in natural units, rather than of their scores."""

from __future__ import annotations

from collections.abc import Callable
from functools import lru_cache, partial

import jax
from jax import Array
from jax import numpy as jnp

from bayesdamp.inference.model.density import finite, reading
from bayesdamp.inference.model.target import Context, Layout
from bayesdamp.machine.programs import Program


def log_likelihood(layout: Layout, context: Context, x: Array) -> Array:
    """Log density of the record in nats, shape (), at parameters x, (d,), in the order of the layout's names; −∞ where
    the trajectory escapes. Priors have no say: x may lie outside their support."""
    p = {**context.known, **dict(zip(layout.names, x, strict=True))}
    read = reading(layout, context)
    if read.streamed is not None:
        return finite(read.streamed.density(read.streamed.sums(p), p))
    return finite(read.density(read.misfit(p), p))


def value_and_slopes(layout: Layout, context: Context, x: Array) -> tuple[Array, Array]:
    """`log_likelihood` and its gradient by x, (d,), by forward tangents; the gradient is 0 where the former is −∞."""
    push = jax.vmap(
        lambda v: jax.jvp(partial(log_likelihood, layout, context), (x,), (v,)), out_axes=(None, 0)
    )
    value, slopes = push(jnp.eye(x.size))
    return value, jnp.where(jnp.isfinite(value) & jnp.isfinite(slopes), slopes, 0.0)


@lru_cache(maxsize=64)
def compiled_values(layout: Layout) -> Program:
    """(context, x of shape (m, d)) to log likelihoods, (m,)."""
    return Program(
        jax.vmap(partial(log_likelihood, layout), in_axes=(None, 0)), "natural_log_likelihood", layout
    )


@lru_cache(maxsize=64)
def compiled_slopes(layout: Layout) -> Program:
    """(context, x of shape (d,)) to log likelihood and gradient."""
    return Program(partial(value_and_slopes, layout), "natural_slopes", layout)


def differentiable(layout: Layout, context: Context) -> Callable[[Array], Array]:
    """`log_likelihood` of x alone for programs of others: `jax.grad` works on it, though solvers know forward tangents
    only. The derivative is a straight line in the tangents, and that JAX turns round by itself."""

    @jax.custom_jvp
    def density(x: Array) -> Array:
        return log_likelihood(layout, context, x)

    @density.defjvp
    def _(primals: tuple[Array], tangents: tuple[Array]) -> tuple[Array, Array]:
        value, slopes = value_and_slopes(layout, context, primals[0])
        return value, slopes @ tangents[0]

    return density
