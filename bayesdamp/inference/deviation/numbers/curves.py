"""Undamped orbits of an amplitude, the work of damping on them, and the damping ratio at an amplitude from draws."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
import scipy  # loads its modules when they are used

from bayesdamp.inference.deviation.numbers.draws import CandidateDraws, quantity
from bayesdamp.inference.deviation.weighing import CandidateResult, Weighing
from bayesdamp.physics.damping import TERMS
from bayesdamp.physics.forces import by_kernel, frequency_over
from bayesdamp.physics.kernel import Motion, Solver
from bayesdamp.physics.restoring import LAWS
from bayesdamp.types import Ratio

POINTS = 200
REACHES = (1e-3, 0.03, 0.1, 0.25, 0.5)
"""Half widths, in amplitudes, within which the middle of a cycle is searched about its rest."""
_PHASE = (np.arange(POINTS) + 0.5) / POINTS * np.pi - 0.5 * np.pi
_COSINES = np.cos((np.arange(16) + 0.5) / 16 * 2 * np.pi).tolist()
_X, _W = (a.tolist() for a in np.polynomial.legendre.leggauss(48))
_X_PART, _W_PART = (a.tolist() for a in np.polynomial.legendre.leggauss(4))


@dataclass(frozen=True)
class Orbit:
    """An undamped half cycle.

    Attributes
    ----------
    energy : float
        Potential energy at its turning points, per unit of inertia.
    x, speed, width : ndarray, shape (n,)
        Positions, speeds, and widths for integration over x.
    """

    energy: float
    x: np.ndarray
    speed: np.ndarray
    width: np.ndarray

    @property
    def frequency(self) -> float:
        """Of the oscillation, in rad/s."""
        return float(np.pi / np.sum(self.width / self.speed))


@lru_cache(maxsize=256)
def orbit_at(amplitude: float, restoring: str, law: tuple[float, ...], rest: float) -> Orbit | None:
    """Return the orbit of an amplitude (rad or m) about `rest`; None where there is none."""
    force, values = LAWS.get(restoring).kernel, np.array(law)

    def between(a: float, b: float, nodes: list[float], weights: list[float]) -> float:
        half = 0.5 * (b - a)
        return float(half * sum(w * force(a + half * (u + 1), values) for u, w in zip(nodes, weights)))

    def potential(x: float) -> float:
        return between(rest, x, _X, _W)

    def uneven(shift: float) -> float:
        return potential(rest + shift + amplitude) - potential(rest + shift - amplitude)

    # Narrow brackets first: a wide one reaches beyond the barrier of a softening spring.
    reaches = (share * amplitude for share in REACHES)
    reach = next((r for r in reaches if uneven(-r) < 0 < uneven(r)), None)
    if reach is None:
        return None
    centre = rest + float(scipy.optimize.brentq(uneven, -reach, reach, xtol=1e-12 * max(amplitude, 1e-300)))  # type: ignore[arg-type]
    energy = potential(centre + amplitude)
    x = centre + amplitude * np.sin(_PHASE)
    # From one point to the next, where a few nodes integrate to rounding error, with a twelfth of the forces.
    first, *others = x.tolist()
    parts = [between(a, b, _X_PART, _W_PART) for a, b in zip([first, *others], others)]
    inside = potential(first) + np.concatenate([[0.0], np.cumsum(parts)])
    if inside.max() > energy * (1 + 1e-9):
        return None
    speed = np.sqrt(2 * np.maximum(energy - inside, 0.0))
    width = amplitude * np.cos(_PHASE) * np.pi / POINTS
    return Orbit(energy, x, speed, width)


def natural_frequency(restoring: str, law: np.ndarray, rest: float, scale: float) -> float:
    """Return √F′ at the equilibrium, in rad/s."""
    d = 1e-5 * scale
    return frequency_over(by_kernel(LAWS.get(restoring).kernel, law), rest - d, rest + d)


def balanced_frequency(restoring: str, law: np.ndarray, rest: float, amplitude: float) -> float:
    """Return the frequency of the oscillation of an amplitude, in rad/s, from the force's first harmonic.

    This needs only a few forces, and is accurate enough for how the frequency changes with the law's parameters (N. M.
    Krylov and N. N. Bogoliubov, 1943).
    """
    force = LAWS.get(restoring).kernel
    pull = sum(force(rest + amplitude * c, law) * c for c in _COSINES)
    return float(np.sqrt(max(2 * pull / (len(_COSINES) * amplitude), 0.0)))


def turning_amplitudes(motion: Motion) -> tuple[np.ndarray, np.ndarray]:
    """Return the times in s of a motion's half cycles, and half the distance of their turning points, falling."""
    times, states = motion.refined
    v = states[:, 1]
    # A turning point at a node, or two at one time, counts once: where the velocity becomes zero, or starts at zero.
    reached = (v[:-1] != 0) & (v[1:] == 0)
    reached[0] |= v[0] == 0
    turns = np.flatnonzero((v[:-1] * v[1:] < 0) | reached)
    share = v[turns] / np.where(v[turns] == v[turns + 1], 1.0, v[turns] - v[turns + 1])
    h = times[turns + 1] - times[turns]
    t = times[turns] + share * h
    x = states[turns, 0] + h * share * (states[turns, 1] + 0.5 * h * share * states[turns, 2])
    sizes, at = 0.5 * np.abs(np.diff(x)), 0.5 * (t[1:] + t[:-1])
    good = sizes > 0
    return at[good], np.minimum.accumulate(sizes[good])


