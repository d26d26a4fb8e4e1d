"""One cycle of the undamped motion at a given amplitude, and what damping takes out of it.

By quadrature, so for any restoring law and any sum of damping terms: with x = c + A sin φ the turning points are at
φ = ±π/2, where velocity and force are smooth functions of φ and Gauss and Legendre's rule converges fast.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from bayesdamp.numerics.lazily import jax, jnp, tree
from bayesdamp.physics.oscillator import Oscillator, Parameters
from bayesdamp.physics.rest import traced_newton

if TYPE_CHECKING:
    from jax import Array

NODES = 32
NEWTON = 30
CENTRING = 8


def _rule() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Nodes φ and weights between ±π/2, and the matrix that integrates from each node to π/2."""
    t, w = np.polynomial.legendre.leggauss(NODES)
    # ∫ P_k from a to 1 is (P_k−1(a) − P_k+1(a)) / (2k + 1), with 1 for P_−1.
    p = np.polynomial.legendre.legvander(t, NODES)
    above = 0.5 * (np.column_stack([np.ones(NODES), p[:, : NODES - 1]]) - p[:, 1:])
    part = above @ (p[:, :NODES].T * w)
    return 0.5 * np.pi * t, 0.5 * np.pi * w, 0.5 * np.pi * part


PHI, WEIGHT, BEYOND = _rule()
SINE, COSINE = np.sin(PHI), np.cos(PHI)


@tree(["period", "energy", "slope", "lost"])
@dataclass(frozen=True)
class Cycle:
    """period in s; energy above the equilibrium, its derivative by the amplitude and the energy lost in a cycle,
    all per inertia (rad²/s² and rad/s², or m). nan where there is no such motion."""

    period: Array
    energy: Array
    slope: Array
    lost: Array


def rest_position(osc: Oscillator, p: Parameters, near: Array | float) -> Array:
    """The equilibrium that Newton's method finds from `near` (rad), shape ()."""
    return traced_newton(lambda x: osc.law.force(x, p), near, NEWTON)


def cycle(osc: Oscillator, p: Parameters, amplitude: Array | float, near: float) -> Cycle:
    """The cycle of the undamped motion about the equilibrium nearest `near` (rad) with this amplitude, and the
    work of the damping force along it. Scalars in, scalars out; jit and vmap work on it.

    amplitude: half the distance between the turning points, rad or m, as a record shows it.
    """
    a = jnp.asarray(amplitude, float)

    def force(x: Array) -> Array:
        return osc.law.force(x, p)

    def centred(_, c: Array) -> Array:
        # Both turning points have the same potential energy: the force's mean between them is zero.
        rise = jnp.sum(WEIGHT * COSINE * force(c + a * SINE))
        return c - a * rise / (force(c + a) - force(c - a))

    rest = rest_position(osc, p, near)
    c = jax.lax.fori_loop(0, CENTRING, centred, rest)
    square = 2.0 * a * (BEYOND @ (COSINE * force(c + a * SINE)))
    velocity = jnp.sqrt(square)
    upper, lower = force(c + a), force(c - a)
    half = 0.5 * (c + a - rest)
    t, w = np.polynomial.legendre.leggauss(NODES)
    energy = half * jnp.sum(w * force(rest + half * (t + 1.0)))
    x = c + a * SINE
    drag = osc.damping_force(x, velocity, p) - osc.damping_force(x, -velocity, p)
    motion = jnp.all(square > 0) & (jax.grad(force)(rest) > 0) & (upper > 0) & (lower < 0)

    def or_nan(x: Array) -> Array:
        return jnp.where(motion, x, jnp.nan)

    return Cycle(
        period=or_nan(2.0 * jnp.sum(WEIGHT * a * COSINE / velocity)),
        energy=or_nan(energy),
        slope=or_nan(-2.0 * upper * lower / (upper - lower)),
        lost=or_nan(jnp.sum(WEIGHT * a * COSINE * drag)),
    )
