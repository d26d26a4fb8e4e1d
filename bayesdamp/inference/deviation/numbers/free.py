"""The damping curve without a law: its posterior inside the same equation of motion.

The damping is viscous times exp g(t), g a Gaussian process with a wide prior instead of a narrow one; as the amplitude
only falls, g against time is the damping ratio against amplitude. Nothing of a law of damping is in it but its prior:
that the ratio is smooth over a tenth of the record or more.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from bayesdamp.inference.deviation.candidate import (
    Candidate,
    Linearised,
    first_values,
    linearised,
    mode_of,
    parameters_of,
)
from bayesdamp.inference.deviation.gaussian.hyperparameters import Grid, wide_grid
from bayesdamp.inference.deviation.gaussian.linear import weigh
from bayesdamp.inference.deviation.least_squares import Fit
from bayesdamp.inference.deviation.numbers.curves import at_share, turning_amplitudes
from bayesdamp.inference.deviation.orbit import orbit_at, rest_of
from bayesdamp.inference.deviation.parameters import Parameters
from bayesdamp.inference.deviation.weighing import Weighing
from bayesdamp.physics.kernel import Motion, Solver
from bayesdamp.types import Ratio

KNOTS, A_KNOT = (6, 24), 1.5
"""Fewest and most knots of g, and cycles for each."""
POINTS = 40
"""Amplitudes of the curve."""
DRAWS = 1000
STEPS, SETTLED = 25, 0.1
"""Gauss–Newton steps at most, and the change of the motion, in sds of the whole record's noise, that ends them."""
FAR = 50.0
"""Size of g, whose prior has sizes of 3 at most, from which the model about the mode does not describe the record."""
CLOSE = 1.02
"""By how much a step may enlarge the sum of squares."""


@dataclass(frozen=True)
class FreeCurve:
    """amplitude (a,), falling (rad or m); the equivalent damping ratio there and the energy lost in a cycle per unit of
    inertia (rad²/s² or m²/s²), each (a, 3): median and 95 % interval."""

    amplitude: np.ndarray
    ratio: np.ndarray
    lost: np.ndarray


def free_curve(
    weighing: Weighing, restoring: str, guess: tuple[Ratio, ...], rng: np.random.Generator
) -> FreeCurve | None:
    """The curve under a restoring law; None where no motion follows the record. guess: ratios that the search for the
    motion starts from."""
    data = weighing.data
    count = int(np.clip(round(data.cycles / A_KNOT) + 1, *KNOTS))
    base = weighing.solvers[restoring]
    solver = replace(base, terms=("viscous",), knots=np.linspace(0.0, data.end, count))
    grid = wide_grid(count)
    at = _mode(weighing, solver, grid, guess)
    if at is None:
        return None
    weighed = weigh(at.model, grid, weighing.variance, weighing.samples)
    u = weighed.draws(at.parameters.positive, DRAWS, rng)[0]
    d = at.fit.z.size
    g, h, zeta = u[:, d : d + count], u[:, d + count :], at.parameters.known["zeta"]
    if np.abs(g).max() > FAR:
        return None
    law = at.parameters.values(at.u[:d])[solver.law_places]
    rest = rest_of(restoring, law, data.rest, 2 * data.amplitude)
    times, sizes = turning_amplitudes(at.motion)
    if rest is None or times.size < 4:
        return None
    amplitude = np.geomspace(min(data.amplitude, sizes[0]), max(data.final_amplitude, sizes[-1]), POINTS)
    ratio, lost = np.full((POINTS, 3), np.nan), np.full((POINTS, 3), np.nan)
    ones = np.ones(1, bool)
    for i, a in enumerate(amplitude):
        orbit = orbit_at(float(a), restoring, tuple(map(float, law)), rest)
        if orbit is None:
            continue
        share = float(np.clip(np.interp(-np.log(a), -np.log(sizes), times) / data.end, 0, 1))
        # Of a viscous force 2 θ̇ per unit: ∮ 2 v dx.
        work = float(solver.works(orbit.x, orbit.speed, 2 * orbit.width, np.zeros((1, 0)), ones)[0, 0])
        factor = zeta * np.exp(at_share(g, share)) / (1 + at_share(h, share))
        q = np.quantile(factor, (0.5, 0.025, 0.975))
        ratio[i], lost[i] = q * work / (4 * np.pi * orbit.energy), q * work
    return FreeCurve(amplitude, ratio, lost)


def _mode(weighing: Weighing, solver: Solver, grid: Grid, guess: tuple[Ratio, ...]) -> Linearised | None:
    """The model about the mode of parameters and g together, from the curve that is guessed."""
    data, law = weighing.data, solver.restoring
    near = next(r for r in weighing.results if r.candidate.restoring == law)
    fitted = near.fit.parameters.named(near.fit.z)
    fixed = {n: v for n, v in near.fit.parameters.known.items() if n in solver.names[solver.law_places]}
    c = Candidate(("viscous",), law)
    parameters = parameters_of(c, solver, data, weighing.reference, {}, fixed)
    size, time = (np.array([r.value for r in guess]), _times_of(weighing, near.motion, guess))
    log = np.interp(solver.knots, time, np.log(np.maximum(size, 1e-12)))
    start = {**first_values(c, data, fixed), **{n: fitted[n] for n in parameters.free_names if n in fitted}}
    # Only g is inferred of the damping: a size beside it would be the same once more, and their product is not linear.
    priors = {n: prior for n, prior in parameters.priors.items() if n != "zeta"}
    zeta = float(np.exp(log.mean())) * data.frequency
    parameters = Parameters(parameters.names, priors, {**parameters.known, "zeta": zeta})
    z = parameters.scores({n: start[n] for n in parameters.free_names})
    empty = np.zeros((data.y.size, 0))
    motion = Motion(data.y, empty, np.zeros(0), np.zeros((0, 3)))
    found = Fit(parameters, np.ones(1, bool), z, data.y, empty, motion)
    at = linearised(
        c, solver, data, found, np.concatenate([z, log - log.mean(), np.zeros(solver.knots.size)])
    )
    for _ in range(STEPS):
        if at is None:
            return None
        squares = _squares(weighing, at)
        best, share, there = mode_of(at.model, grid, weighing.variance), 1.0, None
        while share > 0.02 and there is None:
            there = linearised(c, solver, data, found, at.u + share * (best - at.u))
            if there is not None and _squares(weighing, there) > squares * CLOSE:
                there = None
            share *= 0.5
        if there is None:
            break
        moved = float(np.linalg.norm(there.model.root @ (there.u - at.u))) / np.sqrt(weighing.variance)
        at = there
        if moved < SETTLED:
            break
    return at


def _squares(weighing: Weighing, at: Linearised) -> float:
    return float(np.sum((weighing.data.y - at.motion.y) ** 2))


def _times_of(weighing: Weighing, motion: Motion, guess: tuple[Ratio, ...]) -> np.ndarray:
    """When a motion has the amplitudes of a guess, which fall."""
    times, sizes = turning_amplitudes(motion)
    if times.size < 2:
        return np.linspace(0, weighing.data.end, len(guess))
    return np.interp([-np.log(r.amplitude) for r in guess], -np.log(sizes), times)
