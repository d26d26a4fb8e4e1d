"""A record compressed, in one pass, to a few numbers a solver step: the likelihood's cost loses the samples.

Between two nodes the dense output is linear in the node values x (θ, θ̇, θ̈ at both ends), so the residuals of
the samples in a step are y − W x. The triangle of [W | y] = Q [R | b; 0 | c] gives their sum of squares for
every x: |b − R x|² + c², with R (6, 6) and b (6,). These are square roots of moments: b − R x is as small as
the residuals are, and nothing cancels. Taken against the trajectory at which the plan is corrected, R's own
rounding does not count either. Neighbouring residuals' differences are compressed in the same way, but for
the pairs that straddle a node, which are kept as they are.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from bayesdamp.inference.noise import NoiseModel, NormalNoise
from bayesdamp.numerics.lazily import jax, jnp, traced, tree
from bayesdamp.physics.oscillator import Oscillator
from bayesdamp.physics.solver.plan import Plan
from bayesdamp.physics.solver.steps import MeshPlan, Node, along, between

if TYPE_CHECKING:
    from jax import Array

EVEN = 1e-8
"""Departure of a gap from the mean one, as a share, up to which a clock is uniform: rounding, no jitter. In a log
likelihood ten sds from its mode it shows as about 14 times that (nats)."""
LEAST_ROOM = 512
"""Steps that there is room for at least; more come in powers of four, so that few sizes are compiled."""
CHUNK = 2**18
"""Samples triangulated at a time."""


@tree(["root", "value", "rest"])
@dataclass(frozen=True)
class InformationRoots:
    """Sums of squares by step: root R (m, 6, 6), value b (m, 6), and the root of what no x can remove, (1,)."""

    root: Array
    value: Array
    rest: Array

    def misfit(self, pairs: Array) -> Array:
        """b − R x of all steps and the rest, shape (6m + 1,), at the steps' node values, (m, 6)."""
        left = self.value - jnp.sum(self.root * pairs[:, None, :], axis=2)
        return jnp.concatenate([left.ravel(), self.rest])

    def begun(self) -> Array:
        """What `visited` starts from, shape ()."""
        return self.rest[0] ** 2

    def visited(self, step: Array, pair: Sequence[Array], made: Array) -> Array:
        """The sum of squares with one more step, at its node values, six of shape (), which are dealt with one by one:
        so a batch is computed many at a time."""
        root, value = self.root[step], self.value[step]
        for i in range(6):
            made = made + (value[i] - sum(root[i, j] * pair[j] for j in range(i, 6))) ** 2
        return made

    @staticmethod
    def total(made: Array) -> Array:
        """The sum of squares over all steps."""
        return made


@tree(["weights", "value", "present", "leaving", "leaves", "before"])
@dataclass(frozen=True)
class Singles:
    """Residuals, or differences of two, at most one in a step: dense-output weights (m, 6), values (m,), and in which
    steps there is one, (m,).

    Of a difference the first of the two lies in an earlier step, `before` (m,): its weights there, `leaving` (m, 6), in
    the steps with samples, `leaves` (m,).
    """

    weights: Array
    value: Array
    present: Array
    leaving: Array
    leaves: Array
    before: Array

    def misfit(self, pairs: Array) -> Array:
        """Value minus that of the trajectory, shape (m,)."""
        after, left = (jnp.sum(pairs * w, axis=1) for w in (self.weights, self.leaving))
        return jnp.where(self.present, self.value - (after - left[self.before]), 0.0)

    def begun(self) -> tuple[Array, Array]:
        """What `visited` starts from: the sum of squares, and the value where the last samples were left, shapes ()."""
        return jnp.zeros(()), jnp.zeros(())

    def visited(self, step: Array, pair: Sequence[Array], made: tuple[Array, Array]) -> tuple[Array, Array]:
        """Both with one more step, at its node values, six of shape ()."""
        total, last = made
        after, left = (sum(w[step, j] * pair[j] for j in range(6)) for w in (self.weights, self.leaving))
        apart = jnp.where(self.present[step], self.value[step] - (after - last), 0.0)
        return total + apart**2, jnp.where(self.leaves[step], left, last)

    @staticmethod
    def total(made: tuple[Array, Array]) -> Array:
        """The sum of squares, without where the last samples were left."""
        return made[0]


