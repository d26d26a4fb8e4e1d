"""One candidate, a damping sum under a restoring law: its parameters, its fit, and its linear model about a motion."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import product

import numpy as np

from bayesdamp.inference.deviation.data import Data
from bayesdamp.inference.deviation.least_squares import LeastSquaresFit, fit, nonnegative
from bayesdamp.inference.deviation.linear import Grid, LinearModel, condense, grid_of, normals
from bayesdamp.inference.deviation.parameters import Parameters
from bayesdamp.inference.model.target import default_prior
from bayesdamp.physics.damping import TERMS
from bayesdamp.physics.kernel import Motion, Solver
from bayesdamp.physics.kernel.solve import ALL
from bayesdamp.physics.oscillator import Oscillator
from bayesdamp.physics.restoring import LAWS
from bayesdamp.priors import Prior
from bayesdamp.types import Reference, candidate_name

START = ("theta0", "omega0")
"""Names of the displacement and the velocity at the first sample."""
STARTS = (-1.0, 0.0, 1.0)
"""Scores of a term's own parameter from which searches start."""
RELINEARISED = 8
"""Gauss–Newton steps of parameters and deviations together, at most."""
STEPS = ((1.0, 0.0), (0.5, 0.0), (1.0, 10.0), (1.0, 1e3), (1.0, 1e5))
"""Steps that are tried in turn: the share of a step, and how firmly the scores are held. Where a record determines only
a combination of parameters (a spring's angle and gravity, of small swings), a plain step leads along a straight line
where the motion follows a curve, and no share of that step is any better."""
SETTLED = 0.3
"""Largest change of the motion by the last step, in standard deviations of the whole record's noise."""
MOST_G, MOST_H = 3.0, 0.4
"""Largest log deviation of the damping and deviation of the frequency that are followed."""


@dataclass(frozen=True)
class MotionCandidate:
    """A damping sum, as its terms, under a restoring law."""

    damping: tuple[str, ...]
    restoring: str

    @property
    def name(self) -> str:
        """As `viscous+coulomb@pendulum`."""
        return candidate_name("+".join(self.damping), self.restoring)


@dataclass(frozen=True)
class Linearisation:
    """A candidate about one motion, whose damping is multiplied by exp g and its restoring force by 1 + 2h.

    Attributes
    ----------
    fit : Fit
        The candidate's fit under exact laws.
    u : ndarray, shape (K,)
        Scores, g and h at the knots.
    motion : Motion
        At u.
    residual : ndarray, shape (n,)
        Record minus motion.
    model : LinearModel
        Of the record about the motion.
    left : ndarray, shape (n,)
        The part of the residual that no parameter and no deviation explains.
    """

    fit: LeastSquaresFit
    u: np.ndarray
    motion: Motion
    residual: np.ndarray
    model: LinearModel
    left: np.ndarray

    @property
    def z(self) -> np.ndarray:
        """Scores, (d,)."""
        return self.u[: self.fit.z.size]

    @property
    def values(self) -> np.ndarray:
        """All of the motion's parameters, (k,)."""
        return self.fit.parameters.values(self.z)

    @property
    def deviations(self) -> tuple[np.ndarray, np.ndarray]:
        """Relative deviations of damping, exp g − 1, and frequency, h, at the knots."""
        g, h = np.split(self.u[self.fit.z.size :], 2)
        return np.expm1(g), h

    @property
    def knots(self) -> int:
        """Number of knots of the deviations."""
        return (self.u.size - self.fit.z.size) // 2

    @property
    def squares(self) -> float:
        """Sum of the squared residuals, in the record's unit squared."""
        return float(np.sum(self.residual**2))

    def variance(self, data: Data) -> float:
        """Return the noise's variance that is left, in the record's unit squared."""
        degrees = max(self.left.size - self.u.size, 1)
        return data.least_variance + float(self.left @ self.left) / degrees

    def grid(self, coarse: bool) -> Grid:
        """Return the hyperparameters of the deviations."""
        return grid_of(self.knots, coarse=coarse, absorbed=self.fit.parameters.absorbs)

    def distance(self, u: np.ndarray, variance: float) -> float:
        """Return how far the motion at u is from this one, in standard deviations of the whole record's noise."""
        return float(np.linalg.norm(self.model.root @ (self.u - u))) / np.sqrt(variance)


