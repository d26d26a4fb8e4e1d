"""Trajectories read off at the times of a record.

The solver's steps and the samples are two grids: a `Plan` holds the steps, frozen at reference parameters,
and where each sample lies in them. `record` is a pure function of plan and parameters: jit, vmap and forward
tangents work on it.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache, partial
from typing import TypeVar

import jax
import numpy as np
from jax import Array
from jax import numpy as jnp
from scipy.sparse import csr_array

from bayesdamp.physics import cycles, friction
from bayesdamp.physics.hermite import basis
from bayesdamp.physics.mesh import frozen_mesh
from bayesdamp.physics.oscillator import Oscillator, Parameters
from bayesdamp.physics.stepper import step
from bayesdamp.physics.tableau import ORDER
from bayesdamp.programs import Program

FIRST_RESOLUTION = 0.6
ENOUGH = 20_000
"""Samples at which the error of a plan is looked at; of more, that many spread over the record."""
QUANTITIES = ("angle", "velocity", "acceleration")


C = TypeVar("C")
LEAST_ROOM = 1024
NODES_ROOM = 4096
"""Room in which single trajectories are computed, so that a plan and its refinements share a program."""
TOGETHER = 32
"""Trajectories that are solved side by side."""


@partial(jax.tree_util.register_dataclass, data_fields=["nodes", "defect"], meta_fields=[])
@dataclass(frozen=True)
class Anchor:
    """What a plan knows of one trajectory: its values at the nodes, (room + 1, 3), and what the samples lack there
    by the length of the steps, (n,)."""

    nodes: Array
    defect: Array


@partial(
    jax.tree_util.register_dataclass,
    data_fields=["steps", "count", "interval", "weights", "anchor"],
    meta_fields=[],
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
    anchor: Anchor | None = None


Plan = MeshPlan | friction.TurningPlan | cycles.CyclePlan
Node = tuple[Array, Array, Array]
"""θ, θ̇ and θ̈ between two steps."""


def _mesh_plan(nodes: np.ndarray, times: np.ndarray, quantity: str, parts: int = 1) -> MeshPlan:
    """parts: into how many its steps will be divided in the same room."""
    interval = np.clip(np.searchsorted(nodes, times, side="right") - 1, 0, nodes.size - 2)
    h = np.diff(nodes)
    weights = basis(
        (times - nodes[interval]) / h[interval],
        h[interval],
        QUANTITIES.index(quantity),
    )
    steps = np.zeros(max(LEAST_ROOM, 4 ** math.ceil(math.log(parts * h.size, 4))))
    steps[: h.size] = h
    steps, count, interval = jax.device_put((steps, np.asarray(h.size), interval))
    return MeshPlan(steps, count, interval, weights)


@lru_cache(maxsize=128)
def _step(osc: Oscillator):
    """Compiled: a step (h, θ, θ̇, parameters), so that the many programs that march trace and derive it once."""

    @jax.jit
    def one(h: Array, theta: Array, omega: Array, p: Parameters) -> Node:
        return step(lambda th, om: osc.acceleration(th, om, p), h, theta, omega)

    return one


def nodes(osc: Oscillator, steps: Array, count: Array, p: Parameters) -> Array:
    """θ, θ̇, θ̈ at the nodes, shape (room + 1, 3), zero behind the last. Forward tangents work, reverse ones do not."""

    def advance(i, carry):
        theta, omega, found = carry
        new_theta, new_omega, before = _step(osc)(steps[i], theta, omega, p)
        return new_theta, new_omega, found.at[i].set(jnp.stack([theta, omega, before]))

    start = (jnp.asarray(p["theta0"], float), jnp.asarray(p["omega0"], float))
    empty = jnp.zeros((steps.size + 1, 3))
    theta, omega, found = jax.lax.fori_loop(0, count, advance, (*start, empty))
    return found.at[count].set(jnp.stack([theta, omega, osc.acceleration(theta, omega, p)]))


def along(
    osc: Oscillator,
    steps: Array,
    count: Array,
    p: Parameters,
    visit: Callable[[Array, Node, Node, C], C],
    begun: C,
) -> C:
    """What `visit` makes of all steps, one after the other, without keeping a trajectory.

    visit: (number of the step, node before, node after, what was made so far) to the same with this step. Forward
    tangents work, reverse ones do not.
    """

    # A step's first stage has the acceleration at its start, so a step is visited from the next one.
    def advance(i, carry):
        theta, omega, before, made = carry
        new_theta, new_omega, force = _step(osc)(steps[i], theta, omega, p)
        here = (theta, omega, force)
        visited = visit(jnp.maximum(i - 1, 0), before, here, made)
        made = jax.tree.map(lambda new, old: jnp.where(i > 0, new, old), visited, made)
        return new_theta, new_omega, here, made

    start = (jnp.asarray(p["theta0"], float), jnp.asarray(p["omega0"], float))
    nowhere = (jnp.zeros(()),) * 3
    return jax.lax.fori_loop(0, count + 1, advance, (*start, nowhere, begun))[-1]


def record(osc: Oscillator, plan: Plan, p: Parameters) -> Array:
    """The planned quantity at the samples, shape (n,), in rad, rad/s or rad/s².

    Not finite where the trajectory escapes.
    """
    if isinstance(plan, friction.TurningPlan):
        return friction.record(osc, plan, p)
    if isinstance(plan, cycles.CyclePlan):
        return cycles.record(osc, plan, p)
    return record_of(plan, nodes(osc, plan.steps, plan.count, p))


def record_of(plan: MeshPlan, state: Array) -> Array:
    """`record` from the values at the nodes, shape (m + 1, 3)."""
    pair = jnp.concatenate([state[plan.interval], state[plan.interval + 1]], axis=1)
    between = jnp.sum(pair * plan.weights, axis=1)
    return between if plan.anchor is None else between + plan.anchor.defect


def nodes_and_slopes(
    osc: Oscillator, names: Sequence[str], steps: Array, count: Array, p: Parameters
) -> tuple[Array, Array]:
    """`nodes`, and their derivatives by the parameters of these names, (k, room + 1, 3), by forward tangents."""

    def fun(x: Array) -> Array:
        return nodes(osc, steps, count, {**p, **dict(zip(names, x, strict=True))})

    x = jnp.stack([jnp.asarray(p[name], float) for name in names])
    push = jax.vmap(lambda v: jax.jvp(fun, (x,), (v,)), out_axes=(None, 0))
    return push(jnp.eye(x.size))


@lru_cache(maxsize=128)
def compiled_record(osc: Oscillator):
    """`record` of one oscillator, compiled once per shape of plan: (plan, parameters) -> samples."""
    return Program(partial(record, osc), "record", osc)


@lru_cache(maxsize=128)
def _compiled_nodes(osc: Oscillator):
    return Program(partial(nodes, osc), "nodes", osc)


@lru_cache(maxsize=128)
def _many_nodes(osc: Oscillator):
    return Program(jax.vmap(partial(nodes, osc), in_axes=(None, None, 0)), "many_nodes", osc)


def _in_room(plan: MeshPlan) -> np.ndarray:
    return np.pad(np.asarray(plan.steps), (0, max(0, NODES_ROOM - plan.steps.size)))


def _node_values(osc: Oscillator, plan: MeshPlan, p: Parameters) -> np.ndarray:
    values = {name: np.float64(p[name]) for name in osc.parameters}
    return np.asarray(_compiled_nodes(osc)(_in_room(plan), plan.count, values))[: plan.steps.size + 1]


def between(plan: MeshPlan, states: np.ndarray) -> np.ndarray:
    """The dense output at the samples, shape (..., n), of values at the nodes, (..., m, 3), anchor or no.

    m: one more than the steps, or than the room for them.
    """
    n, nodes = plan.interval.size, states.shape[-2]
    first = 3 * np.asarray(plan.interval)[:, None] + np.arange(6)
    rows = np.arange(0, 6 * n + 1, 6)
    weights = csr_array((np.asarray(plan.weights).ravel(), first.ravel(), rows), shape=(n, 3 * nodes))
    flat = states.reshape(-1, 3 * nodes)
    return np.ascontiguousarray((weights @ flat.T).T).reshape(*states.shape[:-2], n)


def at_samples(osc: Oscillator, plan: Plan, p: Parameters) -> np.ndarray:
    """`record` in numbers, shape (n,), compiled once for a room of steps, whatever the number of samples."""
    if isinstance(plan, cycles.CyclePlan):
        return cycles.at_samples(osc, plan, p)
    if not isinstance(plan, MeshPlan):
        values = {name: np.float64(p[name]) for name in osc.parameters}
        return np.asarray(compiled_record(osc)(plan, values))
    found = between(plan, _node_values(osc, plan, p))
    return found if plan.anchor is None else found + np.asarray(plan.anchor.defect)


def many_at_samples(osc: Oscillator, plan: Plan, values: Mapping[str, np.ndarray]) -> np.ndarray:
    """`at_samples` at many sets of parameters: values by name, each (m,); shape (m, n)."""
    if isinstance(plan, cycles.CyclePlan):
        return cycles.many_at_samples(osc, plan, values)
    if not isinstance(plan, MeshPlan):
        sets = (dict(zip(values, one)) for one in zip(*values.values(), strict=True))
        return np.stack([at_samples(osc, plan, one) for one in sets])
    defect = 0.0 if plan.anchor is None else np.asarray(plan.anchor.defect)
    return between(plan, many_nodes(osc, plan, values)) + defect


def many_nodes(osc: Oscillator, plan: MeshPlan, values: Mapping[str, np.ndarray]) -> np.ndarray:
    """`nodes` in numbers at many sets of parameters: values by name, each (m,); shape (m, room + 1, 3)."""
    steps, count, found = _in_room(plan), len(values["theta0"]), []
    for first in range(0, count, TOGETHER):
        rows = np.minimum(np.arange(first, first + TOGETHER), count - 1)
        part = {name: np.asarray(values[name], float)[rows] for name in osc.parameters}
        found.append(
            np.asarray(_many_nodes(osc)(steps, plan.count, part))[: count - first, : plan.steps.size + 1]
        )
    return np.concatenate(found)


def anchored(osc: Oscillator, plan: Plan, finer: Plan, p: Parameters) -> Plan:
    """The plan with its samples set right at `p`: there its trajectory is that of the finer plan.

    Near there the error is a share of the distance to that trajectory, however many samples ask for how
    little: the steps need not be shorter for a longer record. Exact friction keeps its plan.
    """
    if isinstance(plan, cycles.CyclePlan):
        lacking = at_samples(osc, finer, p) - at_samples(osc, plan, p)
        return replace(plan, defect=jax.device_put(np.asarray(plan.defect) + lacking))
    if not (isinstance(plan, MeshPlan) and isinstance(finer, MeshPlan)):
        return plan
    state = _node_values(osc, plan, p)
    defect = at_samples(osc, finer, p) - between(plan, state)
    return replace(plan, anchor=Anchor(*jax.device_put((state, defect))))


def finer(osc: Oscillator, plan: Plan, p: Parameters, parts: int, times: np.ndarray, quantity: str) -> Plan:
    """A much finer plan of the same samples (s, (n,)): each step divided into so many equal parts, or, of cycles, the
    next resolution at `p`."""
    if isinstance(plan, cycles.CyclePlan):
        order = QUANTITIES.index(quantity)
        found = cycles.cycle_plan(osc, p, times - times[0], order, cycles.FINER * plan.resolution)
        return found or plan
    return divided(plan, parts, times, quantity)


def divided(plan: Plan, parts: int, times: np.ndarray, quantity: str) -> Plan:
    """The plan with each step divided into equal parts, for the same samples (s, (n,))."""
    if isinstance(plan, friction.TurningPlan):
        return replace(plan, steps=plan.steps / parts, per_half_cycle=parts * plan.per_half_cycle)
    assert isinstance(plan, MeshPlan)
    return _mesh_plan(_times(np.repeat(_steps(plan) / parts, parts)), times - times[0], quantity)


def _steps(plan: MeshPlan) -> np.ndarray:
    return np.asarray(plan.steps)[: int(plan.count)]


def _times(steps: np.ndarray) -> np.ndarray:
    return np.concatenate([[0.0], np.cumsum(steps)])


def part_of(plan: Plan, part: slice) -> Plan:
    """The plan of some of its samples; the motion starts where it did."""
    if isinstance(plan, cycles.CyclePlan):
        return plan.of(part)
    if not isinstance(plan, MeshPlan):
        return replace(plan, times=plan.times[part])
    anchor = plan.anchor and replace(plan.anchor, defect=plan.anchor.defect[part])
    return replace(plan, interval=plan.interval[part], weights=plan.weights[part], anchor=anchor)


def plan_of(
    osc: Oscillator, p: Parameters, times: np.ndarray, quantity: str, tolerance: float
) -> tuple[Plan, float]:
    """`plan_with_error`, of cycles where the record has very many of them, smooth in all parameters near `p`."""
    if not is_exact(osc, p):
        found = cycles.plan_with_error(osc, p, times - times[0], QUANTITIES.index(quantity), tolerance)
        if found is not None:
            return found
    return plan_with_error(osc, p, times, quantity, tolerance)


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
    if times.size > ENOUGH:
        some = times[np.linspace(0, times.size - 1, ENOUGH).astype(int)]
        plan, error = plan_with_error(osc, p, some, quantity, tolerance)
        return _at(plan, times, quantity), error
    p = {name: np.float64(p[name]) for name in osc.parameters}
    resolution, best = FIRST_RESOLUTION, None
    order = ORDER - QUANTITIES.index(quantity)  # each derivative of the dense output costs one
    for _ in range(6):
        coarse, fine = _pair(osc, p, times, quantity, resolution)
        change = float(np.max(np.abs(at_samples(osc, coarse, p) - at_samples(osc, fine, p))))
        if not np.isfinite(change) or change <= tolerance:
            return coarse, change
        if best is not None and change > 0.5 * best[1]:
            break  # rounding has been reached
        finer = change / 2 ** (order - 1)
        best = (fine, finer) if best is None or finer < best[1] else best
        resolution *= min(max(1.1 * (change / tolerance) ** (1 / order), 1.15), 4.0)
    assert best is not None
    return best


def _at(plan: Plan, times: np.ndarray, quantity: str) -> Plan:
    """The same steps for other samples."""
    if isinstance(plan, friction.TurningPlan):
        return replace(plan, times=jax.device_put(times))
    assert isinstance(plan, MeshPlan)
    return _mesh_plan(_times(_steps(plan)), times, quantity)


def _pair(
    osc: Oscillator, p: Parameters, times: np.ndarray, quantity: str, resolution: float
) -> tuple[Plan, Plan]:
    if is_exact(osc, p):
        make = partial(friction.turning_plan, osc, p, times, quantity)
        return make(resolution), make(2 * resolution)
    mesh = frozen_mesh(osc, p, max(float(times[-1]), 1e-300), resolution)
    halved = np.empty(2 * mesh.size - 1)
    halved[::2], halved[1::2] = mesh, 0.5 * (mesh[:-1] + mesh[1:])
    return _mesh_plan(mesh, times, quantity, parts=2), _mesh_plan(halved, times, quantity)


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
    return at_samples(osc, plan, p)
