"""Compute one cycle of the undamped motion at a given amplitude, and the energy that damping takes out of it.

Quadrature allows any restoring law and any sum of damping terms: with x = c + A sin φ the turning points are at
φ = ±π/2, where velocity and force are smooth functions of φ and Gauss and Legendre's rule converges fast.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from bayesdamp.physics.forces import newton_many, slope_of
from bayesdamp.physics.oscillator import Oscillator, Parameters

NODES, NEWTON, CENTRING = 32, 30, 8
"""Nodes of the quadrature; steps to the equilibrium and to the middle of the turning points."""
_T, _W = np.polynomial.legendre.leggauss(NODES)
PHI, WEIGHT = 0.5 * np.pi * _T, 0.5 * np.pi * _W
"""Nodes between ±π/2 and their weights."""
SINE, COSINE = np.sin(PHI), np.cos(PHI)
_P = np.polynomial.legendre.legvander(_T, NODES)
# ∫ P_k from a to 1 is (P_k−1(a) − P_k+1(a)) / (2k + 1), with 1 for P_−1.
_ABOVE = 0.5 * (np.column_stack([np.ones(NODES), _P[:, : NODES - 1]]) - _P[:, 1:])
BEYOND = 0.5 * np.pi * (_ABOVE @ (_P[:, :NODES].T * _W))
"""The matrix that integrates from each node to π/2."""


@dataclass(frozen=True)
class Cycle:
    """A cycle of the undamped motion; NaN where there is no such motion.

    period: in s; energy, slope, lost: energy above the equilibrium, its derivative by the amplitude, and the energy
    lost in a cycle, all per inertia (rad²/s² and rad/s², or m for rad).
    """

    period: np.ndarray
    energy: np.ndarray
    slope: np.ndarray
    lost: np.ndarray


def rest_position(osc: Oscillator, p: Parameters, near: ArrayLike) -> np.ndarray:
    """Return the equilibria that Newton's method finds from `near` (rad), with the parameters' shape."""
    shape = np.broadcast_shapes(*(np.shape(p[n]) for n in osc.law.parameters), np.shape(near))
    return newton_many(lambda x: osc.law.force(x, p), np.broadcast_to(near, shape), NEWTON)


def cycle(osc: Oscillator, p: Parameters, amplitude: ArrayLike, near: ArrayLike) -> Cycle:
    """Return the cycle of the undamped motion, with the work of the damping force along it. Arrays broadcast.

    Parameters
    ----------
    osc
        The oscillator.
    p
        Its parameters.
    amplitude
        Half the distance between the turning points, rad or m, as in a record.
    near
        A place near the equilibrium, rad or m.
    """
    given = {n: np.asarray(p[n], float) for n in osc.inputs if n in p}
    shape = np.broadcast_shapes(*(v.shape for v in given.values()), np.shape(amplitude), np.shape(near))
    column = {n: np.broadcast_to(v, shape)[..., None] for n, v in given.items()}
    a = np.broadcast_to(np.asarray(amplitude, float), shape)[..., None]

    def force(x: np.ndarray) -> np.ndarray:
        return osc.law.force(x, column)

    with np.errstate(all="ignore"):  # where there is no such motion
        rest = newton_many(force, np.broadcast_to(np.asarray(near, float), shape)[..., None], NEWTON)
        c = rest
        for _ in range(CENTRING):
            # Both turning points have the same potential energy: the force's mean between them is zero.
            rise = np.sum(WEIGHT * COSINE * force(c + a * SINE), axis=-1, keepdims=True)
            c = c - a * rise / (force(c + a) - force(c - a))
        square = 2.0 * a * ((COSINE * force(c + a * SINE)) @ BEYOND.T)
        velocity = np.sqrt(square)
        upper, lower = force(c + a), force(c - a)
        half = 0.5 * (c + a - rest)
        energy = half * np.sum(_W * force(rest + half * (_T + 1.0)), axis=-1, keepdims=True)
        x = c + a * SINE
        drag = osc.damping_force(x, velocity, column) - osc.damping_force(x, -velocity, column)
        motion = np.all(square > 0, axis=-1, keepdims=True) & (slope_of(force, rest) > 0)
        motion = motion & (upper > 0) & (lower < 0)
        values = (
            2.0 * np.sum(WEIGHT * a * COSINE / velocity, axis=-1, keepdims=True),
            energy,
            -2.0 * upper * lower / (upper - lower),
            np.sum(WEIGHT * a * COSINE * drag, axis=-1, keepdims=True),
        )
    return Cycle(*(np.where(motion, value, np.nan)[..., 0] for value in values))