@tree(["sums", "near", "count", "gap"])
@dataclass(frozen=True)
class Compressed:
    """What the sums of squares of `NormalNoise` are made of, by name; the samples' number and mean gap (s).

    near: values at the nodes from which the sums are counted, (m + 1, 3).
    """

    sums: Mapping[str, tuple[InformationRoots | Singles, ...]]
    near: Array
    count: Array
    gap: Array

    @property
    def capacity(self) -> int:
        """Steps that there is room for."""
        return self.near.shape[0] - 1

    def padded(self, room: int) -> Compressed:
        """The same with room for more steps; those are empty."""
        more = room - self.capacity
        sums = {name: tuple(_padded(s, more) for s in parts) for name, parts in self.sums.items()}
        return replace(self, sums=sums, near=jnp.pad(self.near, ((0, more), (0, 0))))

    def misfit(self, nodes: Array) -> Array:
        """One vector, shape (c,), whose parts have the sums as their squares, at values at the nodes, (m' + 1, 3).

        m' may be larger than the m of the sums: they hold all steps with samples.
        """
        apart = nodes[: self.near.shape[0]] - self.near
        away = jnp.concatenate([apart[:-1], apart[1:]], axis=1)
        return jnp.concatenate([s.misfit(away) for name in sorted(self.sums) for s in self.sums[name]])

    def sums_along(
        self, osc: Oscillator, steps: Array, count: Array, p: Mapping[str, Array]
    ) -> dict[str, Array]:
        """The sums of squares, shape () each, of the trajectory over these steps, of which nothing is kept."""
        parts = [s for name in sorted(self.sums) for s in self.sums[name]]

        def visit(step: Array, before: Node, after: Node, made: list[Any]) -> list[Any]:
            pair = [
                value - near
                for node, at in ((before, step), (after, step + 1))
                for value, near in zip(node, self.near[at], strict=True)
            ]
            return [part.visited(step, pair, m) for part, m in zip(parts, made, strict=True)]

        made = iter(along(osc, steps, count, p, visit, [part.begun() for part in parts]))
        return {
            name: sum((s.total(next(made)) for s in self.sums[name]), jnp.zeros(()))
            for name in sorted(self.sums)
        }

    def split(self, misfit: Array | np.ndarray) -> dict[str, Any]:
        """The parts of such a vector by the name of their sum."""
        names = sorted(self.sums)
        sizes = [sum(s.value.size + isinstance(s, InformationRoots) for s in self.sums[n]) for n in names]
        split = jnp.split if traced(misfit) else np.split
        return dict(zip(names, split(misfit, np.cumsum(sizes)[:-1]), strict=True))


def _padded(part: InformationRoots | Singles, more: int) -> InformationRoots | Singles:
    def longer(x: Array) -> Array:
        return jnp.pad(x, ((0, more), *((0, 0),) * (x.ndim - 1)))

    if isinstance(part, InformationRoots):
        return InformationRoots(longer(part.root), longer(part.value), part.rest)
    return Singles(*(longer(getattr(part, f.name)) for f in fields(part)))


def log_likelihood(
    noise: NormalNoise, compressed: Compressed, misfit: Array, p: Mapping[str, Array]
) -> Array:
    """Log density of the record in nats, shape (), from the vector (c,) that `Compressed.misfit` gives."""
    sums = {name: jnp.sum(part**2) for name, part in compressed.split(misfit).items()}
    return of_sums(noise, compressed, sums, p)


def of_sums(
    noise: NormalNoise, compressed: Compressed, sums: Mapping[str, Array], p: Mapping[str, Array]
) -> Array:
    """Log density of the record in nats, shape (), from the sums of squares."""
    return noise.log_likelihood_of_sums(sums, compressed.count, compressed.gap, p)


def information_root(noise: NormalNoise, compressed: Compressed, v: Array, p: Mapping[str, Array]) -> Array:
    """R v with RᵀR the Fisher information about a shift of the misfit by v, shape (c,)."""

    def density(sums: Mapping[str, Array]) -> Array:
        return of_sums(noise, compressed, sums, p)

    parts = compressed.split(v)
    slopes = jax.grad(density)({name: jnp.zeros(()) for name in parts})
    return jnp.concatenate([jnp.sqrt(-2.0 * slopes[name]) * part for name, part in parts.items()])


