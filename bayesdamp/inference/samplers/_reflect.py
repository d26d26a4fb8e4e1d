"""Leapfrog steps that bounce off walls."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import jax
from blackjax.mcmc.integrators import IntegratorState
from jax import Array
from jax import numpy as jnp

BOUNCES = 4
"""Bounces in one step, for each wall; a step that would take more ends outside, where it is refused."""


def drift(u: Array, p: Array, time: Array, walls: Array, offsets: Array) -> tuple[Array, Array]:
    """Position (d,) and momentum (d,) after `time` of straight flight within walls @ u + offsets ≥ 0, (k, d), (k,).

    At a wall the momentum is mirrored: time can be run backwards and volume is kept, so that a leapfrog step
    made of it is as good as one without walls (Afshar and Domke, NeurIPS 28, 2015). time may be negative.
    """
    if not walls.shape[0]:
        return u + time * p, p
    towards = jnp.sign(time)

    def bounce(_, state: tuple[Array, Array, Array]) -> tuple[Array, Array, Array]:
        u, v, left = state
        closing = -(walls @ v)
        until = jnp.where(closing > 0, jnp.maximum(walls @ u + offsets, 0.0) / closing, jnp.inf)
        first = jnp.argmin(until)
        hit = until[first] < left
        flight = jnp.where(hit, until[first], left)
        normal = walls[first] / jnp.linalg.norm(walls[first])
        turned = v - 2.0 * (normal @ v) * normal
        return u + flight * v, jnp.where(hit, turned, v), left - flight

    start = (u, towards * p, jnp.abs(time))
    u, v, left = jax.lax.fori_loop(0, BOUNCES * walls.shape[0], bounce, start)
    return jnp.where(left > 0, jnp.nan, u), towards * v


def reflecting_leapfrog(
    value: Callable[[Array], Array], force: Callable[[Array], Array], walls: Array, offsets: Array
):
    """A leapfrog integrator for BlackJAX: kicks by `force`, flights within the walls, energies by `value`.

    The force need not be the gradient of the value: each kick is a shear of the momenta, whatever it is.
    """

    def integrator(*_: object) -> Callable[[Any, Any], IntegratorState]:
        def step(state: Any, size: Any) -> IntegratorState:
            u, p, _, slope = state
            u, p = drift(u, p + 0.5 * size * slope, size, walls, offsets)
            slope = force(u)
            height: Any = value(u)
            return IntegratorState(u, p + 0.5 * size * slope, height, slope)

        return step

    return integrator