def parameters_of(
    candidate: MotionCandidate,
    solver: Solver,
    data: Data,
    reference: Reference,
    priors: Mapping[str, Prior],
    known: Mapping[str, float],
) -> Parameters:
    """Return the parameters: given priors, default priors for what is neither known nor given one, known values."""
    osc = Oscillator(candidate.damping, candidate.restoring)
    inferred: dict[str, Prior] = {}
    for name in osc.parameters:
        if name in solver.names and (name not in known or name in osc.coefficients):
            given = priors.get(name)
            inferred[name] = given or default_prior(name, osc, "gaussian", reference, data.features)
    return Parameters(solver.names, inferred, {k: v for k, v in known.items() if k not in inferred})


def initial_values(candidate: MotionCandidate, data: Data, known: Mapping[str, float]) -> dict[str, float]:
    """Return where a search starts: the record's frequency, its start, and its decay shared by the terms."""
    law = LAWS.get(candidate.restoring)
    decay = np.log(max(data.amplitude / max(data.final_amplitude, 1e-12), 1.0001))
    ratio = decay / (2 * np.pi * max(data.cycles, 1.0)) / len(candidate.damping)
    middle = float(np.sqrt(data.amplitude * max(data.final_amplitude, 1e-3 * data.amplitude)))
    terms = [TERMS.get(t) for t in candidate.damping]
    coefficients = {t.parameter: ratio / t.ratio_per_unit(middle, data.frequency) for t in terms}
    given = {k: v for k, v in known.items() if k in law.parameters}
    start = law.start(data.frequency, data.rest, given)
    return {**coefficients, **start, **dict(zip(START, data.start, strict=True))}


def start_values(candidate: MotionCandidate, parameters: Parameters) -> list[dict[str, float]]:
    """Return values of the terms' own parameters that searches start from: low, middle and high in their priors."""
    names = [p.name for t in candidate.damping for p in TERMS.get(t).inferred if p.name in parameters.priors]
    either = STARTS if len(names) == 1 else STARTS[::2]
    scores = [(0.7,) if parameters.priors[n].reflected else either for n in names]
    return [
        {n: float(parameters.priors[n].value(np.asarray(z))) for n, z in zip(names, row, strict=True)}
        for row in product(*scores)
    ]


def active_of(parameters: Parameters, solver: Solver) -> np.ndarray:
    """Return which of the solver's terms act, (m,): those whose coefficients are inferred."""
    return np.array([TERMS.get(t).parameter in parameters.priors for t in solver.terms])


def search(
    solver: Solver, data: Data, parameters: Parameters, starts: Sequence[Mapping[str, float]], windows: bool
) -> LeastSquaresFit | None:
    """Return the best of the fits from the starts, which give values of parameters by name; the others are 0."""
    best: LeastSquaresFit | None = None
    active = active_of(parameters, solver)
    for start in starts:
        z = parameters.scores({**dict.fromkeys(parameters.free_names, 0.0), **start})
        z[parameters.positive] = np.maximum(z[parameters.positive], 0.0)
        rough = len(starts) > 1
        new = fit(solver, parameters, active, data.y, z, noise=data.noise, windows=windows, rough=rough)
        if new is not None and (best is None or new.squares < best.squares):
            best = new
    return best if best is None or len(starts) == 1 else refit(solver, data, best)


def refit(solver: Solver, data: Data, at: LeastSquaresFit) -> LeastSquaresFit | None:
    """Search again from a fit, on other data or with another solver; None where the motion escapes."""
    return fit(solver, at.parameters, at.active, data.y, at.z, noise=data.noise, windows=False)


def tangents_at(
    solver: Solver, at: LeastSquaresFit, u: np.ndarray, tolerance: float | None = None
) -> np.ndarray | None:
    """Return the tangents of a candidate's motion by u = (scores, log g, h), (n, K); None where it escapes."""
    solution = _solve(solver, at, u, tolerance)
    return None if solution is None else solution[1]


def _solve(
    solver: Solver, at: LeastSquaresFit, u: np.ndarray, tolerance: float | None = None
) -> tuple[Motion, np.ndarray] | None:
    """Return a candidate's motion at u = (scores, log g, h) and its tangents, (n, K); None where it escapes."""
    d, n = at.z.size, solver.knots.size
    z, g, h = np.split(u, [d, d + n])
    motion = solver.solve(at.parameters.values(z), at.active, np.expm1(g), h, ALL, tolerance=tolerance)
    if motion is None:
        return None
    scores = at.parameters.by_scores(motion.tangents, z)
    columns = np.column_stack([scores, motion.tangents[:, len(solver.names) :]])
    columns[:, d : d + n] *= np.exp(g)
    return motion.without_tangents(), columns