def compress(noise: NoiseModel, plan: Plan, t: np.ndarray, y: np.ndarray) -> Compressed | None:
    """A record's times (s, (n,)) and values (n,) for this noise and plan; None where the plain sum is to be taken:

    steps that belong to the parameters (exact friction), noise whose likelihood is not
    made of sums of squares, correlated noise on a clock that is not uniform, all samples in one step.
    """
    if not isinstance(noise, NormalNoise) or not isinstance(plan, MeshPlan):
        return None
    first, last = np.asarray(plan.interval)[[0, -1]]
    if first == last:
        return None
    if noise.uniform_clock and not _even(t):
        return None
    size = capacity_of(plan)
    near, left = np.zeros((size + 1, 3)), np.asarray(y, float)
    if plan.correction is not None:
        near = np.asarray(plan.correction.nodes)[: size + 1]
        left = left - np.asarray(plan.correction.defect) - between(plan, near)
    sums = {name: _SUMS[name](plan, left, size) for name in noise.sums}
    gap = (t[-1] - t[0]) / (t.size - 1)
    return Compressed(sums, *jax.device_put((near, np.asarray(float(t.size)), gap)))


def capacity_of(plan: MeshPlan) -> int:
    """Steps that there is to be room for."""
    size = LEAST_ROOM
    while size < int(plan.count):
        size *= 4
    return min(size, plan.steps.size)


def _even(t: np.ndarray) -> bool:
    gaps = np.diff(t)
    return bool(np.max(np.abs(gaps / gaps.mean() - 1.0)) <= EVEN)


def _squares(plan: MeshPlan, y: np.ndarray, size: int) -> tuple[InformationRoots]:
    rows = np.column_stack([np.asarray(plan.weights), y])
    return (_information_roots(np.asarray(plan.interval), rows, size),)


def _differences(plan: MeshPlan, y: np.ndarray, size: int) -> tuple[InformationRoots, Singles]:
    interval, weights = np.asarray(plan.interval), np.asarray(plan.weights)
    rows = np.diff(np.column_stack([weights, y]), axis=0)
    within = interval[1:] == interval[:-1]
    inside = _information_roots(interval[1:][within], rows[within], size)
    # The last sample of a step with samples, and the first of the next such step.
    last = np.flatnonzero(~within)
    leave, arrive = interval[last], interval[last + 1]
    made = _no_singles(size)
    made["weights"][arrive], made["value"][arrive] = weights[last + 1], y[last + 1] - y[last]
    made["present"][arrive], made["before"][arrive] = True, leave
    made["leaving"][leave], made["leaves"][leave] = weights[last], True
    return inside, Singles(**jax.device_put(made))


def _ends(plan: MeshPlan, y: np.ndarray, size: int) -> tuple[Singles]:
    at = np.array([0, -1])
    step, made = np.asarray(plan.interval)[at], _no_singles(size)
    made["weights"][step], made["value"][step] = np.asarray(plan.weights)[at], y[at]
    made["present"][step] = True
    return (Singles(**jax.device_put(made)),)


def _no_singles(size: int) -> dict[str, np.ndarray]:
    weights, yes = np.zeros((size, 6)), np.zeros(size, bool)
    return {
        "weights": weights,
        "value": np.zeros(size),
        "present": yes,
        "leaving": weights.copy(),
        "leaves": yes.copy(),
        "before": np.zeros(size, int),
    }


_SUMS = {"squares": _squares, "differences": _differences, "ends": _ends}


def _information_roots(step: np.ndarray, rows: np.ndarray, count: int) -> InformationRoots:
    """InformationRoots of the rows [weights | value], shape (n, 7), of each step; step: (n,), not decreasing.

    Steps with about as many rows are stacked, filled up with zeros, which change no triangle.
    """
    first = np.searchsorted(step, np.arange(count))
    sizes = np.diff(np.append(first, step.size))
    found, padded = np.zeros((count, 7, 7)), np.vstack([rows, np.zeros((1, 7))])
    lengths = 2 ** np.ceil(np.log2(np.maximum(sizes, 8))).astype(int)
    for length in np.unique(lengths):
        same = np.flatnonzero(lengths == length)
        for part in np.array_split(same, int(np.ceil(same.size * length / CHUNK))):
            offset = np.arange(length)
            held = offset < sizes[part][:, None]
            index = np.where(held, first[part][:, None] + offset, rows.shape[0])
            found[part] = np.linalg.qr(padded[index], mode="r")
    rest = np.sqrt(np.sum(found[:, 6, 6] ** 2))
    return InformationRoots(*jax.device_put((found[:, :6, :6], found[:, :6, 6], rest[None])))
