"""Records of very many cycles: one cycle as a map of the amplitude it begins with.

From an upper turning point on, a free motion is known by its turning angle alone. So cycles are solved at some
amplitudes that the motion passes, side by side; what lies between these are Chebyshev polynomials in the logarithm
of the amplitude: how long a cycle lasts, at which angle the next one begins, and the motion at fixed shares of the
time it takes in the reference. The map is then followed from cycle to cycle. The cost of a cycle more is that of a
polynomial.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np

from bayesdamp.machine.programs import Program
from bayesdamp.numerics.lazily import jax, jnp, tree
from bayesdamp.physics.oscillator import Oscillator, Parameters
from bayesdamp.physics.solver.hermite import basis
from bayesdamp.physics.solver.mesh import fastest_rate, frozen_mesh
from bayesdamp.physics.solver.plan import QUANTITIES, Plan, compiled_records
from bayesdamp.physics.solver.stepper import land, step

if TYPE_CHECKING:
    from jax import Array

FEWEST = 200
"""Cycles of a record from which on it pays."""
FAINTEST = 1e-3
"""Least share of its first amplitude that the motion must keep: slower than friction it does not oscillate."""
DENSEST = 60
"""Samples a cycle up to which it pays: their number counts here."""
FIRST, FINER, TRIES = 1.0, 1.5, 3
"""How finely cycles are solved at first, by how much more finely next, and how often."""
EVEN = 16
"""Steps of a cycle are made a multiple of this: fewer sizes are compiled."""
NEWTON = 6
"""Steps to the angle at rest."""
MARGIN = 1.3
"""Factor by which amplitudes may be beyond those of the reference."""
SPARE = 4
"""Least number of steps of a cycle behind its reference's end, for motions that are slower."""
ROUND = 32
"""Numbers of cycles are rounded up to a multiple of this, so that motions near the reference share a program."""
TOGETHER = 16
"""Motions that are computed side by side."""
SURVEY = 24
"""Steps in a period of the reference's first look."""


@tree(
    ["centre", "span", "periods", "shares", "first", "times", "defect"],
    ["turns", "derivative", "resolution", "part"],
)
@dataclass(frozen=True)
class CyclePlan(Plan):
    """Where cycles are solved, and the samples.

    centre: the reference's angle at rest, rad; span: least and largest log amplitude, (2,); periods: of the
    reference at the amplitudes between, s, (k,); shares: steps of a cycle as shares of that, (m,), and some behind its
    end; first: the reference's time to its first upper turning point, s; times: of the samples, s, (n,); defect: what
    the samples lack by the plan, (n,). turns: cycles that there is room for; derivative: 0 to 2 of the angle;
    resolution: how finely cycles are solved, 1 being usual; part: the first and the end of the samples that are
    wanted, None for all: parts share the programs of the whole.
    """

    centre: Array
    span: Array
    periods: Array
    shares: Array
    first: Array
    times: Array
    defect: Array
    turns: int
    derivative: int
    resolution: float
    part: tuple[int, int] | None = None
    together = TOGETHER

    @property
    def whole(self) -> CyclePlan:
        """The plan of all samples."""
        return replace(self, part=None)

    @property
    def kept(self) -> slice:
        """Which samples of the whole are in the part."""
        return slice(*self.part) if self.part else slice(None)

    def of(self, samples: slice) -> CyclePlan:
        """Of a run of samples, read from the same cycles."""
        kept = range(self.times.size)[self.kept][samples]
        return replace(self, part=(kept.start, kept.stop))

    def record(self, osc: Oscillator, p: Parameters) -> Array:
        """Not finite where the motion leaves the plan's amplitudes, either."""
        begins, length, nodes = _followed(osc, self, p)
        # Behind where the motion left the plan nothing is known.
        known = jnp.where(jnp.isfinite(begins), begins, jnp.inf)
        cycle = jnp.clip(jnp.searchsorted(known, self.times, side="right") - 1, 0, self.turns)
        ends = jnp.concatenate([jnp.zeros(1), jnp.cumsum(self.shares)])
        lasts = length[cycle]
        share = (self.times - begins[cycle]) / lasts
        within = jnp.clip(jnp.searchsorted(ends, share, side="right") - 1, 0, self.shares.size - 1)
        part = self.shares[within]
        weights = basis((share - ends[within]) / part, lasts * part, self.derivative)
        flat, at = (
            nodes.reshape(-1, 3),
            cycle * nodes.shape[1] + within,
        )  # rows side by side are gathered fastest
        found = jnp.sum(flat[at] * weights[:, :3], axis=1) + jnp.sum(flat[at + 1] * weights[:, 3:], axis=1)
        beyond = jnp.where(self.times[-1] <= known[-1], 0.0, jnp.nan)
        return (found + self.defect + beyond)[self.kept]

    def finer(
        self, osc: Oscillator, p: Parameters, parts: int, times: np.ndarray, quantity: str
    ) -> CyclePlan:
        """The next resolution at `p`."""
        del parts
        order = QUANTITIES.index(quantity)
        return cycle_plan(osc, p, times - times[0], order, FINER * self.resolution) or self

    def corrected(self, osc: Oscillator, finer: Plan, p: Parameters) -> CyclePlan:
        """With the defect to a finer plan added at every sample (defect correction, Stetter 1978)."""
        lacking = finer.at_samples(osc, p) - self.at_samples(osc, p)
        return replace(self, defect=jax.device_put(np.asarray(self.defect) + lacking))

    def many_at_samples(self, osc: Oscillator, values: Mapping[str, np.ndarray]) -> np.ndarray:
        """Motions of many parameters, (m, n), in batches of one size."""
        count, found = len(values["theta0"]), []
        for first in range(0, count, TOGETHER):
            rows = np.minimum(np.arange(first, first + TOGETHER), count - 1)
            some = {name: np.asarray(values[name], float)[rows] for name in osc.inputs}
            found.append(np.asarray(compiled_records(osc)(self.whole, some))[: count - first, self.kept])
        return np.concatenate(found)