def exact_model(fit: LeastSquaresFit) -> LinearModel:
    """Return the linear model of a candidate's fit under exact laws."""
    target = fit.residual + fit.tangents @ fit.z
    return condense(fit.tangents, target, *fit.parameters.masks)


def linearise(
    solver: Solver, data: Data, at: LeastSquaresFit, u: np.ndarray | None = None
) -> Linearisation | None:
    """Return a candidate's linear model about u = (scores, g, h), by default its fit without deviations.

    None where the deviations are too large, or the motion escapes.
    """
    n = solver.knots.size
    u = np.concatenate([at.z, np.zeros(2 * n)]) if u is None else u
    g, h = np.split(u[at.z.size :], 2)
    if np.max(np.abs(g), initial=0.0) > MOST_G or np.max(np.abs(h), initial=0.0) > MOST_H:
        return None
    solution = _solve(solver, at, u)
    if solution is None:
        return None
    motion, columns = solution
    r = data.y - motion.y
    model = condense(columns, r + columns @ u, *at.parameters.masks)
    # Least squares of r by the columns, with the factor that `condense` has already computed.
    left = r - columns @ np.linalg.lstsq(model.root, model.target - model.root @ u, rcond=1e-12)[0]
    return Linearisation(at, u, motion, r, model, left)


def linearise_at_mode(
    solver: Solver,
    data: Data,
    fit: LeastSquaresFit,
    variance: float | None,
    start: Linearisation | None = None,
    near: bool = False,
) -> tuple[Linearisation, float] | None:
    """Return the model about the mode of parameters and deviations together, and the noise's variance.

    Parameters
    ----------
    solver : Solver
        Of the motions.
    data : Data
        The record.
    fit : Fit
        Under exact laws.
    variance : float or None
        Of the noise, in the record's unit squared; None: of what no parameter and no deviation explains.
    start : Linearisation, optional
        Where to start; by default the fit without deviations.
    near : bool
        Whether the mode is near the start, which is then returned if the model has its mode within `SETTLED`.
    """
    at = start or linearise(solver, data, fit)
    if at is None:
        return None
    d, grid, first = fit.z.size, at.grid(coarse=True), 0
    for _ in range(RELINEARISED):
        used = variance if variance is not None else at.variance(data)
        new = None
        for i, (share, hold) in enumerate(STEPS[first:], first):
            mode = mode_of(at.model, grid, used, at.z, hold)
            if near and at.distance(mode, used) < SETTLED:
                return at, used
            u = at.u + share * (mode - at.u)
            u[:d] = fit.parameters.retracted(solver.restoring, at.z, u[:d])
            trial = linearise(solver, data, fit, u)
            if trial is not None and trial.squares <= at.squares * (1 + 1e-6):
                new, first = trial, max(i - 1, 0)
                break
        if new is None:
            break
        moved, at = new.distance(at.u, used), new
        if moved < SETTLED:
            break
    return at, variance if variance is not None else at.variance(data)


def mode_of(
    model: LinearModel, grid: Grid, variance: float, scores: np.ndarray | None = None, hold: float = 0.0
) -> np.ndarray:
    """Return u at the mode under the likeliest hyperparameters, with no negative coefficient.

    Parameters
    ----------
    model : LinearModel
        The record about a motion.
    grid : Grid
        Hyperparameters of the deviations.
    variance : float
        Of the noise, in the record's unit squared.
    scores : ndarray, shape (d,), optional
        Where the scores are held.
    hold : float
        How firmly they are held there (Marquardt's parameter, in units of the prior's information).
    """
    top = int(np.argmax(normals(model, grid, variance, model.count, scores_only=True).log))
    d, total, sd = model.positive.size, model.root.shape[1], np.sqrt(variance)
    root = np.eye(total)
    root[d:, d:] = grid.only(np.array([top])).factors[0]
    stacked = np.concatenate([model.root @ root / sd, np.eye(total)])
    aim = np.concatenate([model.target / sd, np.zeros(total)])
    positive = np.concatenate([model.positive, np.zeros(total - d, bool)])
    if scores is not None and hold > 0:
        stacked = np.concatenate([stacked, np.sqrt(hold) * np.eye(d, total)])
        aim = np.concatenate([aim, np.sqrt(hold) * scores])
    return root @ nonnegative(stacked, aim, positive)
