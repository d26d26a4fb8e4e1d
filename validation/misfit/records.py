"""Simulate oscillators inside and outside the family of models with SciPy.

The family consists of the sums of viscous, Coulomb and quadratic damping with the restoring laws of bayesdamp.
Units are normalised: the motion starts at 1 with zero velocity, and its frequency at small amplitudes is 1 rad per unit
of time. A damping is a function of the velocity; the spring is linear.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

import numpy as np
from scipy.integrate import solve_ivp

Force = Callable[[np.ndarray | float], np.ndarray | float]
"""A damping force as a function of the velocity, in normalised units."""
Function = Callable[[float], float]
"""A function of time, such as a driving force."""
Slope = Callable[[float, np.ndarray], Sequence[np.ndarray | float]]
"""The right-hand side of an equation of motion: it maps time and state to the derivative of the state by time."""

TERMS: Mapping[str, Callable[[float], Force]] = {
    "viscous": lambda eps: lambda v: 2 * v,
    "coulomb": lambda eps: lambda v: np.tanh(v / eps),
    "quadratic": lambda eps: lambda v: v * np.abs(v),
    "cubic": lambda eps: lambda v: v**3,
    "root": lambda eps: lambda v: v / (v * v + eps * eps) ** 0.25,
}
"""For each damping term a function that returns its force with the coefficient 1. Its argument eps is the velocity
within which a discontinuous term changes sign."""


def fall(damping: Force, amplitude: float) -> float:
    """Return the decrease of an amplitude per radian of phase, from the energy loss of a harmonic motion in a cycle.

    damping: the damping force as a function of the velocity. amplitude: amplitude of the motion in normalised units.
    """
    phase = (np.arange(720) + 0.5) * 2 * np.pi / 720
    return float(np.mean(np.asarray(damping(amplitude * np.cos(phase))) * np.cos(phase)))


def damping_of(shares: Mapping[str, float], cycles: float, left: float, eps: float = 0.02) -> Force:
    """Return the force of a sum of damping terms that reduces the amplitude from 1 to a given value.

    Parameters
    ----------
    shares
        Fraction of the energy loss that is due to each term, at an amplitude of 0.6.
    cycles
        Number of cycles in which the amplitude falls from 1 to `left`.
    left
        Amplitude after these cycles.
    eps
        Velocity within which a discontinuous term changes sign.
    """
    units = {n: TERMS[n](eps) for n in shares}
    weights = {n: share / fall(units[n], 0.6) for n, share in shares.items()}

    def unit(v: np.ndarray | float) -> np.ndarray | float:
        return sum(w * units[n](v) for n, w in weights.items())

    grid = np.geomspace(left, 1.0, 200)
    phase = np.trapezoid(1 / np.array([fall(unit, a) for a in grid]), grid)
    scale = phase / (2 * np.pi * cycles)
    return lambda v: scale * unit(v)


def single(
    damping: Force,
    times: np.ndarray,
    drive: Function = lambda t: 0.0,
    loss: Function = lambda t: 1.0,
    stiffness: Function = lambda t: 1.0,
) -> np.ndarray:
    """Return the positions, (n,), at these times of an oscillator with this damping force.

    drive, loss, stiffness: a driving force, and factors on the damping and on the stiffness, as functions of time.
    """

    def slope(t, s):
        return [s[1], drive(t) - loss(t) * damping(s[1]) - stiffness(t) * s[0]]

    return _solved(slope, [1.0, 0.0], times)


def coupled(damping: Force, times: np.ndarray, coupling: float, detuning: float) -> np.ndarray:
    """Return the positions, (n,), of one of two coupled oscillators. The other starts at 0 with zero velocity.

    coupling: stiffness of the coupling spring; detuning: amount by which the stiffness of the other oscillator is
    larger; both relative to the stiffness of the first one.
    """

    def slope(t, s):
        pull = coupling * (s[0] - s[2])
        return [
            s[1], -damping(s[1]) - s[0] - pull,
            s[3], -damping(s[3]) - (1 + detuning) * s[2] + pull,
        ]  # fmt: skip

    return _solved(slope, [1.0, 0.0, 0.0, 0.0], times)


def sticking(kinetic: float, static: float, speed: float, times: np.ndarray) -> np.ndarray:
    """Return the positions of an oscillator with Stribeck friction, which may stick.

    The friction falls from `static` at rest to `kinetic` within the velocity `speed`; its sign is not smoothed.
    After it sticks, the position is constant. kinetic, static: frictions relative to the spring force at the initial
    displacement. times: increasing times from 0, (n,), also the shape of the result.
    """
    out = np.empty(times.size)
    t, x, done = 0.0, 1.0, 0
    while True:
        if abs(x) <= static:  # it sticks
            out[done:] = x
            return out
        sign = -np.sign(x)

        def slope(_, s, sign=sign):
            return [s[1], -s[0] - sign * (kinetic + (static - kinetic) * np.exp(-((s[1] / speed) ** 2)))]

        def stops(_, s, sign=sign):
            return sign * s[1]

        stops.terminal, stops.direction = True, -1  # pyright: ignore[reportFunctionMemberAccess]
        piece = solve_ivp(
            slope, (t, t + 20.0), [x, sign * 1e-12], "DOP853", events=stops, rtol=1e-9, atol=1e-11, dense_output=True
        )  # fmt: skip
        t, x = float(piece.t[-1]), float(piece.y[0, -1])
        last = int(np.searchsorted(times, t))
        out[done:last] = piece.sol(times[done:last])[0]
        done = last
        if done >= times.size:
            return out


def _solved(slope: Slope, start: list[float], times: np.ndarray) -> np.ndarray:
    """Solve an equation of motion from the state `start`; return the positions, the first components, at times (n,)."""
    end = float(times[-1])
    return solve_ivp(slope, (0.0, end), start, "DOP853", times, rtol=1e-9, atol=1e-11, max_step=0.5).y[0]
