"""What is compiled of a layout, once for all records of a shape."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import lru_cache, partial
from typing import TYPE_CHECKING, TypeAlias

import numpy as np

from bayesdamp.inference.model.density import log_posterior
from bayesdamp.inference.model.gradient import curvature
from bayesdamp.inference.model.linearised import (
    Line,
    TightLine,
    linearised_log_posterior,
    misfits,
    moving,
    moving_names,
    tight,
)
from bayesdamp.inference.model.qr_compression import capacity_of
from bayesdamp.inference.model.target import Context, Layout
from bayesdamp.machine.programs import Program
from bayesdamp.numerics.lazily import jax, jnp
from bayesdamp.physics.oscillator import Oscillator
from bayesdamp.physics.solver.steps import MeshPlan, nodes_and_slopes

if TYPE_CHECKING:
    from jax import Array

Scores: TypeAlias = "Array | np.ndarray"
"""Normal scores, (d,) or, for batches, (b, d)."""


@dataclass(frozen=True)
class Compiled:
    """The functions of one layout, compiled once for all records of a shape.

    The solver is in two programs only, `batch` and one that all noise models, and records of all lengths, share
    (`linearise`): compiling is most of what a short run costs.
    """

    linearise: Callable[[Context, Scores], Line]
    curvature: Callable[[Context, Scores], tuple[Array, Array, Array]]
    batch: Callable[[Context, Scores], Array]
    tight: Callable[[Context, Scores], Line | TightLine]
    linearised_batch: Callable[[Context, Line | TightLine, Scores], Array]


@lru_cache(maxsize=64)
def compiled(layout: Layout) -> Compiled:
    """Compiled functions of a layout: (context, z) or, for batches, (context, z of shape (b, d))."""
    lines = _lines(layout)
    curved = Program(partial(curvature, layout), "curvature", layout)
    many = jax.vmap(partial(log_posterior, layout), in_axes=(None, 0))
    batch = Program(many, "log_posterior", layout)
    along = jax.vmap(partial(linearised_log_posterior, layout), in_axes=(None, None, 0))
    straight = Program(along, "linearised_log_posterior", layout)

    def curvature_at(context: Context, z: Scores) -> tuple[Array, Array, Array]:
        line = lines(context.compact, z)
        # The trajectory is there already: parts of a record share the program.
        compact = context.compact
        return curved(replace(compact, plan=compact.plan.whole), line, z)

    return Compiled(
        linearise=lambda context, z: lines(context.compact, z),
        curvature=curvature_at,
        tight=lambda context, z: tight(layout, context.compact, lines(context.compact, z)),
        batch=lambda context, z: _in_parts(batch, context.compact, z),
        linearised_batch=lambda context, line, z: straight(context.compact, line, z),
    )


def _in_parts(batch: Callable[[Context, Scores], Array], context: Context, z: Scores) -> Array:
    """A batch; where each motion keeps all its cycles for a while, a few at a time."""
    together = context.plan.together
    if together is None:
        return batch(context, z)
    padded = np.pad(np.asarray(z), ((0, -len(z) % together), (0, 0)), mode="edge")
    found = [np.asarray(batch(context, part)) for part in np.split(padded, len(padded) // together)]
    return jnp.asarray(np.concatenate(found)[: len(z)])


def _lines(layout: Layout) -> Callable[[Context, Scores], Line]:
    """`linearise`, in parts: the solver's depends on the oscillator and on what is inferred of it alone."""
    names = moving_names(layout)
    values = Program(partial(moving, layout), "moving", layout)
    solver = _solver(layout.oscillator, names)
    misfit = Program(partial(misfits, layout), "misfits", layout)

    def line(context: Context, z: Scores) -> Line:
        plan = context.plan
        p, x = values(context, z)
        if not isinstance(plan, MeshPlan):
            found, slopes = plan.record_and_slopes(layout.oscillator, names, p)
            return context.y - found, -slopes, x
        steps = np.asarray(plan.steps)[: capacity_of(plan)]
        return *misfit(context, *solver(steps, plan.count, p)), x

    return line


@lru_cache(maxsize=64)
def _solver(osc: Oscillator, names: tuple[str, ...]) -> Program:
    return Program(partial(nodes_and_slopes, osc, names), "nodes_and_slopes", osc, names)
