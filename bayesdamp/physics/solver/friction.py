"""Exact dry friction (ε = 0): from turning point to turning point, with sticking.

Between two turning points the sign of the velocity is constant and the equation is smooth. Each half-cycle
takes a fixed number of steps whose length belongs to the reference trajectory, then one step in the velocity
lands on θ̇ = 0. There the sign flips, or, where the restoring force is no greater than the friction, the
motion ends.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import lru_cache, partial
from typing import TYPE_CHECKING

import numpy as np

from bayesdamp.numerics.lazily import jax, jnp, tree
from bayesdamp.physics.oscillator import Oscillator, Parameters
from bayesdamp.physics.solver.hermite import basis
from bayesdamp.physics.solver.mesh import fastest_rate
from bayesdamp.physics.solver.plan import QUANTITIES, Plan
from bayesdamp.physics.solver.stepper import land, step
from bayesdamp.types import Refusal

if TYPE_CHECKING:
    from jax import Array

STEPS_PER_HALF_CYCLE = 16


@tree(["steps", "times"], ["per_half_cycle", "derivative"])
@dataclass(frozen=True)
class TurningPlan(Plan):
    """Step length of each half-cycle in s, shape (k,), and the samples' times in s, shape (n,)."""

    steps: Array
    times: Array
    per_half_cycle: int
    derivative: int

    def record(self, osc: Oscillator, p: Parameters) -> Array:
        """The motion at the samples, from half cycles between turning points, until friction holds it."""
        nodes = _half_cycles(osc, self.steps, self.per_half_cycle, p)
        turning = nodes[:, -1, 0]
        cycle = jnp.clip(jnp.searchsorted(turning, self.times), 0, nodes.shape[0] - 1)
        since = self.times - nodes[cycle, 0, 0]
        h = self.steps[cycle]
        within = jnp.clip(jnp.floor(since / h).astype(int), 0, self.per_half_cycle - 1)
        # The short last interval runs from the last step to the turning point; where the landing went backwards,
        # samples before the turning point lie in the steps alone.
        last = self.times > nodes[cycle, self.per_half_cycle, 0]
        within = jnp.where(last, self.per_half_cycle, within)
        left, right = nodes[cycle, within], nodes[cycle, within + 1]
        length = right[:, 0] - left[:, 0]
        usable = jnp.where(length > 0, length, 1.0)
        weights = basis((self.times - left[:, 0]) / usable, usable, self.derivative)
        pair = jnp.concatenate([left[:, 1:], right[:, 1:]], axis=1)
        return jnp.sum(pair * weights, axis=1)

    def of(self, samples: slice) -> TurningPlan:
        """Of some of the samples."""
        return replace(self, times=self.times[samples])

    def at(self, times: np.ndarray, quantity: str) -> TurningPlan:
        """At other times, of another derivative."""
        derivative = QUANTITIES.index(quantity)
        return replace(self, times=jax.device_put(np.asarray(times, float)), derivative=derivative)

    def finer(
        self, osc: Oscillator, p: Parameters, parts: int, times: np.ndarray, quantity: str
    ) -> TurningPlan:
        """With so many times the steps in each half cycle."""
        del osc, p, times, quantity
        return replace(self, steps=self.steps / parts, per_half_cycle=parts * self.per_half_cycle)


def no_exact_switch(term: str) -> str:
    """Why a damping term is not sampled under a friction that turns over at once."""
    return f"{term} damping is not the sign of the velocity alone: with it epsilon must be above 0"


def _forces(osc: Oscillator, p: Parameters):
    """Acceleration at a given sign of the velocity, and the friction that a body at rest can bear.

    Raises Refusal where a term that switches is more than its sign.
    """
    p = osc.settled(p)
    more = [t.name for t in osc.terms if t.switches and not t.shaped]
    if more:
        raise Refusal(no_exact_switch(more[0]))
    switching = [t for t in osc.terms if t.switches]
    smooth = [t for t in osc.terms if not t.switches]
    friction = sum((p[t.parameter] for t in switching), jnp.asarray(0.0))

    def acceleration(sign: Array, theta: Array, omega: Array) -> Array:
        shapes = (t.force(theta, omega, 1.0, *(p[n] for n in t.further)) for t in smooth)
        pairs = zip(smooth, shapes, strict=True)
        drag = sum((p[t.parameter] * one for t, one in pairs), jnp.zeros_like(omega))
        return -drag - friction * sign - osc.law.force(theta, p)

    return acceleration, friction