def share_of_time(result: CandidateResult, amplitude: float) -> float:
    """Return when the motion has this amplitude, as a share of the record."""
    at, sizes = turning_amplitudes(result.motion)
    if at.size < 2:
        return 0.5
    t = np.interp(-np.log(amplitude), -np.log(sizes), at)
    return float(np.clip(t / result.data.end, 0.0, 1.0))


def orbit_of(result: CandidateResult, amplitude: float) -> Orbit | None:
    """Return the orbit of an amplitude under a result's own law."""
    name, law = result.candidate.restoring, result.law
    rest = result.data.equilibrium(name, law)
    return None if rest is None else orbit_at(float(amplitude), name, tuple(map(float, law)), rest)


def works_on(
    orbit: Orbit, solver: Solver, further: np.ndarray, active: np.ndarray, epsilon: float | None = None
) -> np.ndarray:
    """Return the work per unit of each coefficient in a cycle, (d, m), for rows of the terms' parameters, (d, e)."""
    x, v = np.tile(orbit.x, 2), np.concatenate([orbit.speed, -orbit.speed])
    weight = np.concatenate([orbit.width, -orbit.width])
    return solver.works(x, v, weight, further, active, epsilon)


def ratios_per_unit(d: CandidateDraws, amplitude: float, every_term: bool = False) -> np.ndarray | None:
    """Return damping ratios per unit of each coefficient; None where no orbit has the amplitude.

    Of shape (n, m), or (1, m) where they are the same for all draws. With `every_term`, terms without parameters of
    their own that the candidate does not have are included.
    """
    solver = d.result.solver
    orbit = orbit_of(d.result, amplitude)
    if orbit is None:
        return None
    simple = np.array([not TERMS.get(t).inferred for t in solver.terms])
    active = d.result.fit.active | simple if every_term else d.result.fit.active
    works = d.by_further(lambda rows: works_on(orbit, solver, rows, active))
    return works / (4 * np.pi * orbit.energy)


def at_share(values: np.ndarray, share: float) -> np.ndarray:
    """Interpolate values at equidistant knots, (n, k), at a share of the record: (n,)."""
    k = values.shape[1]
    at = share * (k - 1)
    i = min(int(at), k - 2)
    return (1 - at + i) * values[:, i] + (at - i) * values[:, i + 1]


