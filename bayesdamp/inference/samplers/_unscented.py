"""One pass of an unscented Kalman filter over a record: angle, velocity, and parameters that do not change."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache

import jax
import numpy as np
from jax import Array
from jax import numpy as jnp

from bayesdamp.inference.fit.mode import Mode, mesh_of
from bayesdamp.inference.model.density import moving_scores, parameters
from bayesdamp.inference.model.target import Context, Layout, Target
from bayesdamp.physics.solver.mesh import LAYER, STEPS_PER_PERIOD, fastest_rate
from bayesdamp.physics.solver.plan import QUANTITIES
from bayesdamp.physics.solver.stepper import step
from bayesdamp.physics.solver.steps import nodes

HALF_NORMAL = (math.sqrt(2 / math.pi), math.sqrt(1 - 2 / math.pi))
"""Mean and sd of a reflected score under its prior."""


@dataclass(frozen=True)
class Online:
    """What the filter held after each sample: means and sds of the k moving scores, (n, k), and the last
    covariance, (k, k)."""

    means: np.ndarray
    sds: np.ndarray
    covariance: np.ndarray


def filter_online(target: Target, mode: Mode) -> Online:
    """One pass from the priors, each sample used once and in its turn.

    The state is (scores, θ, θ̇) with no process noise; its sigma points, 2(k + 2) at √(k + 2) sds with equal weights
    (Julier and Uhlmann's with κ = 0), are drawn anew after each sample and moved to the next by Runge–Kutta steps,
    short against the period and against the time ε/|θ̈| in which friction turns. A reflected score starts with mean and
    sd of a half-normal: about zero the filter would see no slope. A scale that coefficients share is held at 1, a
    damping ratio of 0.1. From the mode come the sd of the noise and the step.
    """
    layout, index = target.layout, moving_scores(target.layout)
    k, signal = len(index), target.signal
    p = {n: jnp.asarray(v) for n, v in target.all_values(mode.z).items()}
    gaps = np.r_[0.0, np.diff(signal.t)]
    counts = np.ceil(gaps / _longest_step(target, mode, p)).astype(int)
    reflected = np.asarray(layout.reflected)[index]
    mean = np.where(reflected, HALF_NORMAL[0], 0.0)
    sd = np.where(reflected, HALF_NORMAL[1], 1.0)
    start, run = _pass(layout, signal.quantity)
    noise = float(p["noise_sd"])
    # The noise's own scores are held at the mode.
    whole = jnp.asarray(mode.z)
    means, covariances = run(
        mode.context, whole, *start(mode.context, whole, mean, sd), noise, jnp.asarray(gaps), counts
    )
    variances = np.asarray(jnp.diagonal(covariances, axis1=1, axis2=2))
    last = np.asarray(covariances[-1])[:k, :k]
    return Online(np.asarray(means)[:, :k], np.sqrt(variances[:, :k]), last)


def _longest_step(target: Target, mode: Mode, p: dict[str, Array]) -> float:
    osc = target.oscillator
    longest = 2 * math.pi / fastest_rate(osc, p) / STEPS_PER_PERIOD
    if osc.switches and not target.exact_friction:
        plan = mesh_of(target, mode)
        sharpest = float(jnp.max(jnp.abs(nodes(osc, plan.steps, plan.count, p)[:, 2])))
        longest = min(longest, LAYER * 0.5 * math.pi * float(p["epsilon"]) / sharpest)
    return longest


@lru_cache(maxsize=32)
def _pass(layout: Layout, quantity: str):
    """Compiled for a layout: the first state's mean and covariance, and the pass over the samples."""
    osc, index = layout.oscillator, jnp.asarray(moving_scores(layout))
    k, order = len(moving_scores(layout)), QUANTITIES.index(quantity)

    def values(context: Context, whole: Array, u: Array) -> dict[str, Array]:
        return parameters(layout, context, whole.at[index].set(u))

    @jax.jit
    def start(context: Context, whole: Array, mean: Array, sd: Array) -> tuple[Array, Array]:
        away = math.sqrt(k) * jnp.diag(sd)

        def state(u: Array) -> Array:
            p = values(context, whole, u)
            return jnp.concatenate([u, jnp.stack([p["theta0"], p["omega0"]])])

        points = jax.vmap(state)(jnp.concatenate([mean + away, mean - away]))
        centre = jnp.mean(points, axis=0)
        return centre, (points - centre).T @ (points - centre) / (2 * k)

    def spread(mean: Array, covariance: Array) -> Array:
        # By eigenvectors of the correlations: at first θ and θ̇ follow from the scores, and no Cholesky factor exists.
        sd = jnp.sqrt(jnp.maximum(jnp.diag(covariance), 1e-300))
        lengths, axes = jnp.linalg.eigh(covariance / sd[:, None] / sd)
        away = math.sqrt(k + 2) * sd[:, None] * axes * jnp.sqrt(jnp.maximum(lengths, 0.0))
        return jnp.concatenate([mean + away.T, mean - away.T])

    @jax.jit
    def run(
        context: Context, whole: Array, mean: Array, covariance: Array, noise, gaps: Array, counts: Array
    ):
        def move(x: Array, gap: Array, count: Array) -> tuple[Array, Array]:
            p = values(context, whole, x[:k])

            def acceleration(theta: Array, omega: Array) -> Array:
                return osc.acceleration(theta, omega, p)

            h = gap / jnp.maximum(count, 1)
            theta, omega = jax.lax.fori_loop(
                0, count, lambda _, s: step(acceleration, h, *s)[:2], (x[k], x[k + 1])
            )
            seen = (theta, omega, acceleration(theta, omega))[order]
            return jnp.concatenate([x[:k], jnp.stack([theta, omega])]), seen

        def advance(held: tuple[Array, Array], sample: tuple[Array, Array, Array]):
            y, gap, count = sample
            points, seen = jax.vmap(move, in_axes=(0, None, None))(spread(*held), gap, count)
            mean, expected = jnp.mean(points, axis=0), jnp.mean(seen)
            about, off = points - mean, seen - expected
            variance = jnp.mean(off**2) + noise**2
            gain = about.T @ off / off.size / variance
            covariance = about.T @ about / off.size - variance * jnp.outer(gain, gain)
            held = (mean + gain * (y - expected), 0.5 * (covariance + covariance.T))
            return held, held

        return jax.lax.scan(advance, (mean, covariance), (context.y, gaps, counts))[1]

    return start, run
