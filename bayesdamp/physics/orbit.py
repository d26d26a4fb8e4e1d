"""Compute one cycle of the undamped motion at a given amplitude, and the energy that damping removes in this cycle.

Integrals over the cycle use Gauss–Legendre quadrature, for any restoring law and any sum of damping terms. The position
is x = c + A sin φ, where A is the amplitude, c the midpoint between the two turning points, and φ a phase. The turning
points are at φ = ±π/2. The integrands are smooth in φ, so that the quadrature converges fast.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from bayesdamp.physics.forces import Force, newton_many, slope_of
from bayesdamp.physics.oscillator import Oscillator, Parameters

NODES, NEWTON_STEPS, CENTRING_STEPS = 32, 30, 8
"""Numbers of quadrature nodes, of Newton steps to the equilibrium, and of Newton steps to the midpoint between the two
turning points. Newton's method converges quadratically from a start near by, so both numbers of steps are ample;
convergence is not checked."""
_T, _W = np.polynomial.legendre.leggauss(NODES)
PHI, WEIGHT = 0.5 * np.pi * _T, 0.5 * np.pi * _W
"""Quadrature nodes for the phase φ between −π/2 and π/2, and their weights. The position is c + A sin φ, with the
amplitude A and the midpoint c of the turning points."""
SINE, COSINE = np.sin(PHI), np.cos(PHI)
_P = np.polynomial.legendre.legvander(_T, NODES)
# ∫_t^1 P_k ds = (P_{k−1}(t) − P_{k+1}(t)) / (2k + 1) for Legendre polynomials P_k, with P_{−1} = 1.
_LEGENDRE_INTEGRALS = 0.5 * (np.column_stack([np.ones(NODES), _P[:, : NODES - 1]]) - _P[:, 1:])
TO_TURNING_POINT = 0.5 * np.pi * (_LEGENDRE_INTEGRALS @ (_P[:, :NODES].T * _W))
"""Matrix (nodes, nodes) for integrals over the phase φ. Its product with the values of a function at the quadrature
nodes is the integral of the function from each node to the upper turning point, at φ = π/2."""


@dataclass(frozen=True)
class Orbit:
    """Half a cycle of the undamped motion, from the lower turning point to the upper; NaN where no such motion exists.

    Attributes
    ----------
    energy : ndarray, shape (...)
        Potential energy per inertia at the turning points minus that at the equilibrium, in rad²/s² or m²/s².
    x, velocity, weight : ndarray, shape (..., NODES)
        Positions (rad or m) at quadrature nodes, velocities there, and quadrature weights for integrals over x.
    upper, lower : ndarray, shape (...)
        Restoring force per inertia at the upper and the lower turning point, in rad/s² or m/s².
    """

    energy: np.ndarray
    x: np.ndarray
    velocity: np.ndarray
    weight: np.ndarray
    upper: np.ndarray
    lower: np.ndarray

    @property
    def period(self) -> np.ndarray:
        """Return the period of the oscillation, in s, shape (...)."""
        return 2.0 * np.sum(self.weight / self.velocity, axis=-1)

    @property
    def energy_slope(self) -> np.ndarray:
        """Return the derivative of the oscillation's energy by its amplitude, in rad/s² or m/s², shape (...).

        The energy is per unit of inertia.
        """
        # dE = F₊ dx₊ = F₋ dx₋ at the two turning points, and dA = (dx₊ − dx₋) / 2.
        return -2.0 * self.upper * self.lower / (self.upper - self.lower)


@dataclass(frozen=True)
class Cycle(Orbit):
    """A cycle of the undamped motion, with the energy that damping removes in it.

    energy_lost: this energy per unit of inertia, in rad²/s² or m²/s², shape (...); NaN where no such motion exists.
    """

    energy_lost: np.ndarray


def rest_position(osc: Oscillator, p: Parameters, near: ArrayLike) -> np.ndarray:
    """Return the equilibria that Newton's method reaches from the positions `near` (rad or m) in `NEWTON_STEPS` steps.

    osc: the oscillator. p: its parameters by name. Parameters and `near` are broadcast against each other. Convergence
    is not checked.
    """
    shape = np.broadcast_shapes(*(np.shape(p[n]) for n in osc.law.parameters), np.shape(near))
    return newton_many(lambda x: osc.law.force(x, p), np.broadcast_to(near, shape), NEWTON_STEPS)


def orbit_about(force: Force, rest: ArrayLike, amplitude: ArrayLike) -> Orbit:
    """Return half a cycle of the undamped motion about an equilibrium; NaN where no such motion exists.

    Parameters
    ----------
    force
        Restoring force per inertia, as a function of positions (..., n).
    rest
        The equilibrium, rad or m, shape (...).
    amplitude
        Half the distance between the turning points, rad or m, shape (...). It is broadcast against `rest`.
    """
    rest, a = (np.asarray(v, float)[..., None] for v in np.broadcast_arrays(rest, amplitude))
    with np.errstate(all="ignore"):  # invalid values occur where no periodic motion exists
        c = rest
        for _ in range(CENTRING_STEPS):
            # Both turning points have the same potential energy: ∫ F dx between them is zero. With x = c + a sin φ,
            # Newton's step is c -= ∫ F dx / (F(c + a) − F(c − a)).
            mean_force = np.sum(WEIGHT * COSINE * force(c + a * SINE), axis=-1, keepdims=True)
            c = c - a * mean_force / (force(c + a) - force(c - a))
        x = c + a * SINE
        # Undamped, v² = 2 ∫ F dx from x to the upper turning point.
        squared_velocity = 2.0 * a * ((COSINE * force(x)) @ TO_TURNING_POINT.T)
        # The energy is ∫ F dx from the equilibrium to the upper turning point.
        half = 0.5 * (c + a - rest)
        energy = half * np.sum(_W * force(rest + half * (_T + 1.0)), axis=-1, keepdims=True)
        upper, lower = force(c + a), force(c - a)
        exists = np.all(squared_velocity > 0, axis=-1, keepdims=True) & (slope_of(force, rest) > 0)
        exists = exists & (upper > 0) & (lower < 0)
        values = (energy, x, np.sqrt(squared_velocity), WEIGHT * a * COSINE, upper, lower)
    energy, x, velocity, weight, upper, lower = (np.where(exists, v, np.nan) for v in values)
    return Orbit(energy[..., 0], x, velocity, weight, upper[..., 0], lower[..., 0])


def cycle(osc: Oscillator, p: Parameters, amplitude: ArrayLike, rest: ArrayLike) -> Cycle:
    """Return the cycle of the undamped motion at an amplitude, and the energy that the damping force removes in it.

    The result is a `Cycle`. It contains the positions and velocities in half of the cycle, from which the period
    follows, and the energies. The arguments are broadcast against each other; arrays in the result have their common
    shape (and a last axis for the quadrature nodes, if they contain values at these nodes).

    Parameters
    ----------
    osc
        The oscillator.
    p
        Its parameters, and the equilibrium and reference scales that its damping terms need (`Oscillator.scales`), by
        name: numbers or arrays. theta0 and omega0 are not needed; epsilon is 0 if it is missing.
    amplitude
        Half the distance between the turning points, rad or m.
    rest
        The equilibrium about which the motion oscillates, rad or m (see `rest_position`).
    """
    given = {n: np.asarray(p[n], float) for n in osc.inputs if n in p}
    shape = np.broadcast_shapes(*(v.shape for v in given.values()), np.shape(amplitude), np.shape(rest))
    column = {n: np.broadcast_to(v, shape)[..., None] for n, v in given.items()}

    def force(x: np.ndarray) -> np.ndarray:
        return osc.law.force(x, column)

    orbit = orbit_about(force, np.broadcast_to(rest, shape), np.broadcast_to(amplitude, shape))
    with np.errstate(all="ignore"):
        # The work in both halves of the cycle is ∫ (F_damp(x, v) − F_damp(x, −v)) dx.
        there, back = (osc.damping_force(orbit.x, sign * orbit.velocity, column) for sign in (1.0, -1.0))
        return Cycle(**vars(orbit), energy_lost=np.sum(orbit.weight * (there - back), axis=-1))
