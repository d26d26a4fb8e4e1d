"""The trajectory as a straight line around some scores, and the posterior with it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, TypeAlias

import numpy as np

from bayesdamp.inference.model.density import log_prior, moving_scores, moving_values, parameters, reading
from bayesdamp.inference.model.target import Context, Layout
from bayesdamp.numerics.lazily import jax, jnp, tree
from bayesdamp.physics.solver.steps import MeshPlan, nodes_and_slopes
from bayesdamp.physics.solver.tangents import with_slopes

if TYPE_CHECKING:
    from jax import Array

Line: TypeAlias = "tuple[Array, Array, Array]"
"""Misfit (c,), its derivatives (k, c) by what moves the trajectory, and the values of that (k,)."""


def linearise(layout: Layout, context: Context, z: Array) -> Line:
    """The misfit and its derivatives by forward tangents: all that curvature and gradient need of the solver."""
    plan = context.plan
    p, x = moving(layout, context, z)
    names = moving_names(layout)
    if isinstance(plan, MeshPlan):
        solved = nodes_and_slopes(layout.oscillator, names, plan.steps, plan.count, p)
        return *misfits(layout, context, *solved), x
    found, slopes = with_slopes(lambda q: plan.record(layout.oscillator, q), names, p)
    return context.y - found, -slopes, x


def moving_names(layout: Layout) -> tuple[str, ...]:
    """Names of the inferred parameters that move the trajectory."""
    return tuple(layout.names[i] for i in moving_scores(layout))


def moving(layout: Layout, context: Context, z: Array) -> tuple[dict[str, Array], Array]:
    """What the solver needs, by name, and of it the values of the inferred parameters, shape (k,)."""
    p = parameters(layout, context, z)
    return {name: p[name] for name in layout.oscillator.inputs}, moving_values(layout, context, z)


def misfits(layout: Layout, context: Context, states: Array, slopes: Array) -> tuple[Array, Array]:
    """The misfit (c,) and its derivatives (k, c) from the values at the nodes (m + 1, 3) and theirs (k, m + 1, 3)."""
    of_nodes = reading(layout, context).of_nodes
    assert of_nodes is not None
    return jax.vmap(lambda v: jax.jvp(of_nodes, (states,), (v,)), out_axes=(None, 0))(slopes)


@tree(["triangles", "at"])
@dataclass(frozen=True)
class TightLine:
    """What sums of squares need of a linearised trajectory.

    triangles: R (r, k + 1) by the name of a sum, which is |R (dx, 1)|² a step dx (k,) from the values `at` (k,).
    """

    triangles: Mapping[str, Array]
    at: Array


def tight(layout: Layout, context: Context, line: Line) -> Line | TightLine:
    """The linearisation in as few numbers as the likelihood allows."""
    if reading(layout, context).streamed is None or context.compressed is None:
        return line
    e, slopes, x = line
    columns = np.concatenate([np.asarray(slopes), np.asarray(e)[None]])
    parts = [context.compressed.split(column) for column in columns]
    triangles = {
        name: jax.device_put(
            np.linalg.qr(np.stack([np.asarray(part[name]) for part in parts], axis=1), mode="r")
        )
        for name in parts[0]
    }
    return TightLine(triangles, x)


def linearised_log_posterior(layout: Layout, context: Context, line: Line | TightLine, z: Array) -> Array:
    """Log posterior with the trajectory replaced by its linearisation; priors and noise are exact."""
    read = reading(layout, context)
    if isinstance(line, TightLine):
        assert read.streamed is not None
        by = jnp.append(moving_values(layout, context, z) - line.at, 1.0)
        sums = {name: jnp.sum((triangle @ by) ** 2) for name, triangle in line.triangles.items()}
        return log_prior(layout, context, z) + read.streamed.density(sums, parameters(layout, context, z))
    e, slopes, x = line
    moved = e + (moving_values(layout, context, z) - x) @ slopes
    return log_prior(layout, context, z) + read.density(moved, parameters(layout, context, z))


def by_scores(layout: Layout, context: Context, line: Line, z: Array) -> tuple[Array, Array]:
    """Misfit (c,) and its derivatives by the scores that move the trajectory, shape (k, c)."""
    values = partial(moving_values, layout, context)
    slope = jax.jvp(values, (z,), (jnp.ones_like(z),))[1]  # each value is a function of its own score
    return line[0], slope[:, None] * line[1]
