"""The motion of an oscillator at given times, to a given error."""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np

from bayesdamp.physics.kernel.build import source_of
from bayesdamp.physics.kernel.solve import NONE, QUANTITIES, Motion, Solver
from bayesdamp.physics.oscillator import POINTS, REACH, Oscillator, no_rest
from bayesdamp.physics.rest import Force, by_kernel, frequency_over, rest_near

FIRST, FINER, ROUNDING = 0.1, 50.0, 1e-15
"""Error of a step over the error that is wanted, at first; the factor by which it is lowered until motions agree; and
the least, as a share of the amplitude."""
BESIDE = 1e-6
"""Time about a turning point, in radians of the oscillation, in which accelerations, which jump, are not compared."""


def trajectory(
    osc: Oscillator, p: Mapping[str, float], times: np.ndarray, quantity: str, tolerance: float = 1e-9
) -> np.ndarray:
    """Return the motion at times (n,) in s, started with theta0, omega0 at times[0]; nan from where it escapes.

    tolerance: error in the unit of the quantity. Steps are shortened until motions that are solved more finely differ
    by less; the finer one is returned. Friction of ε = 0 is exact: a body that it can hold sticks.

    Raises Refusal where a damping term or the law has no kernel, ValueError where a term needs a rest position and
    there is none.
    """
    source_of(osc.damping, osc.restoring)
    t = np.asarray(times, float) - float(times[0])
    values, scales = _values(osc, p)
    least = tolerance / scales[1] ** QUANTITIES.index(quantity)
    after = t[-1] + 1e-3 / scales[1]  # so that no step ends with the last sample
    solver = Solver(
        osc.damping, osc.restoring, np.append(t, after), quantity, max(scales[0], least), scales[1],
        float(p.get("epsilon", 0.0)), np.array([0.0, after]),
    )  # fmt: skip
    vector = np.array([values[name] for name in solver.names])
    share = min(FIRST * least / solver.amplitude, 1e-6)
    coarse = _solved(solver, vector, share)
    while coarse is not None:
        share = max(share / FINER, ROUNDING)
        fine = _solved(solver, vector, share)
        if fine is None:
            break
        if share == ROUNDING or _difference(solver, coarse, fine) <= tolerance:
            return fine.y[:-1]
        coarse = fine
    return _until_escape(solver, vector)[:-1]


def _values(osc: Oscillator, p: Mapping[str, float]) -> tuple[dict[str, float], tuple[float, float]]:
    """Return the parameters with what terms are given besides, and the motion's amplitude (rad or m) and frequency
    (rad/s): about its rest position, or as the force is at the start where it has none."""
    force = by_kernel(osc.law.kernel, np.array([float(p[n]) for n in osc.law.parameters]))
    start, speed = float(p["theta0"]), abs(float(p["omega0"]))
    rest = rest_near(force, start, REACH, POINTS)
    if rest is None and "rest" in osc.scales:
        raise no_rest(osc.restoring, start)
    reach = 1e-5 * max(abs(start - (start if rest is None else rest)), speed, 1e-9)
    frequency = 0.0 if rest is None else frequency_over(force, rest - reach, rest + reach)
    if frequency == 0.0:
        frequency = _rate(force, start, reach)
    pull = abs(float(force(np.array([start]))[0])) / frequency**2
    amplitude = math.hypot(pull if rest is None else start - rest, speed / frequency)
    found = {
        "rest": rest or 0.0,
        "reference_amplitude": amplitude,
        "reference_velocity": amplitude * frequency,
    }
    return {**found, **{n: float(v) for n, v in p.items()}}, (amplitude, frequency)


def _rate(force: Force, at: float, reach: float) -> float:
    """Return the square root of a force's slope, whatever its sign, rad/s; 1 where it is constant."""
    below, above = force(np.array([at - reach, at + reach]))
    return math.sqrt(abs(above - below) / (2 * reach)) or 1.0


def _solved(solver: Solver, values: np.ndarray, share: float) -> Motion | None:
    return solver.solve(values, np.ones(len(solver.terms), bool), tangents=NONE, tolerance=share)


def _difference(solver: Solver, coarse: Motion, fine: Motion) -> float:
    """Return the largest difference of two motions, of accelerations that jump but for the jumps themselves."""
    apart = np.abs(coarse.y - fine.y)
    jumps = fine.times[:-1][np.diff(fine.times) == 0]
    if solver.quantity == "acceleration" and jumps.size:
        next_one = np.searchsorted(jumps, solver.t).clip(1, jumps.size - 1)
        near = np.minimum(np.abs(solver.t - jumps[next_one - 1]), np.abs(solver.t - jumps[next_one]))
        apart = apart[near > BESIDE / solver.frequency]
    return float(apart.max(initial=0.0))


def _until_escape(solver: Solver, values: np.ndarray) -> np.ndarray:
    """Return the values up to the last time that a motion reaches, nan after it."""
    found, reached, missed = np.full(solver.t.size, np.nan), 1, solver.t.size
    while missed - reached > 1:
        count = (reached + missed) // 2
        motion = solver.solve(values, np.ones(len(solver.terms), bool), tangents=NONE, stop=count)
        if motion is None:
            missed = count
        else:
            reached, found[:count] = count, motion.y
    if reached == 1 and solver.quantity != "acceleration":
        found[0] = values[-2 + QUANTITIES.index(solver.quantity)]
    return found
