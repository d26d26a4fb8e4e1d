"""Compute one cycle of the undamped motion at a given amplitude, and the energy that damping removes in this cycle.

Integrals over the cycle use Gauss–Legendre quadrature, for any restoring law and any sum of damping terms. The position
is x = c + A sin φ, with the amplitude A and the centre c of the two turning points, which are at φ = ±π/2. The
integrands are smooth in φ, so that the quadrature converges fast.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from bayesdamp.physics.forces import newton_many, slope_of
from bayesdamp.physics.oscillator import Oscillator, Parameters

NODES, NEWTON_STEPS, CENTRING_STEPS = 32, 30, 8
"""Numbers of quadrature nodes, of Newton steps to the equilibrium, and of Newton steps to the centre of the two turning
points. Newton's method converges quadratically from a start near by, so both numbers of steps are ample; convergence is
not checked."""
_T, _W = np.polynomial.legendre.leggauss(NODES)
PHI, WEIGHT = 0.5 * np.pi * _T, 0.5 * np.pi * _W
"""Quadrature nodes φ (phase of the position) between −π/2 and π/2, and their weights."""
SINE, COSINE = np.sin(PHI), np.cos(PHI)
_P = np.polynomial.legendre.legvander(_T, NODES)
# ∫_t^1 P_k ds = (P_{k−1}(t) − P_{k+1}(t)) / (2k + 1) for Legendre polynomials P_k, with P_{−1} = 1.
_LEGENDRE_INTEGRALS = 0.5 * (np.column_stack([np.ones(NODES), _P[:, : NODES - 1]]) - _P[:, 1:])
TO_TURNING_POINT = 0.5 * np.pi * (_LEGENDRE_INTEGRALS @ (_P[:, :NODES].T * _W))
"""Matrix (nodes, nodes) that integrates: its product with the values of a function at the nodes gives the integrals of
the function over φ from each node to the upper turning point at π/2."""


@dataclass(frozen=True)
class Cycle:
    """A cycle of the undamped motion; all values are NaN where no such periodic motion exists.

    period: in s. energy: potential energy at the turning points minus that at the equilibrium. energy_slope: derivative
    of the energy with respect to the amplitude. energy_lost: energy that damping removes in the cycle. Energies are per
    unit of inertia, in rad²/s² (their slope in rad/s²), with m in place of rad for a translation.
    """

    period: np.ndarray
    energy: np.ndarray
    energy_slope: np.ndarray
    energy_lost: np.ndarray


def rest_position(osc: Oscillator, p: Parameters, near: ArrayLike) -> np.ndarray:
    """Return the equilibria that Newton's method reaches from `near` (rad or m) after `NEWTON_STEPS` steps.

    p: parameters of the oscillator by name. Parameters and `near` are broadcast against each other.
    """
    shape = np.broadcast_shapes(*(np.shape(p[n]) for n in osc.law.parameters), np.shape(near))
    return newton_many(lambda x: osc.law.force(x, p), np.broadcast_to(near, shape), NEWTON_STEPS)


def cycle(osc: Oscillator, p: Parameters, amplitude: ArrayLike, near: ArrayLike) -> Cycle:
    """Return the cycle of the undamped motion at an amplitude, and the work of the damping force along it.

    All arguments that are arrays are broadcast against each other; the result has their common shape.

    Parameters
    ----------
    osc
        The oscillator.
    p
        Its parameters, by name.
    amplitude
        Half the distance between the turning points, rad or m, as in a record.
    near
        A position near the equilibrium, rad or m.
    """
    given = {n: np.asarray(p[n], float) for n in osc.inputs if n in p}
    shape = np.broadcast_shapes(*(v.shape for v in given.values()), np.shape(amplitude), np.shape(near))
    column = {n: np.broadcast_to(v, shape)[..., None] for n, v in given.items()}
    a = np.broadcast_to(np.asarray(amplitude, float), shape)[..., None]

    def force(x: np.ndarray) -> np.ndarray:
        return osc.law.force(x, column)

    with np.errstate(all="ignore"):  # invalid values occur where no periodic motion exists
        rest = newton_many(force, np.broadcast_to(np.asarray(near, float), shape)[..., None], NEWTON_STEPS)
        c = rest
        for _ in range(CENTRING_STEPS):
            # Both turning points have the same potential energy: ∫ F dx between them is zero. With x = c + a sin φ,
            # Newton's step is c -= ∫ F dx / (F(c + a) − F(c − a)).
            mean_force = np.sum(WEIGHT * COSINE * force(c + a * SINE), axis=-1, keepdims=True)
            c = c - a * mean_force / (force(c + a) - force(c - a))
        # Undamped, v² = 2 ∫ F dx from x to the upper turning point.
        squared_velocity = 2.0 * a * ((COSINE * force(c + a * SINE)) @ TO_TURNING_POINT.T)
        velocity = np.sqrt(squared_velocity)
        upper, lower = force(c + a), force(c - a)
        # The energy is ∫ F dx from the equilibrium to the upper turning point.
        half = 0.5 * (c + a - rest)
        energy = half * np.sum(_W * force(rest + half * (_T + 1.0)), axis=-1, keepdims=True)
        x = c + a * SINE
        # Forward and return half: the work is ∫ (F_damp(x, v) − F_damp(x, −v)) dx.
        drag = osc.damping_force(x, velocity, column) - osc.damping_force(x, -velocity, column)
        exists = np.all(squared_velocity > 0, axis=-1, keepdims=True) & (slope_of(force, rest) > 0)
        exists = exists & (upper > 0) & (lower < 0)
        period = 2.0 * np.sum(WEIGHT * a * COSINE / velocity, axis=-1, keepdims=True)
        # dE/dA follows from dE = F₊ dx₊ = F₋ dx₋ at the two turning points, and dA = (dx₊ − dx₋) / 2.
        energy_slope = -2.0 * upper * lower / (upper - lower)
        energy_lost = np.sum(WEIGHT * a * COSINE * drag, axis=-1, keepdims=True)

    def where_exists(value: np.ndarray) -> np.ndarray:
        return np.where(exists, value, np.nan)[..., 0]

    return Cycle(
        period=where_exists(period),
        energy=where_exists(energy),
        energy_slope=where_exists(energy_slope),
        energy_lost=where_exists(energy_lost),
    )
