"""Records of oscillators that are, and are not, of the family that is compared; solved by SciPy alone.

Everything here is in units of the motion: the start is 1 and at rest, the small-amplitude frequency is 1 rad per unit
of time. A damping is a function of the velocity, a restoring force one of the position.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np
from scipy.integrate import solve_ivp

Force = Callable[[np.ndarray | float], np.ndarray | float]
Restoring = Callable[[float], float]

TERMS: Mapping[str, Callable[[float], Force]] = {
    "viscous": lambda eps: lambda v: 2 * v,
    "coulomb": lambda eps: lambda v: np.tanh(v / eps),
    "quadratic": lambda eps: lambda v: v * np.abs(v),
    "cubic": lambda eps: lambda v: v**3,
    "root": lambda eps: lambda v: v / (v * v + eps * eps) ** 0.25,
}
"""Damping terms of coefficient 1; eps: the velocity within which a switching one turns over."""


def fall(damping: Force, amplitude: float) -> float:
    """How fast the amplitude falls a radian, by the energy that is lost on a harmonic cycle of that amplitude."""
    phase = (np.arange(720) + 0.5) * 2 * np.pi / 720
    return float(np.mean(np.asarray(damping(amplitude * np.cos(phase))) * np.cos(phase)))


def damping_of(shares: Mapping[str, float], cycles: float, left: float, eps: float = 0.02) -> Force:
    """A sum of terms that leaves the share `left` of the amplitude after so many cycles.

    shares: term to its share in the loss at an amplitude of 0.6.
    """
    units = {n: TERMS[n](eps) for n in shares}
    weights = {n: share / fall(units[n], 0.6) for n, share in shares.items()}

    def unit(v):
        return sum(w * units[n](v) for n, w in weights.items())

    grid = np.geomspace(left, 1.0, 200)
    turned = np.trapezoid(1 / np.array([fall(unit, a) for a in grid]), grid)
    scale = turned / (2 * np.pi * cycles)
    return lambda v: scale * unit(v)


def free(damping: Force, restoring: Restoring, times: np.ndarray) -> np.ndarray:
    """Positions (n,) of one oscillator."""
    return _solved(lambda t, s: [s[1], -damping(s[1]) - restoring(s[0])], [1.0, 0.0], times)


def driven(
    damping: Force, restoring: Restoring, times: np.ndarray, frequency: float, amplitude: float, phase: float
) -> np.ndarray:
    """The same with a harmonic force, whose steady motion alone would have the given amplitude."""
    force = amplitude * max(abs(1 - frequency**2), 0.02)

    def slope(t, s):
        return [s[1], force * np.cos(frequency * t + phase) - damping(s[1]) - restoring(s[0])]

    return _solved(slope, [1.0, 0.0], times)


def changing(
    damping: Force, times: np.ndarray, damping_grows: float = 0.0, stiffness_grows: float = 0.0
) -> np.ndarray:
    """Damping exp(±) and stiffness 1 + … over the record: neither is one of position or velocity alone."""
    end = float(times[-1])

    def slope(t, s):
        loss = np.exp(damping_grows * (t / end - 0.5)) * damping(s[1])
        return [s[1], -loss - (1 + stiffness_grows * t / end) * s[0]]

    return _solved(slope, [1.0, 0.0], times)


def coupled(damping: Force, times: np.ndarray, coupling: float, detuning: float) -> np.ndarray:
    """One of two coupled oscillators; the other starts at rest in its zero."""

    def slope(t, s):
        pull = coupling * (s[0] - s[2])
        return [
            s[1], -damping(s[1]) - s[0] - pull,
            s[3], -damping(s[3]) - (1 + detuning) * s[2] + pull,
        ]  # fmt: skip

    return _solved(slope, [1.0, 0.0, 0.0, 0.0], times)


def sticking(kinetic: float, static: float, speed: float, times: np.ndarray) -> np.ndarray:
    """Dry friction that falls from static to kinetic within `speed` (Stribeck), of exact sign; it holds at a stop."""
    out = np.empty(times.size)
    t, x, done = 0.0, 1.0, 0
    while True:
        if abs(x) <= static:  # it holds
            out[done:] = x
            return out
        sign = -np.sign(x)

        def slope(_, s, sign=sign):
            return [s[1], -s[0] - sign * (kinetic + (static - kinetic) * np.exp(-((s[1] / speed) ** 2)))]

        def stops(_, s, sign=sign):
            return sign * s[1]

        stops.terminal, stops.direction = True, -1
        begin = [x, sign * 1e-12]
        found = solve_ivp(
            slope,
            (t, t + 20.0),
            begin,
            method="DOP853",
            events=stops,
            rtol=1e-9,
            atol=1e-11,
            dense_output=True,
        )
        stop = float(found.t[-1])
        last = int(np.searchsorted(times, stop))
        out[done:last] = found.sol(times[done:last])[0]
        done, t, x = last, stop, float(found.y[0, -1])
        if done >= times.size:
            return out


def second_mode(
    times: np.ndarray, amplitude: float, frequency: float, ratio: float, phase: float
) -> np.ndarray:
    """A decaying sinusoid, in closed form."""
    return amplitude * np.exp(-ratio * frequency * times) * np.cos(frequency * times + phase)


def _solved(slope, start: list[float], times: np.ndarray) -> np.ndarray:
    found = solve_ivp(
        slope,
        (0.0, float(times[-1])),
        start,
        method="DOP853",
        t_eval=times,
        rtol=1e-9,
        atol=1e-11,
        max_step=0.5,
    )
    return found.y[0]
