"""The damping ratio at an amplitude, from draws."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from bayesdamp.inference.deviation.numbers.draws import Drawn, quantity
from bayesdamp.inference.deviation.orbit import Orbit, orbit_at, rest_of
from bayesdamp.inference.deviation.weighing import Result, Weighing
from bayesdamp.physics.damping import TERMS
from bayesdamp.physics.kernel import Motion, Solver
from bayesdamp.types import Ratio


def turning_amplitudes(motion: Motion) -> tuple[np.ndarray, np.ndarray]:
    """Times in s of a motion's half cycles, and half the distance of their turning points, in falling order."""
    times, states = motion.refined
    v = states[:, 1]
    # A turning point that is a node, or two at one time, counts once: where the velocity becomes zero, or begins so.
    reached = (v[:-1] != 0) & (v[1:] == 0)
    reached[0] |= v[0] == 0
    turns = np.flatnonzero((v[:-1] * v[1:] < 0) | reached)
    share = v[turns] / np.where(v[turns] == v[turns + 1], 1.0, v[turns] - v[turns + 1])
    t = times[turns] + share * (times[turns + 1] - times[turns])
    h = times[turns + 1] - times[turns]
    x = states[turns, 0] + h * share * (states[turns, 1] + 0.5 * h * share * states[turns, 2])
    sizes, at = 0.5 * np.abs(np.diff(x)), 0.5 * (t[1:] + t[:-1])
    good = sizes > 0
    return at[good], np.minimum.accumulate(sizes[good])


def share_of_time(weighing: Weighing, result: Result, amplitude: float) -> float:
    """When the motion has this amplitude, as a share of the record."""
    at, sizes = turning_amplitudes(result.motion)
    if at.size < 2:
        return 0.5
    t = np.interp(-np.log(amplitude), -np.log(sizes), at)
    return float(np.clip(t / weighing.data.end, 0.0, 1.0))


def orbit_of(weighing: Weighing, result: Result, amplitude: float) -> Orbit | None:
    """The orbit of an amplitude under a result's own law."""
    name = result.candidate.restoring
    law = values_of(result)[result.solver.law_places]
    rest = rest_of(name, law, weighing.data.rest, 2 * weighing.data.amplitude)
    return None if rest is None else orbit_at(float(amplitude), name, tuple(map(float, law)), rest)


def values_of(result: Result) -> np.ndarray:
    """A result's parameters at its mode, as its solver takes them."""
    z = result.about.u[: result.fit.z.size] if result.about is not None else result.fit.z
    return result.fit.parameters.values(z)


def further_of(result: Result, values: np.ndarray) -> np.ndarray:
    """The terms' further parameters, (1, e), among a result's parameters."""
    return values[None, len(result.solver.terms) : result.solver.law_places.start]


def works_on(
    orbit: Orbit, solver: Solver, further: np.ndarray, active: np.ndarray, epsilon: float | None = None
) -> np.ndarray:
    """Work per unit of each coefficient in a cycle on an orbit, (d, m), for rows of further parameters, (d, e)."""
    x, v = np.tile(orbit.x, 2), np.concatenate([orbit.speed, -orbit.speed])
    weight = np.concatenate([orbit.width, -orbit.width])
    return solver.works(x, v, weight, further, active, epsilon)


def ratios_per_unit(
    weighing: Weighing,
    d: Drawn,
    amplitude: float,
    epsilon: float | None = None,
    *,
    every_term: bool = False,
) -> np.ndarray | None:
    """Ratios per unit of each coefficient, (n, m) or (1, m) where they are the same for all draws.

    every_term: also of terms without parameters of their own that the draws do not have.
    """
    solver = d.result.solver
    orbit = orbit_of(weighing, d.result, amplitude)
    if orbit is None:
        return None
    simple = np.array([not TERMS.get(t).inferred for t in solver.terms])
    active = d.result.fit.active | simple if every_term else d.result.fit.active
    works = d.by_further(lambda rows: works_on(orbit, solver, rows, active, epsilon))
    return works / (4 * np.pi * orbit.energy)


def at_share(values: np.ndarray, share: float) -> np.ndarray:
    """Values at equidistant knots, (n, k), at a share of the record: (n,)."""
    k = values.shape[1]
    at = share * (k - 1)
    i = min(int(at), k - 2)
    return (1 - at + i) * values[:, i] + (at - i) * values[:, i + 1]


