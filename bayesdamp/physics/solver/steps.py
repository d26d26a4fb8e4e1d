"""Motions in steps that belong to the plan: a record is a straight line in the values at their ends."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache, partial
from typing import TYPE_CHECKING, TypeAlias, TypeVar

import numpy as np

from bayesdamp.machine.programs import Program
from bayesdamp.numerics.lazily import jax, jnp, tree
from bayesdamp.physics.oscillator import Oscillator, Parameters
from bayesdamp.physics.solver.hermite import basis
from bayesdamp.physics.solver.plan import QUANTITIES, Plan
from bayesdamp.physics.solver.stepper import step
from bayesdamp.physics.solver.tangents import with_slopes

if TYPE_CHECKING:
    from jax import Array

LEAST_ROOM = 1024
NODES_ROOM = 4096
"""Room in which single trajectories are computed, so that a plan and its refinements share a program."""
TOGETHER = 32
"""Trajectories that are solved side by side."""
C = TypeVar("C")
Node: TypeAlias = "tuple[Array, Array, Array]"
"""θ, θ̇ and θ̈ between two steps."""


@tree(["nodes", "defect"])
@dataclass(frozen=True)
class DefectCorrection:
    """What a plan knows of one trajectory: its values at the nodes, (room + 1, 3), and what the samples lack there
    by the length of the steps, (n,)."""

    nodes: Array
    defect: Array


@tree(["steps", "count", "interval", "weights", "correction"])
@dataclass(frozen=True)
class MeshPlan(Plan):
    """Steps in s, the first `count` of an array (room,); each sample's step and dense-output weights, (n,), (n, 6).

    The room is a power of four: meshes of many sizes share one compiled program.
    """

    steps: Array
    count: Array
    interval: Array
    weights: Array
    correction: DefectCorrection | None = None

    def record(self, osc: Oscillator, p: Parameters) -> Array:
        """The motion at the samples, between the mesh's nodes."""
        return self.of_nodes(nodes(osc, self.steps, self.count, p))

    def of_nodes(self, state: Array) -> Array:
        """`record` from the values at the nodes, shape (m + 1, 3)."""
        pair = jnp.concatenate([state[self.interval], state[self.interval + 1]], axis=1)
        between = jnp.sum(pair * self.weights, axis=1)
        return between if self.correction is None else between + self.correction.defect

    def of(self, samples: slice) -> MeshPlan:
        """Of some of the samples, on the same mesh."""
        correction = self.correction and replace(self.correction, defect=self.correction.defect[samples])
        return replace(
            self, interval=self.interval[samples], weights=self.weights[samples], correction=correction
        )

    def at(self, times: np.ndarray, quantity: str) -> MeshPlan:
        """At other times, of another derivative, on the same mesh."""
        return mesh_plan(_times(_steps(self)), times, quantity)

    def finer(self, osc: Oscillator, p: Parameters, parts: int, times: np.ndarray, quantity: str) -> MeshPlan:
        """With each step in so many parts."""
        del osc, p
        return mesh_plan(_times(np.repeat(_steps(self) / parts, parts)), times - times[0], quantity)

    def corrected(self, osc: Oscillator, finer: Plan, p: Parameters) -> MeshPlan:
        """With the defect to a finer plan added at every sample (defect correction, Stetter 1978)."""
        state = _node_values(osc, self, p)
        defect = finer.at_samples(osc, p) - between(self, state)
        return replace(self, correction=DefectCorrection(*jax.device_put((state, defect))))

    def at_samples(self, osc: Oscillator, p: Parameters) -> np.ndarray:
        """`record` in numbers, compiled once for a room of steps, whatever the number of samples."""
        return between(self, _node_values(osc, self, p)) + self._defect

    def many_at_samples(self, osc: Oscillator, values: Mapping[str, np.ndarray]) -> np.ndarray:
        """Motions of many parameters, (m, n), by one compiled program."""
        return between(self, many_nodes(osc, self, values)) + self._defect

    @property
    def _defect(self) -> np.ndarray | float:
        return 0.0 if self.correction is None else np.asarray(self.correction.defect)


def mesh_plan(nodes: np.ndarray, times: np.ndarray, quantity: str, parts: int = 1) -> MeshPlan:
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


def nodes_and_slopes(
    osc: Oscillator, names: Sequence[str], steps: Array, count: Array, p: Parameters
) -> tuple[Array, Array]:
    """`nodes`, and their derivatives by the parameters of these names, (k, room + 1, 3), by forward tangents."""
    return with_slopes(lambda q: nodes(osc, steps, count, q), names, p)


@lru_cache(maxsize=128)
def _compiled_nodes(osc: Oscillator):
    return Program(partial(nodes, osc), "nodes", osc)


@lru_cache(maxsize=128)
def _many_nodes(osc: Oscillator):
    return Program(jax.vmap(partial(nodes, osc), in_axes=(None, None, 0)), "many_nodes", osc)


def _in_room(plan: MeshPlan) -> np.ndarray:
    return np.pad(np.asarray(plan.steps), (0, max(0, NODES_ROOM - plan.steps.size)))


def _node_values(osc: Oscillator, plan: MeshPlan, p: Parameters) -> np.ndarray:
    values = {name: np.float64(p[name]) for name in osc.inputs}
    return np.asarray(_compiled_nodes(osc)(_in_room(plan), plan.count, values))[: plan.steps.size + 1]


def between(plan: MeshPlan, states: np.ndarray) -> np.ndarray:
    """The dense output at the samples, shape (..., n), of values at the nodes, (..., m, 3), correction or no.

    m: one more than the steps, or than the room for them.
    """
    from scipy.sparse import csr_array

    n, nodes = plan.interval.size, states.shape[-2]
    first = 3 * np.asarray(plan.interval)[:, None] + np.arange(6)
    rows = np.arange(0, 6 * n + 1, 6)
    weights = csr_array((np.asarray(plan.weights).ravel(), first.ravel(), rows), shape=(n, 3 * nodes))
    flat = states.reshape(-1, 3 * nodes)
    return np.ascontiguousarray((weights @ flat.T).T).reshape(*states.shape[:-2], n)


def many_nodes(osc: Oscillator, plan: MeshPlan, values: Mapping[str, np.ndarray]) -> np.ndarray:
    """`nodes` in numbers at many sets of parameters: values by name, each (m,); shape (m, room + 1, 3)."""
    steps, count, found = _in_room(plan), len(values["theta0"]), []
    for first in range(0, count, TOGETHER):
        rows = np.minimum(np.arange(first, first + TOGETHER), count - 1)
        part = {name: np.asarray(values[name], float)[rows] for name in osc.inputs}
        found.append(
            np.asarray(_many_nodes(osc)(steps, plan.count, part))[: count - first, : plan.steps.size + 1]
        )
    return np.concatenate(found)


def _steps(plan: MeshPlan) -> np.ndarray:
    return np.asarray(plan.steps)[: int(plan.count)]


def _times(steps: np.ndarray) -> np.ndarray:
    return np.concatenate([[0.0], np.cumsum(steps)])