def _half_cycles(osc: Oscillator, steps: Array, per_half_cycle: int, p: Parameters):
    """Per half-cycle: node times, θ, θ̇, θ̈ (each per_half_cycle + 2), the last being the turning point."""
    acceleration, friction = _forces(osc, p)

    def half_cycle(carry, h):
        t, theta, omega, moved = carry
        force = -osc.law.force(theta, p)
        stuck = (omega == 0.0) & (jnp.abs(force) <= friction)
        sign = jnp.where(omega == 0.0, jnp.sign(force), jnp.sign(omega))
        sign = jnp.where(stuck, 0.0, sign)

        def rate(th: Array, om: Array) -> Array:
            return jnp.where(stuck, 0.0, acceleration(sign, th, om))

        def advance(state, _):
            t, th, om = state
            new_th, new_om, before = step(rate, h, th, om)
            return (t + h, new_th, new_om), (t, th, om, before)

        (t1, th1, om1), inner = jax.lax.scan(advance, (t, theta, omega), None, length=per_half_cycle)
        a1 = rate(th1, om1)

        def safe(th: Array, om: Array) -> Array:
            return jnp.where(stuck, 1.0, acceleration(sign, th, om))

        extra, th2 = land(safe, th1, om1)
        t2, th2 = jnp.where(stuck, t1, t1 + extra), jnp.where(stuck, th1, th2)
        zero = jnp.zeros_like(th2)
        tail = jnp.stack([jnp.stack([t1, th1, om1, a1]), jnp.stack([t2, th2, zero, rate(th2, zero)])])
        nodes = jnp.concatenate([jnp.stack(inner, axis=1), tail])
        return (t2, th2, zero, moved), nodes

    start = (jnp.asarray(0.0), jnp.asarray(p["theta0"], float), jnp.asarray(p["omega0"], float), 0.0)
    return jax.lax.scan(half_cycle, start, steps)[1]


@lru_cache(maxsize=64)
def _to_turn(osc: Oscillator, count: int):
    """Compiled: march one reference half-cycle in steps of h until the velocity has changed its sign."""

    @jax.jit
    def march(p, h, theta, omega):
        acceleration, friction = _forces(osc, p)
        force = -osc.law.force(theta, p)
        stuck = (omega == 0.0) & (jnp.abs(force) <= friction)
        sign = jnp.where(omega == 0.0, jnp.sign(force), jnp.sign(omega))

        def going(state):
            i, _, om, _ = state
            return (i < count) & ((i == 0) | (om * sign > 0)) & ~stuck

        def advance(state):
            i, th, om, t = state
            th, om, _ = step(partial(acceleration, sign), h, th, om)
            return i + 1, th, om, t + h

        i, th, om, t = jax.lax.while_loop(going, advance, (0, theta, omega, jnp.asarray(0.0)))
        extra, th = land(partial(acceleration, sign), th, om)
        return t + extra, th, stuck, i >= count

    return march


def turning_plan(
    osc: Oscillator, p: Parameters, times: np.ndarray, quantity: str, resolution: float
) -> TurningPlan:
    """Half-cycles of the trajectory at `p` over the samples (s, from 0), and a margin for others near it."""
    per_half_cycle = math.ceil(STEPS_PER_HALF_CYCLE * resolution)
    rate = fastest_rate(osc, p)
    march = _to_turn(osc, 4096)
    theta, omega, t = jnp.asarray(p["theta0"], float), jnp.asarray(p["omega0"], float), 0.0
    lengths: list[float] = []
    end = float(times[-1])
    while t < end:
        length, theta, stuck, endless = march(p, math.pi / rate / STEPS_PER_HALF_CYCLE, theta, omega)
        if bool(stuck) or bool(endless) or not np.isfinite(float(length)):
            break
        lengths.append(float(length))
        omega = jnp.asarray(0.0)
        t += float(length)
    usual = lengths[-1] if lengths else math.pi / rate
    remaining = max(end - sum(lengths), 0.0)
    lengths += [usual] * (max(2, math.ceil(0.05 * len(lengths))) + math.ceil(remaining / usual))
    return TurningPlan(
        jax.device_put(np.asarray(lengths) / per_half_cycle),
        jax.device_put(np.asarray(times, float)),
        per_half_cycle,
        QUANTITIES.index(quantity),
    )