def between_knots(values: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """What deviations at equidistant knots, (n, k), may be beside the straight lines between these: (n,).

    Of a process with independent steps it is a bridge, with u (1 − u) of a step's variance a share u of the way to the
    next knot (I. Karatzas and S. E. Shreve, Brownian Motion and Stochastic Calculus, 1991, 5.6.B), a sixth in the mean.
    A step's variance is half that of the draw's own second differences, which a trend along the record is not in. So
    the ratio at one amplitude is not known as well as its mean over the many cycles between two knots.
    """
    sd = np.sqrt(np.mean(np.diff(values, 2, axis=1) ** 2, axis=1) / 12)
    return sd * rng.standard_normal(len(values))


def ratio_at(
    weighing: Weighing, drawn: Sequence[Drawn], amplitude: float, sensor: float, rng: np.random.Generator
) -> Ratio:
    """The equivalent damping ratio at an amplitude (rad or m) over all draws, deviation and sensor among its sds."""
    values, noises, weights = [], [], []
    for d in drawn:
        per_unit = ratios_per_unit(weighing, d, amplitude)
        if per_unit is None:
            continue
        values.append(_deviating(weighing, d, amplitude, per_unit, rng))
        noises.append(_noise_sd(weighing, d.result, per_unit.mean(axis=0)))
        weights.append(len(d.coefficients))
    if not values:
        return Ratio(amplitude, *(float("nan"),) * 5)
    found = np.concatenate(values)
    found = found * (1 + sensor * rng.standard_normal(found.size))
    noise = float(np.average(noises, weights=weights))
    q = quantity(found, min(noise, float(np.std(found))))
    return Ratio(amplitude, q.value, q.low, q.high, q.sd_noise, q.sd_law)


def ratios_drawn(
    weighing: Weighing, d: Drawn, amplitude: float, sensor: float, rng: np.random.Generator
) -> np.ndarray | None:
    """The draws behind `ratio_at`, (n,), of one candidate; None where no orbit has the amplitude."""
    per_unit = ratios_per_unit(weighing, d, amplitude)
    if per_unit is None:
        return None
    found = _deviating(weighing, d, amplitude, per_unit, rng)
    return found * (1 + sensor * rng.standard_normal(found.size))


def _deviating(
    weighing: Weighing, d: Drawn, amplitude: float, per_unit: np.ndarray, rng: np.random.Generator
) -> np.ndarray:
    """Ratios of the draws with their deviations, (n,)."""
    share = share_of_time(weighing, d.result, amplitude)
    each = _under_frictions(weighing, d, amplitude, per_unit, rng)
    g = at_share(d.g, share) + between_knots(d.g, rng)
    return each * np.exp(g) / (1 + at_share(d.h, share))


def _under_frictions(
    weighing: Weighing, d: Drawn, amplitude: float, per_unit: np.ndarray, rng: np.random.Generator
) -> np.ndarray:
    """Ratios of the draws, (n,), each under one of the widths of friction by their probability."""
    found = np.sum(d.coefficients * per_unit, axis=1)
    active = d.result.fit.active
    solver = d.result.solver
    switching = any(TERMS.get(t).switches and on for t, on in zip(solver.terms, active, strict=True))
    if not switching or not weighing.frictions:
        return found
    orbit = orbit_of(weighing, d.result, amplitude)
    assert orbit is not None  # there is work on it
    # The loss of all terms together: how it is split among terms that nobody can tell apart is arbitrary.
    whole = weighing.solvers[d.result.candidate.restoring]
    every = np.ones(len(whole.terms), bool)
    lost = np.array([
        works_on(orbit, whole, np.array([f.further]), every, f.epsilon)[0] @ np.array(f.coefficients)
        for f in weighing.frictions
    ])  # fmt: skip
    used = int(np.argmin([abs(f.epsilon - solver.epsilon) for f in weighing.frictions]))
    if not lost[used] > 0:
        return found
    weights = [f.weight for f in weighing.frictions]
    return found * (lost / lost[used])[rng.choice(len(weights), len(found), p=weights)]


def _noise_sd(weighing: Weighing, result: Result, per_unit: np.ndarray) -> float:
    """The ratio's standard deviation from noise alone, under exact laws."""
    factor = result.exact_weighed.factors[0]
    parameters, m = result.fit.parameters, per_unit.size
    slopes = parameters.rates(result.fit.z)
    gradient = np.zeros(parameters.free.size)
    for i, place in enumerate(parameters.free):
        if place < m:
            gradient[i] = per_unit[place] * slopes[i]
    scale = np.sqrt(weighing.variance / result.exact_variance)
    return float(np.linalg.norm(gradient @ factor)) * float(scale)
