"""Infer the damping ratio against amplitude without a damping law.

The damping is a viscous force times exp g(t), where the log factor g has a wide prior. As the amplitude only falls, g
against time gives the damping ratio against amplitude. The prior assumes only that the ratio changes smoothly over a
tenth of the record.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from bayesdamp.inference.deviation.candidate import (
    Linearisation,
    MotionCandidate,
    initial_values,
    linearise,
    linearise_at_mode,
    parameters_of,
)
from bayesdamp.inference.deviation.draws import at_fraction, orbit_at, turning_amplitudes
from bayesdamp.inference.deviation.least_squares import LeastSquaresFit
from bayesdamp.inference.deviation.linear import Grid, linear_posterior, wide_grid
from bayesdamp.inference.deviation.model_comparison import ModelComparison
from bayesdamp.physics.kernel import Motion, Solver
from bayesdamp.types import Ratio

KNOT_LIMITS, CYCLES_PER_KNOT = (6, 24), 1.5
"""The damping is a viscous force times exp g(t), where g is interpolated between knots in time. These are the smallest
and largest number of knots, and the number of cycles between two knots."""
CURVE_POINTS = 40
"""Number of amplitudes in the curve of damping ratio against amplitude without a damping law."""
CURVE_DRAWS = 1000
"""Number of posterior draws from which the intervals of the damping curve without a law are computed."""
LARGEST_G = 50.0
"""`free_curve` returns None if |g| (the log factor of the damping) is larger than this in any draw: then the linear
model about the mode has failed, because prior sds of g are at most 3."""


@dataclass(frozen=True)
class FreeCurve:
    """The damping ratio and the energy loss against amplitude, without a damping law.

    Attributes
    ----------
    amplitude : ndarray, shape (a,)
        Falling amplitudes, in rad or m; the rows of the other arrays are nan where no orbit has the amplitude.
    ratio : ndarray, shape (a, 3)
        Median, lower and upper end of the 95 % interval of the equivalent damping ratio.
    lost : ndarray, shape (a, 3)
        The same three numbers for the energy lost in a cycle per unit of inertia, in rad²/s² or m²/s².
    """

    amplitude: np.ndarray
    ratio: np.ndarray
    lost: np.ndarray


def free_curve(
    comparison: ModelComparison, restoring: str, guess: tuple[Ratio, ...], rng: np.random.Generator
) -> FreeCurve | None:
    """Infer the damping ratio and the energy loss against amplitude under a restoring law, without a damping law.

    restoring: name of the law, under which the comparison must have a result. guess: damping ratios at which the search
    starts, in order of falling amplitude. Return None if no motion fits the record, the linear model fails
    (`LARGEST_G`), no equilibrium is near the midline, or the motion has fewer than four half cycles.
    """
    data = comparison.data
    count = int(np.clip(round(data.cycles / CYCLES_PER_KNOT) + 1, *KNOT_LIMITS))
    base = comparison.solvers[restoring]
    solver = replace(base, terms=("viscous",), knots=np.linspace(0.0, data.end, count))
    grid = wide_grid(count)
    at = _mode(comparison, solver, grid, guess)
    if at is None:
        return None
    posterior = linear_posterior(at.model, grid, comparison.variance, comparison.samples)
    u = posterior.draws(CURVE_DRAWS, rng)[0]
    g, h = np.split(u[:, at.fit.z.size :], 2, axis=1)
    if np.abs(g).max() > LARGEST_G:
        return None
    zeta, law = at.fit.parameters.known["zeta"], at.values[solver.law_places]
    rest = data.equilibrium(restoring, law)
    times, sizes = turning_amplitudes(at.motion)
    if rest is None or times.size < 4:
        return None
    amplitude = np.geomspace(
        min(data.amplitude, sizes[0]), max(data.final_amplitude, sizes[-1]), CURVE_POINTS
    )
    ratio, lost = np.full((CURVE_POINTS, 3), np.nan), np.full((CURVE_POINTS, 3), np.nan)
    ones = np.ones(1, bool)
    for i, a in enumerate(amplitude):
        orbit = orbit_at(float(a), restoring, tuple(map(float, law)), rest)
        if orbit is None:
            continue
        share = float(np.clip(np.interp(-np.log(a), -np.log(sizes), times) / data.end, 0, 1))
        # Work of a viscous force 2 θ̇ in a cycle: ∮ 2 v dx, twice that of the half cycle.
        work = float(solver.works(orbit.x, orbit.velocity, 2 * orbit.weight, np.zeros((1, 0)), ones)[0, 0])
        factor = zeta * np.exp(at_fraction(g, share)) / (1 + at_fraction(h, share))
        q = np.quantile(factor, (0.5, 0.025, 0.975))
        ratio[i], lost[i] = q * work / (4 * np.pi * orbit.energy), q * work
    return FreeCurve(amplitude, ratio, lost)


def _mode(
    comparison: ModelComparison, solver: Solver, grid: Grid, guess: tuple[Ratio, ...]
) -> Linearisation | None:
    """Linearise a viscous force times exp g(t) about the joint mode of its parameters and g.

    None if the motion is unbounded. g is the log factor of the damping, with values at knots in time. The search starts
    at the damping ratios of `guess`, in order of falling amplitude. The coefficient of the force is fixed, because it
    has the same effect as a constant g. solver: solver with the viscous term alone. grid: sizes (prior sds) and
    correlation lengths of g and of the relative deviation h of the frequency.
    """
    data, law = comparison.data, solver.restoring
    near = next(r for r in comparison.results if r.candidate.restoring == law)
    fitted, known = near.fit.parameters.named(near.fit.z), near.fit.parameters.known
    fixed = {n: v for n, v in known.items() if n in solver.names[solver.law_places]}
    c = MotionCandidate(("viscous",), law)
    parameters = parameters_of(c, solver, data, comparison.reference, {}, fixed)
    # Times at which the motion has the guessed amplitudes, which fall.
    turns, sizes = turning_amplitudes(near.motion)
    times = np.linspace(0, data.end, len(guess))
    if turns.size >= 2:
        times = np.interp([-np.log(r.amplitude) for r in guess], -np.log(sizes), turns)
    log = np.interp(solver.knots, times, np.log(np.maximum(np.array([r.value for r in guess]), 1e-12)))
    start = {**initial_values(c, data, fixed), **{n: fitted[n] for n in parameters.free_names if n in fitted}}
    # Fix the coefficient: it has the effect of a constant g, and the product of both would not be linear.
    parameters = parameters.with_fixed("zeta", float(np.exp(log.mean())) * data.frequency)
    z = parameters.scores({n: start[n] for n in parameters.free_names})
    empty = np.zeros((data.y.size, 0))
    motion = Motion(data.y, empty, np.zeros(0), np.zeros((0, 3)))
    fit = LeastSquaresFit(parameters, np.ones(1, bool), z, data.y, empty, motion)
    first = linearise(solver, data, fit, np.concatenate([z, log - log.mean(), np.zeros(solver.knots.size)]))
    mode = first and linearise_at_mode(solver, data, fit, comparison.variance, first, grid)
    return mode and mode[0]