@lru_cache(maxsize=32)
def _chebyshev(count: int) -> tuple[np.ndarray, np.ndarray]:
    """Chebyshev's points on (−1, 1), (k,), and the matrix, (k, k), that makes coefficients of values there."""
    angle = math.pi * (np.arange(count) + 0.5) / count
    matrix = 2.0 / count * np.cos(np.outer(np.arange(count), angle))
    matrix[0] *= 0.5
    return np.cos(angle), matrix


def _polynomials(x: Array, count: int) -> Array:
    """Chebyshev polynomials at x, (n,): (n, count)."""
    found = [jnp.ones_like(x), x]
    while len(found) < count:
        found.append(2 * x * found[-1] - found[-2])
    return jnp.stack(found[:count], axis=-1)


def _sum(coefficients: Sequence[Array], x: Array) -> Array:
    """A Chebyshev series at x, both of shape () (Clenshaw, Mathematical Tables 9, 1955)."""
    near = far = jnp.zeros(())
    for c in coefficients[:0:-1]:
        near, far = c + 2 * x * near - far, near
    return coefficients[0] + x * near - far


def _cycle(osc: Oscillator, steps: Array, theta: Array, omega: Array, p: Parameters, behind: int = 0):
    """One cycle in these steps (s, (m,)): θ, θ̇ and θ̈ at the nodes, (m + 1, 3), and when and where it turns again.

    behind: steps in which a turning point does not count. Not finite where it does not turn within the others.
    """

    def acceleration(th: Array, om: Array) -> Array:
        return osc.acceleration(th, om, p)

    def advance(state, h):
        th, om, before = step(acceleration, h, *state)
        return (th, om), jnp.stack([*state, before])

    last, nodes = jax.lax.scan(advance, (theta, omega), steps)
    nodes = jnp.concatenate([nodes, jnp.stack([*last, acceleration(*last)])[None]])
    velocity = nodes[:, 1]
    turns = (velocity[:-1] > 0) & (velocity[1:] <= 0) & (jnp.arange(steps.size) >= behind)
    before = jnp.argmax(turns)
    at = before + (-velocity[before + 1] < velocity[before])
    extra, turned = land(acceleration, nodes[at, 0], nodes[at, 1])
    since = jnp.concatenate([jnp.zeros(1), jnp.cumsum(steps)])[at]
    lost = jnp.where(jnp.any(turns), 0.0, jnp.nan)
    return nodes, since + extra + lost, turned + lost


