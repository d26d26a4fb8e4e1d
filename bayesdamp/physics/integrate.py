"""Trajectories read off at the times of a record.

The solver's steps and the samples are two grids: a `Plan` holds the steps, frozen at reference parameters,
and where each sample lies in them. `record` is a pure function of plan and parameters: jit, vmap and forward
tangents work on it.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache, partial

import jax
import numpy as np
from jax import Array
from jax import numpy as jnp

from bayesdamp.physics import friction
from bayesdamp.physics.hermite import basis
from bayesdamp.physics.mesh import frozen_mesh
from bayesdamp.physics.oscillator import Oscillator, Parameters
from bayesdamp.physics.stepper import step
from bayesdamp.physics.tableau import ORDER

FIRST_RESOLUTION = 0.6
QUANTITIES = ("angle", "velocity", "acceleration")


LEAST_ROOM = 1024


@partial(
    jax.tree_util.register_dataclass, data_fields=["steps", "count", "interval", "weights"], meta_fields=[]
)
@dataclass(frozen=True)
class MeshPlan:
    """Steps in s, the first `count` of an array (room,); each sample's step and dense-output weights, (n,), (n, 6).

    The room is a power of four: meshes of many sizes share one compiled program.
    """

    steps: Array
    count: Array
    interval: Array
    weights: Array


Plan = MeshPlan | friction.TurningPlan


def _mesh_plan(nodes: np.ndarray, times: np.ndarray, quantity: str, room: int) -> MeshPlan:
    interval = np.clip(np.searchsorted(nodes, times, side="right") - 1, 0, nodes.size - 2)
    h = np.diff(nodes)
    weights = basis(
        jnp.asarray((times - nodes[interval]) / h[interval]),
        jnp.asarray(h[interval]),
        QUANTITIES.index(quantity),
    )
    steps = np.zeros(room)
    steps[: h.size] = h
    return MeshPlan(jnp.asarray(steps), jnp.asarray(h.size), jnp.asarray(interval), weights)


def nodes(osc: Oscillator, plan: MeshPlan, p: Parameters) -> Array:
    """θ, θ̇, θ̈ at the nodes, shape (room + 1, 3), zero behind the last. Forward tangents work, reverse ones do not."""

    def acceleration(theta: Array, omega: Array) -> Array:
        return osc.acceleration(theta, omega, p)

    def advance(i, carry):
        theta, omega, found = carry
        new_theta, new_omega, before = step(acceleration, plan.steps[i], theta, omega)
        return new_theta, new_omega, found.at[i].set(jnp.stack([theta, omega, before]))

    start = (jnp.asarray(p["theta0"], float), jnp.asarray(p["omega0"], float))
    empty = jnp.zeros((plan.steps.size + 1, 3))
    theta, omega, found = jax.lax.fori_loop(0, plan.count, advance, (*start, empty))
    return found.at[plan.count].set(jnp.stack([theta, omega, acceleration(theta, omega)]))


def node_pairs(osc: Oscillator, plan: MeshPlan, p: Parameters) -> Array:
    """θ, θ̇, θ̈ at the left and at the right end of each step, shape (m, 6)."""
    state = nodes(osc, plan, p)
    return jnp.concatenate([state[:-1], state[1:]], axis=1)


def record(osc: Oscillator, plan: Plan, p: Parameters) -> Array:
    """The planned quantity at the samples, shape (n,), in rad, rad/s or rad/s².

    Not finite where the trajectory escapes.
    """
    if isinstance(plan, friction.TurningPlan):
        return friction.record(osc, plan, p)
    state = nodes(osc, plan, p)
    pair = jnp.concatenate([state[plan.interval], state[plan.interval + 1]], axis=1)
    return jnp.sum(pair * plan.weights, axis=1)


@lru_cache(maxsize=128)
def compiled_record(osc: Oscillator):
    """`record` of one oscillator, compiled once per shape of plan: (plan, parameters) -> samples."""
    return jax.jit(partial(record, osc))


def is_exact(osc: Oscillator, p: Parameters) -> bool:
    """Whether friction is the sign itself: ε = 0 and a term that switches."""
    return osc.switches and float(p["epsilon"]) == 0.0


def make_plan(
    osc: Oscillator,
    p: Parameters,
    times: np.ndarray,
    quantity: str = "angle",
    tolerance: float = 1e-8,
) -> Plan:
    """A plan for parameters near `p` whose trajectory is within `tolerance` of the exact one at `p`.

    times: the samples in s, shape (n,), not decreasing; the motion starts with theta0, omega0 at times[0].
    tolerance: largest error in the unit of the quantity; steps are shortened until halving them shows less.
    """
    return plan_with_error(osc, p, times, quantity, tolerance)[0]


def plan_with_error(
    osc: Oscillator,
    p: Parameters,
    times: np.ndarray,
    quantity: str = "angle",
    tolerance: float = 1e-8,
) -> tuple[Plan, float]:
    """`make_plan`, and the largest difference that halving its steps makes at `p`, shape ()."""
    times = np.asarray(times, float) - float(times[0])
    p = {name: jnp.asarray(float(p[name])) for name in osc.parameters}
    run = compiled_record(osc)
    resolution, best = FIRST_RESOLUTION, None
    order = ORDER - QUANTITIES.index(quantity)  # each derivative of the dense output costs one
    for _ in range(6):
        coarse, fine = _pair(osc, p, times, quantity, resolution)
        change = float(jnp.max(jnp.abs(run(coarse, p) - run(fine, p))))
        if not np.isfinite(change) or change <= tolerance:
            return coarse, change
        if best is not None and change > 0.5 * best[1]:
            break  # rounding has been reached
        finer = change / 2 ** (order - 1)
        best = (fine, finer) if best is None or finer < best[1] else best
        resolution *= min(max(1.1 * (change / tolerance) ** (1 / order), 1.15), 4.0)
    assert best is not None
    return best


def _pair(
    osc: Oscillator, p: Parameters, times: np.ndarray, quantity: str, resolution: float
) -> tuple[Plan, Plan]:
    if is_exact(osc, p):
        make = partial(friction.turning_plan, osc, p, times, quantity)
        return make(resolution), make(2 * resolution)
    mesh = frozen_mesh(osc, p, max(float(times[-1]), 1e-300), resolution)
    halved = np.empty(2 * mesh.size - 1)
    halved[::2], halved[1::2] = mesh, 0.5 * (mesh[:-1] + mesh[1:])
    room = max(LEAST_ROOM, 4 ** math.ceil(math.log(halved.size, 4)))
    return _mesh_plan(mesh, times, quantity, room), _mesh_plan(halved, times, quantity, room)


def simulate(
    osc: Oscillator,
    p: Parameters,
    times: np.ndarray,
    quantity: str = "angle",
    tolerance: float = 1e-9,
) -> np.ndarray:
    """The oscillator's record at `times` (s, shape (n,)), started with theta0, omega0 at times[0].

    Raises ValueError where a parameter is missing or the quantity unknown.
    """
    missing = [name for name in osc.parameters if name not in p]
    if missing:
        raise ValueError(f"parameter {missing[0]!r} is missing; needed are {', '.join(osc.parameters)}")
    if quantity not in QUANTITIES:
        raise ValueError(f"quantity {quantity!r} is none of {', '.join(QUANTITIES)}")
    plan = make_plan(osc, p, times, quantity, tolerance)
    return np.asarray(compiled_record(osc)(plan, {n: jnp.asarray(float(p[n])) for n in osc.parameters}))
