"""The second stage for many records of one clock at once, such as the repeats of a study."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import jax
import numpy as np
from jax import Array
from jax import numpy as jnp

from bayesdamp.estimators.refine import refine
from bayesdamp.estimators.shared import free_names, oscillator
from bayesdamp.physics.integrate import make_plan
from bayesdamp.physics.oscillator import Oscillator
from bayesdamp.types import Estimate, Problem, Refusal, Signal

ROUNDS = 8
CHUNK = 100
TOLERANCE = 1e-8
"""Largest error of a trajectory, as a share of the record's largest value."""
SETTLED = 1e-3
"""A fit has settled where its last step is below this share of its standard errors."""


@dataclass(frozen=True)
class Batch:
    """Least-squares fits of m records: names; values, stderr (m, k); settled (m,), whether each converged."""

    names: tuple[str, ...]
    values: np.ndarray
    stderr: np.ndarray
    settled: np.ndarray


@lru_cache(maxsize=16)
def _steps(osc: Oscillator, names: tuple[str, ...]):
    """Compiled Gauss–Newton steps of many records: (x (b, k), y (b, n), plan, rest) to steps and variances."""

    def one(x: Array, y: Array, plan, rest):
        def samples(x: Array) -> Array:
            return plan.record(osc, {**rest, **dict(zip(names, x))})

        value, push = jax.linearize(samples, x)
        j = jax.vmap(push)(jnp.eye(len(names)))
        scale = jnp.linalg.norm(j, axis=1)
        gram = (j / scale[:, None]) @ (j / scale[:, None]).T
        r = y - value
        move = jnp.linalg.solve(gram, (j @ r) / scale) / scale
        variance = jnp.diag(jnp.linalg.inv(gram)) / scale**2 * (r @ r) / (y.size - x.size)
        return move, variance

    return jax.jit(jax.vmap(one, in_axes=(0, 0, None, None)))


def refine_batch(signal: Signal, y: np.ndarray, problem: Problem, first: Estimate) -> Batch:
    """Trajectory fits to records y (m, n) on the clock of `signal`, which is one of them.

    The search starts for all where `refine` ends on `signal` itself, started at `first`; Gauss–Newton, coefficients
    of damping never below zero, on steps of the solver that all records share: they must be of one system.
    Raises Refusal where the record's own fit fails.
    """
    start = refine(signal, problem, first)
    osc = oscillator(problem)
    names = (*osc.coefficients, *free_names(problem))
    if set(start.values) != set(names):
        raise Refusal(f"the first record has no fit to start from: {start.outcome}")
    p = {**problem.system.known, **start.values}
    rest = {n: jnp.asarray(float(p[n])) for n in osc.parameters if n not in names}
    whole = {n: float(p[n]) for n in osc.parameters}
    plan = make_plan(osc, whole, signal.t, signal.quantity, TOLERANCE * float(np.abs(y).max()))
    floor = np.array([0.0 if n in osc.coefficients else -np.inf for n in names])
    run = _steps(osc, names)

    count, centre = len(y), np.array([start.values[n] for n in names])
    padded = np.concatenate([y, np.repeat(y[:1], -count % CHUNK, axis=0)])
    values, errors, settled = [], [], []
    for part in np.split(padded, len(padded) // CHUNK):
        x = np.tile(centre, (CHUNK, 1))
        sd = last = np.full_like(x, np.inf)
        for _ in range(ROUNDS):
            move, variance = map(np.asarray, run(jnp.asarray(x), jnp.asarray(part), plan, rest))
            new = np.maximum(x + move, floor)
            x, last, sd = new, np.abs(new - x), np.sqrt(variance)
            if np.all(last <= SETTLED * sd):
                break
        values.append(x)
        errors.append(sd)
        settled.append(np.all(last <= SETTLED * sd, axis=1))
    joined = [np.concatenate(found)[:count] for found in (values, errors, settled)]
    return Batch(names, *joined)
