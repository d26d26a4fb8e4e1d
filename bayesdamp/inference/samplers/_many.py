"""NUTS over many records of one shape in one call of a compiled program."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import replace
from functools import lru_cache
from typing import Any

import jax
import numpy as np
from jax import numpy as jnp

from bayesdamp.inference.coordinates.frame import Frame, frame
from bayesdamp.inference.fit.mode import Mode
from bayesdamp.inference.model.target import Context, Layout, Target
from bayesdamp.inference.samplers import nuts
from bayesdamp.inference.samplers._sampler import Settings
from bayesdamp.machine.programs import Program
from bayesdamp.physics.solver.steps import MeshPlan
from bayesdamp.types import Posterior

BATCH = 16
"""Records in one call; fewer are filled up with repeats, so that one program serves."""
LEAST = 4
"""Fewer records than this are sampled one by one."""


def sample_many(
    targets: Sequence[Target], modes: Sequence[Mode], settings: Settings, seeds: Sequence[int]
) -> list[Posterior]:
    """`nuts` on many records, seeds: one for each in place of the settings'. The posteriors in the records' order.

    Records of one layout (of as many samples, where the likelihood reads them) go through one compiled program,
    `BATCH` at a time. Whatever is not good enough there, or does not fit in, is sampled by itself.
    """
    found: list[Posterior | None] = [None] * len(targets)
    groups: dict[object, list[tuple[int, Frame]]] = {}
    for i, (target, mode) in enumerate(zip(targets, modes, strict=True)):
        at = frame(target, mode)
        if at.good and isinstance(mode.context.plan, MeshPlan):
            groups.setdefault((target.layout, _kind(mode.context.lean)), []).append((i, at))
    for members in groups.values():
        for first in range(0, len(members), BATCH):
            part = members[first : first + BATCH]
            if len(part) < LEAST:
                continue
            began = time.perf_counter()
            own = [nuts.inputs(targets[i], modes[i], at, replace(settings, seed=seeds[i])) for i, at in part]
            many = _run(targets[part[0][0]].layout, settings, [given for given, _ in own])
            share = (time.perf_counter() - began) / len(part)
            for (i, at), (given, begun), left in zip(part, own, many):
                began = time.perf_counter()
                run = nuts.Run(at, False, settings.warmup, begun, given, left)
                # The random numbers of another attempt are its own: whether there is one does not choose among draws.
                again = replace(settings, seed=seeds[i] + 1)
                posterior = nuts.PLUGIN.finished(targets[i], modes[i], again, run)
                found[i] = replace(posterior, seconds=share + time.perf_counter() - began)
    return [
        posterior or nuts.PLUGIN.sample(target, mode, replace(settings, seed=seed))
        for posterior, target, mode, seed in zip(found, targets, modes, seeds, strict=True)
    ]


def _kind(context: Context) -> object:
    """What contexts must share to be stacked: the samples, where these are kept."""
    leaves, tree = jax.tree.flatten(context)
    return tree, None if context.condensed is not None else tuple(np.shape(leaf) for leaf in leaves)


def stacked(contexts: Sequence[Context]) -> Context:
    """Contexts of one kind as one with a first axis more; the number of steps is the largest of all, without it.

    So the solver's loop has one end for all records: steps behind a record's own are of length zero.
    """
    lean = [c.lean for c in contexts]
    room = max(c.condensed.room if c.condensed is not None else 0 for c in lean)
    both = jax.tree.map(lambda *leaves: jnp.stack(leaves), *(c.in_room(room) for c in lean))
    assert isinstance(both.plan, MeshPlan)
    return replace(both, plan=replace(both.plan, count=jnp.max(both.plan.count)))


def axes(context: Context) -> Context:
    """What `vmap` is to know of such a context."""
    over: Context = jax.tree.map(lambda _: 0, context)
    assert isinstance(over.plan, MeshPlan)
    return replace(over, plan=replace(over.plan, count=None))


def _run(layout: Layout, settings: Settings, own: list[tuple[Any, ...]]) -> list[tuple[np.ndarray, ...]]:
    """What the chains leave, by record, from what `nuts.inputs` gives of each."""
    filled = own + [own[0]] * (BATCH - len(own))
    context = stacked([given[0] for given in filled])
    rest = jax.tree.map(lambda *leaves: jnp.stack(leaves), *(given[1:] for given in filled))
    program = _program(layout, settings.warmup + settings.draws, jax.tree.structure(context))
    found = jax.tree.map(np.asarray, program(context, *rest))
    return [tuple(values[i] for values in found) for i in range(len(own))]


@lru_cache(maxsize=32)
def _program(layout: Layout, count: int, tree: Any):
    """Compiled: every argument has one axis more than in `nuts.chain_of`, but for the number of steps."""
    over = axes(jax.tree.unflatten(tree, [0] * tree.num_leaves))
    chains = jax.vmap(nuts.chain_of(layout, count, False), in_axes=(None,) * 4 + (0, 0, 0))
    return Program(jax.vmap(chains, in_axes=(over, *(0,) * 6)), "nuts_of_many", layout, count, str(tree))