def between_knots(values: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Draw how far deviations at equidistant knots, (n, k), may be from the straight lines between these: (n,).

    For a process with independent steps this is a bridge, with u (1 − u) of a step's variance a share u of the way to
    the next knot (I. Karatzas and S. E. Shreve, Brownian Motion and Stochastic Calculus, 1991, 5.6.B), a sixth on
    average. A step's variance is half that of the draw's own second differences, which do not contain a trend along the
    record. So the ratio at one amplitude is less certain than its mean over the many cycles between two knots.
    """
    sd = np.sqrt(np.mean(np.diff(values, 2, axis=1) ** 2, axis=1) / 12)
    return sd * rng.standard_normal(len(values))


def ratio_at(
    weighing: Weighing,
    drawn: Sequence[CandidateDraws],
    amplitude: float,
    sensor: float,
    rng: np.random.Generator,
) -> Ratio:
    """Return the equivalent damping ratio at an amplitude over all draws.

    Parameters
    ----------
    weighing : Weighing
        Of the candidates.
    drawn : sequence of CandidateDraws
        Draws of each candidate.
    amplitude : float
        In rad or m.
    sensor : float
        Relative sd of the sensor's linearity and clock, which is included.
    rng : numpy.random.Generator
        Random stream.
    """
    values, noises, weights = [], [], []
    for d in drawn:
        per_unit = ratios_per_unit(d, amplitude)
        if per_unit is None:
            continue
        values.append(_with_deviations(weighing, d, amplitude, per_unit, rng))
        noises.append(_noise_sd(weighing, d.result, per_unit.mean(axis=0)))
        weights.append(len(d.coefficients))
    if not values:
        return Ratio(amplitude, *(float("nan"),) * 5)
    ratios = np.concatenate(values)
    ratios = ratios * (1 + sensor * rng.standard_normal(ratios.size))
    noise = float(np.average(noises, weights=weights))
    q = quantity(ratios, min(noise, float(np.std(ratios))))
    return Ratio(amplitude, q.value, q.low, q.high, q.sd_noise, q.sd_law)


def ratios_drawn(
    weighing: Weighing, d: CandidateDraws, amplitude: float, sensor: float, rng: np.random.Generator
) -> np.ndarray | None:
    """Return the draws behind `ratio_at`, (n,), of one candidate; None where no orbit has the amplitude."""
    per_unit = ratios_per_unit(d, amplitude)
    if per_unit is None:
        return None
    ratios = _with_deviations(weighing, d, amplitude, per_unit, rng)
    return ratios * (1 + sensor * rng.standard_normal(ratios.size))


def _with_deviations(
    weighing: Weighing, d: CandidateDraws, amplitude: float, per_unit: np.ndarray, rng: np.random.Generator
) -> np.ndarray:
    """Return ratios of the draws with their deviations, (n,)."""
    share = share_of_time(d.result, amplitude)
    ratios = _under_frictions(weighing, d, amplitude, per_unit, rng)
    g = at_share(d.g, share) + between_knots(d.g, rng)
    return ratios * np.exp(g) / (1 + at_share(d.h, share))


def _under_frictions(
    weighing: Weighing, d: CandidateDraws, amplitude: float, per_unit: np.ndarray, rng: np.random.Generator
) -> np.ndarray:
    """Return ratios of the draws, (n,), each under one of the widths of friction, drawn by their probability."""
    ratios = np.sum(d.coefficients * per_unit, axis=1)
    solver, active, frictions = d.result.solver, d.result.fit.active, weighing.frictions
    switching = any(TERMS.get(t).switches and on for t, on in zip(solver.terms, active, strict=True))
    if not switching or not frictions:
        return ratios
    orbit = orbit_of(d.result, amplitude)
    assert orbit is not None  # `per_unit` was computed on it
    # The loss of all terms together: how it is split among terms that cannot be told apart is arbitrary.
    whole = weighing.solvers[d.result.candidate.restoring]
    coefficients = np.array([f.coefficients for f in frictions])
    works = [
        works_on(orbit, whole, np.array([f.further]), own != 0, f.epsilon)[0]
        for f, own in zip(frictions, coefficients, strict=True)
    ]
    lost = np.sum(np.array(works) * coefficients, axis=1)
    used = int(np.argmin([abs(f.epsilon - solver.epsilon) for f in frictions]))
    if not lost[used] > 0:
        return ratios
    weights = [f.weight for f in frictions]
    return ratios * (lost / lost[used])[rng.choice(len(weights), len(ratios), p=weights)]


def _noise_sd(weighing: Weighing, result: CandidateResult, per_unit: np.ndarray) -> float:
    """Return the ratio's standard deviation from noise alone, under exact laws."""
    parameters = result.fit.parameters
    rates, gradient = parameters.rates(result.fit.z), np.zeros(parameters.free.size)
    coefficients = parameters.free < per_unit.size
    gradient[coefficients] = per_unit[parameters.free[coefficients]] * rates[coefficients]
    scale = np.sqrt(weighing.variance / result.exact_variance)
    return float(np.linalg.norm(gradient @ result.exact_weighed.factors[0])) * float(scale)