def _rest(osc: Oscillator, near: Array, p: Parameters) -> Array:
    """Where the motion comes to rest, from where it does so in the reference, rad: Newton's method."""

    def force(theta: Array) -> Array:
        return osc.law.force(theta, p)

    theta = near
    for _ in range(NEWTON):
        value, slope = jax.jvp(force, (theta,), (jnp.ones_like(theta),))
        theta = theta - value / slope
    return theta


def _followed(osc: Oscillator, plan: CyclePlan, p: Parameters) -> tuple[Array, Array, Array]:
    """When each stretch begins, (turns + 1,), how long its reference is, and the nodes in it, (turns + 1, m', 3): the
    first up to a turning point, then the cycles."""
    count = plan.periods.size
    points, matrix = _chebyshev(count)
    middle, half = 0.5 * (plan.span[1] + plan.span[0]), 0.5 * (plan.span[1] - plan.span[0])
    begin = jnp.asarray(p["theta0"], float), jnp.asarray(p["omega0"], float)
    start, first, turned = _cycle(osc, plan.first * plan.shares, *begin, p, plan.shares.size // 2)
    # A velocity or an acceleration does not show where zero is: amplitudes are counted from these parameters' own rest.
    centre = _rest(osc, plan.centre, p)
    angles = centre + jnp.exp(middle + half * points)
    many = jax.vmap(lambda h, th: _cycle(osc, h, th, jnp.zeros(()), p))
    nodes, lasting, ends = many(plan.periods[:, None] * plan.shares, angles)
    series = matrix @ jnp.stack([lasting, jnp.log(ends - centre)], axis=1)
    columns = [[series[j, i] for j in range(count)] for i in range(2)]

    def follow(state, _):
        time, level = state
        x = (level - middle) / half
        # Beyond the amplitudes that were solved a polynomial says nothing.
        x = jnp.where(jnp.abs(x) <= 1.0, x, jnp.nan)
        lasts, next_level = (_sum(column, x) for column in columns)
        return (time + lasts, next_level), (time, x)

    _, (times, x) = jax.lax.scan(follow, (first, jnp.log(turned - centre)), None, length=plan.turns)
    weights = _polynomials(x, count) @ matrix
    cycles = (weights @ nodes.reshape(count, -1)).reshape(plan.turns, *start.shape)
    begins = jnp.concatenate([jnp.zeros(1), times])
    length = jnp.concatenate([plan.first[None], weights @ plan.periods])
    return begins, length, jnp.concatenate([start[None], cycles])


@lru_cache(maxsize=64)
def _surveyor(osc: Oscillator):
    """Compiled: (p, step, end, least time of the first turn) to the number of upper turning points, the first one's
    time and angle, and the last one's angle."""

    def survey(p, h, end, least):
        def acceleration(th, om):
            return osc.acceleration(th, om, p)

        def going(state):
            return (state[0] < end) & jnp.isfinite(state[1])

        def advance(state):
            t, th, om, turns, first, begun, last = state
            new_th, new_om, _ = step(acceleration, h, th, om)
            turned = (om > 0) & (new_om <= 0) & (t + h > least)
            extra, angle = land(acceleration, new_th, new_om)
            first = jnp.where(turned & (turns == 0), t + h + extra, first)
            begun = jnp.where(turned & (turns == 0), angle, begun)
            last = jnp.where(turned, angle, last)
            return t + h, new_th, new_om, turns + turned, first, begun, last

        zero = jnp.zeros(())
        start = (zero, p["theta0"], p["omega0"], jnp.zeros((), int), zero, zero, zero)
        return jax.lax.while_loop(going, advance, start)[3:]

    return Program(survey, "survey", osc)


@lru_cache(maxsize=64)
def _periods(osc: Oscillator):
    """Compiled: (p, steps (m,) of a cycle, angles (k,) it begins with) to how long cycles last, (k,)."""

    def lasting(p, steps, angles):
        return jax.vmap(lambda th: _cycle(osc, steps, th, jnp.zeros(()), p)[1])(angles)

    return Program(lasting, "periods", osc)


def cycle_plan(
    osc: Oscillator, p: Parameters, times: np.ndarray, quantity: int, resolution: float
) -> CyclePlan | None:
    """A plan for motions near that at `p` over the samples (s, from 0); None where a motion has too few cycles, or does
    not go on like that. quantity: derivative of the angle that is recorded."""
    p = {name: np.float64(p[name]) for name in osc.inputs}
    try:
        centre = osc.equilibrium(p, float(p["theta0"]))
        period = 2 * math.pi / osc.natural_frequency(p, centre)
    except ValueError:
        return None
    end = float(times[-1])
    if not (FEWEST * period < end and times.size < DENSEST * end / period):
        return None
    h = min(period, 2 * math.pi / fastest_rate(osc, p)) / SURVEY
    turns, first, begun, last = map(float, _surveyor(osc)(p, h, end, 0.4 * period))
    large, small = begun - centre, last - centre
    if turns < FEWEST or not (np.isfinite(large) and small > FAINTEST * large):
        return None
    span = np.array([math.log(small / MARGIN), math.log(large * MARGIN)])
    count = math.ceil(12 * resolution)
    points, _ = _chebyshev(count)
    angles = centre + np.exp(span.mean() + 0.5 * (span[1] - span[0]) * points)
    lasting = _periods(osc)(p, _looking(period), np.append(angles, centre + large))
    *periods, whole = np.asarray(lasting)
    shares = _shares(osc, p, centre + large, whole, resolution) if np.all(np.isfinite(lasting)) else None
    if shares is None:
        return None
    turns = ROUND * math.ceil((1.02 * turns + 4) / ROUND)
    centre, span, periods, shares, first, samples, exact = jax.device_put(
        (np.float64(centre), span, np.array(periods), shares, np.float64(first), times, np.zeros(times.size))
    )
    return CyclePlan(centre, span, periods, shares, first, samples, exact, turns, quantity, resolution)


def plan_with_error(
    osc: Oscillator, p: Parameters, times: np.ndarray, quantity: int, tolerance: float
) -> tuple[CyclePlan, float] | None:
    """A plan within `tolerance` (unit of the quantity), and what the next finer one changes at `p`; None where there is
    none such."""
    plan = cycle_plan(osc, p, times, quantity, FIRST)
    for _ in range(TRIES):
        finer = plan and cycle_plan(osc, p, times, quantity, FINER * plan.resolution)
        if plan is None or finer is None:
            return None
        change = float(np.max(np.abs(plan.at_samples(osc, p) - finer.at_samples(osc, p))))
        if change <= tolerance:
            return plan, change
        if not np.isfinite(change):
            return None
        plan = finer
    return None


def _looking(period: float) -> np.ndarray:
    """Steps in s in which a cycle surely turns, where its period differs little from that of small motions, s."""
    return np.full(3 * SURVEY, period / SURVEY)


def _shares(
    osc: Oscillator, p: Parameters, angle: float, whole: float, resolution: float
) -> np.ndarray | None:
    """Steps of a cycle that lasts `whole` s as shares of it, graded where friction turns over, and the spare ones."""
    start = {**p, "theta0": np.float64(angle), "omega0": np.float64(0.0)}
    mesh = frozen_mesh(osc, start, 2.0 * whole, resolution)
    last = int(np.searchsorted(mesh, whole * (1 - 1e-9)))
    steps = EVEN * math.ceil((last + SPARE) / EVEN)
    return np.diff(mesh[: steps + 1] / mesh[last]) if steps < mesh.size else None
