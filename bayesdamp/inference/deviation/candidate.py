"""Fit one candidate (damping terms under a restoring law) to a record, and linearise its motion in its unknowns."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import product

import numpy as np
import scipy  # loads its modules when they are used

from bayesdamp.inference.deviation.data import Data
from bayesdamp.inference.deviation.least_squares import SEARCHED, LeastSquaresFit, fit, nonnegative
from bayesdamp.inference.deviation.linear import Grid, LinearModel, condense, grid_of, log_evidences
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
"""Names of the parameters for the displacement and the velocity at the first sample."""
STARTS = (-1.0, 0.0, 1.0)
"""Fits start at these values of a parameter that a damping term has besides its coefficient, such as an exponent. They
are standard normal scores: the parameter is transformed so that its prior is N(0, 1), and the values are low, middle
and high in this prior. For two or more such parameters only the low and the high value are combined."""
MOST_STEPS = 8
"""Largest number of Gauss–Newton steps to the joint mode of a candidate's parameters and its deviations from the
laws."""
STEPS = ((1.0, 0.0), (0.5, 0.0), (1.0, 10.0), (1.0, 1e3), (1.0, 1e5))
"""Attempts that `linearise_at_mode` makes in turn for one Gauss–Newton step: the fraction of the full step, and
Marquardt's damping parameter, which changes the direction of the step. Where a record determines only a combination of
parameters (for small swings, a spring's angle and gravity), the parameters of equal fit form a curve. A full or a
shorter step goes along the tangent and leaves this curve; a damped step does not. The attempts for the next step begin
with the one before that which was accepted."""
SETTLED = 0.1
"""The Gauss–Newton steps end before a step that would change the motion by less than this: norm of the change over all
samples, in standard deviations of the noise. Such a step changes a log evidence by less than 0.1 nats (measured)."""
MOST_G, MOST_H = 3.0, 0.4
"""`MOST_G` and `MOST_H`: largest |g| and |h| at which a motion is linearised; beyond them the linearisation fails. The
damping force is multiplied by exp g, and the frequency by 1 + h."""


@dataclass(frozen=True)
class MotionCandidate:
    """A candidate of the comparison: a sum of damping terms under a restoring law.

    damping: names of the terms, such as ("viscous", "coulomb"). restoring: name of the law, such as "pendulum".
    """

    damping: tuple[str, ...]
    restoring: str

    @property
    def name(self) -> str:
        """Return the candidate's name, such as `viscous+coulomb@pendulum`."""
        return candidate_name("+".join(self.damping), self.restoring)


@dataclass(frozen=True)
class Linearisation:
    """The motion of a candidate (damping terms under a restoring law) as a linear function of its K unknowns u.

    u contains the d inferred parameters, transformed so that their priors are standard normal (scores), then the
    deviations from the laws at knots in time: first g (the damping force is multiplied by exp g), then h (the frequency
    is multiplied by 1 + h). Both have the same knots.

    Attributes
    ----------
    fit : LeastSquaresFit
        A fit of the candidate under exact laws (g = h = 0), with the same priors, known values and active terms; u may
        be far from it.
    u : ndarray, shape (K,)
        Values of the unknowns about which the motion is linearised.
    motion : Motion
        The motion at u.
    residual : ndarray, shape (n,)
        Record minus motion, in the record's unit.
    model : LinearModel
        The sum of squared residuals of the linearised motion as a quadratic function of the unknowns.
    left : ndarray, shape (n,)
        Residual of the linear model when all unknowns are fitted by least squares, without priors and bounds
        (coefficients may be negative), in the record's unit.
    """

    fit: LeastSquaresFit
    u: np.ndarray
    motion: Motion
    residual: np.ndarray
    model: LinearModel
    left: np.ndarray

    @property
    def z(self) -> np.ndarray:
        """Return the inferred parameters at u as scores, (d,): transformed so that their priors are standard normal."""
        return self.u[: self.fit.z.size]

    @property
    def values(self) -> np.ndarray:
        """Return the values of all k parameters of the solver at u, (k,), in the order of `Solver.names`."""
        return self.fit.parameters.values(self.z)

    @property
    def deviations(self) -> tuple[np.ndarray, np.ndarray]:
        """Return exp g − 1 and h: the relative deviations of damping and frequency, one value per knot each."""
        g, h = np.split(self.u[self.fit.z.size :], 2)
        return np.expm1(g), h

    @property
    def knots(self) -> int:
        """Return the number of knots in time between which each deviation from the laws is interpolated."""
        return (self.u.size - self.fit.z.size) // 2

    @property
    def squares(self) -> float:
        """Return the sum of the squares of `residual`, in the record's unit squared."""
        return float(np.sum(self.residual**2))

    def variance(self, data: Data) -> float:
        """Return the variance of the noise, in the record's unit squared.

        It is the sum of `left` squared divided by the degrees of freedom (n − K, at least 1), plus the variance of the
        solver's error (`Data.least_variance`, the only use of `data`).
        """
        degrees = max(self.left.size - self.u.size, 1)
        return data.least_variance + float(self.left @ self.left) / degrees

    def grid(self, coarse: bool) -> Grid:
        """Return the grid of hyperparameters of the deviations g and h: prior sds (sizes) and correlation lengths.

        coarse: if true, the grid contains only every other size, and only the shortest and the longest length.
        """
        return grid_of(self.knots, coarse=coarse, absorbed=self.fit.parameters.absorbs)

    def distance(self, u: np.ndarray, variance: float) -> float:
        """Return the norm of the change of the linearised motion from `self.u` to u, (K,), in sds of the noise.

        The norm is over all samples. variance: variance of the noise, in the record's unit squared.
        """
        return float(np.linalg.norm(self.model.root @ (self.u - u))) / np.sqrt(variance)


def parameters_of(
    candidate: MotionCandidate,
    solver: Solver,
    data: Data,
    reference: Reference,
    priors: Mapping[str, Prior],
    known: Mapping[str, float],
) -> Parameters:
    """Return the parameters of a candidate: which are inferred, with their priors, and the values of the others.

    Coefficients, and all other parameters without a known value, are inferred if the solver has them. Their prior is
    that in `priors` or else the default one, which scales with the amplitude and frequency of `reference` and is
    centred at the midline in `data` for displacements. A known value of a coefficient, and priors of parameters that
    are not inferred, have no effect. Raise InputError if an inferred parameter has neither a given nor a default prior.
    """
    osc = Oscillator(candidate.damping, candidate.restoring)
    inferred: dict[str, Prior] = {}
    for name in osc.parameters:
        if name in solver.names and (name not in known or name in osc.coefficients):
            given = priors.get(name)
            inferred[name] = given or default_prior(name, osc, "gaussian", reference, data.features)
    return Parameters(solver.names, inferred, {k: v for k, v in known.items() if k not in inferred})


def initial_values(candidate: MotionCandidate, data: Data, known: Mapping[str, float]) -> dict[str, float]:
    """Return the values at which a fit starts, by name: coefficients, restoring parameters and initial state.

    The coefficients are chosen so that each damping term causes the same part of the record's decay. The restoring
    parameters follow from the record's frequency and midline, and from the values of such parameters in `known`; other
    known values, also of the initial state, have no effect. Own parameters of terms, such as exponents, are not
    included (see `start_values`). Units are rad (or m) and s.
    """
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
    """Return combinations of values at which fits start, for the inferred parameters of terms besides coefficients.

    Such a parameter is an exponent, for example. Each combination maps the names of these parameters to values. If a
    term is equal to a simpler one at a certain value of a parameter (`DampingTerm.reduces`), this parameter starts only
    at that value. If there is one other parameter, it starts at a low, a middle and a high value in its prior; two or
    more start at all combinations of low and high values (`STARTS`). Without such parameters the result is one empty
    mapping.
    """
    terms = [TERMS.get(t) for t in candidate.damping]
    simple = {n: value for t in terms for n, value in t.reduces if n in parameters.priors}
    free = parameters.priors.keys() - simple.keys()
    names = [p.name for t in terms for p in t.inferred if p.name in free]
    scores = STARTS if len(names) == 1 else STARTS[::2]
    return [
        simple
        | {n: float(parameters.priors[n].value(np.asarray(z))) for n, z in zip(names, row, strict=True)}
        for row in product(scores, repeat=len(names))
    ]


def active_of(parameters: Parameters, solver: Solver) -> np.ndarray:
    """Return a mask, (m,), of the solver's terms that have an inferred coefficient; only these exert a force.

    A candidate infers the coefficients of all its own terms, also of those with a known value (see `parameters_of`).
    """
    return np.array([TERMS.get(t).parameter in parameters.priors for t in solver.terms])


def search(
    solver: Solver, data: Data, parameters: Parameters, starts: Sequence[Mapping[str, float]]
) -> LeastSquaresFit | None:
    """Fit a candidate to the record from each start; return the fit with the smallest sum of squared residuals.

    Each fit begins with the first cycles and goes on to longer and longer parts of the record. A start contains values
    of inferred parameters by name; inferred parameters that it does not contain start at the value 0. With several
    starts, the fits end early, and `refit` refines the best of them. The result is None if every fit fails, or if the
    refinement fails.
    """
    best: LeastSquaresFit | None = None
    active = active_of(parameters, solver)
    for start in starts:
        z = parameters.scores({**dict.fromkeys(parameters.free_names, 0.0), **start})
        z[parameters.positive] = np.maximum(z[parameters.positive], 0.0)
        new = fit(solver, parameters, active, data.y, z, noise=data.noise, rough=len(starts) > 1)
        if new is not None and (best is None or new.squares < best.squares):
            best = new
    return best if best is None or len(starts) == 1 else refit(solver, data, best)


def search_near(
    solver: Solver,
    data: Data,
    parameters: Parameters,
    values: Mapping[str, float],
    starts: Sequence[Mapping[str, float]],
) -> LeastSquaresFit | None:
    """Fit a candidate, starting near the motion of another candidate; None if this fails.

    The motion of the other candidate is linearised in all parameters of the solver. Linear least squares then give the
    values at which the fit starts. If `starts` has several elements, this is done for each, and the fit starts only
    from the result with the smallest predicted sum of squares. The fit uses the whole record at once.

    Parameters
    ----------
    solver : Solver
        Solver with the terms of both candidates.
    data : Data
        The record.
    parameters : Parameters
        Parameters of the candidate to be fitted.
    values : mapping of str to float
        Parameters of the other candidate by name; parameters of the solver that are not in it are 0. Known values in
        `parameters`, and then those in `starts`, replace them.
    starts : sequence of mapping
        Values of the terms' own parameters (such as exponents), by name, at which the fit may start; [{}] if there are
        none. With an empty sequence the result is None.
    """
    active, best, least = active_of(parameters, solver), None, np.inf
    for start in starts:
        given = {**dict.fromkeys(solver.names, 0.0), **values, **parameters.known, **start}
        p, z = np.array([given[n] for n in solver.names]), parameters.scores(given)
        motion = solver.solve(p, active | (p[: active.size] > 0), tolerance=SEARCHED)
        if motion is None:
            continue
        # The coefficients of terms that the candidate does not have go to 0.
        change = motion.tangents @ (parameters.values(z) - p)
        columns = parameters.by_scores(motion.tangents, z)
        model = condense(columns, data.y - motion.y - change, parameters.positive)
        # The further rows keep scores that do not change the motion at their values z.
        sd = np.sqrt(max(model.rest / data.y.size, data.noise**2))
        root = np.concatenate([model.root, sd * np.eye(z.size)])
        target = np.concatenate([model.target + model.root @ z, sd * z])
        new = nonnegative(root, target, parameters.positive)
        squares = model.rest + float(np.sum((root @ new - target) ** 2))
        if squares < least:
            best, least = parameters.retract(solver.restoring, z, new), squares
    if best is None:
        return None
    return fit(solver, parameters, active, data.y, best, noise=data.noise, windows=False)


def refit(solver: Solver, data: Data, at: LeastSquaresFit) -> LeastSquaresFit | None:
    """Fit a candidate to `data` with `solver`, starting near an earlier fit `at`; None if this fails.

    Priors, known values and inferred parameters are those of `at`. The earlier fit may be to other data or with another
    solver, which must have the same parameters.
    """
    return search_near(solver, data, at.parameters, at.parameters.named(at.z), [{}])


def solve_at(
    solver: Solver, at: LeastSquaresFit, u: np.ndarray, tolerance: float | None = None
) -> tuple[Motion, np.ndarray] | None:
    """Return a candidate's motion and its Jacobian by the K unknowns, (n, K); None if the motion is unbounded.

    A motion counts as unbounded if it grows beyond all bounds or needs too many integration steps.

    Parameters
    ----------
    solver : Solver
        Solver of the motions.
    at : LeastSquaresFit
        A fit of the candidate, from which only the parameters (priors, known values) and the active terms are used.
    u : ndarray, shape (K,)
        The unknowns: the parameters, transformed so that their priors are standard normal (scores), then g and h at
        knots in time. The damping force is multiplied by exp g, and the frequency by 1 + h.
    tolerance : float, optional
        Error of an integration step as a fraction of the amplitude; by default that of fits (3e-8).
    """
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
    """Return the linear model of a candidate's motion about its fit under exact laws (without deviations g and h).

    Its unknowns are the d inferred parameters, transformed so that their priors are standard normal (scores).
    """
    return condense(fit.tangents, fit.residual + fit.tangents @ fit.z, *fit.parameters.masks)


def linearise(
    solver: Solver, data: Data, at: LeastSquaresFit, u: np.ndarray | None = None
) -> Linearisation | None:
    """Linearise a candidate's motion about values u of its unknowns, (K,), by default about its fit `at`.

    u contains the parameters, transformed so that their priors are standard normal (scores), then the deviations from
    the laws at knots in time: g (the damping force is multiplied by exp g) and h (the frequency is multiplied by 1 +
    h). At the fit, which is under exact laws, g = h = 0. If u is given, only the parameters (priors, known values) and
    the active terms of `at` are used. Return None if |g| or |h| is larger than `MOST_G` or `MOST_H`, or if the motion
    is unbounded.
    """
    u = np.concatenate([at.z, np.zeros(2 * solver.knots.size)]) if u is None else u
    g, h = np.split(u[at.z.size :], 2)
    if np.max(np.abs(g), initial=0.0) > MOST_G or np.max(np.abs(h), initial=0.0) > MOST_H:
        return None
    solution = solve_at(solver, at, u)
    if solution is None:
        return None
    motion, columns = solution
    r = data.y - motion.y
    model = condense(columns, r + columns @ u, *at.parameters.masks)
    # Fit the columns to r by linear least squares, with the QR factor that `condense` has computed.
    # (Use pivoted QR, because the singular value decomposition of some of these matrices does not converge.)
    right = model.target - model.root @ u
    left = r - columns @ scipy.linalg.lstsq(model.root, right, cond=1e-12, lapack_driver="gelsy")[0]
    return Linearisation(at, u, motion, r, model, left)


def linearise_at_mode(
    solver: Solver,
    data: Data,
    fit: LeastSquaresFit,
    variance: float | None,
    start: Linearisation | None = None,
) -> Linearisation | None:
    """Linearise a candidate about the joint mode of its parameters and deviations g and h, by Gauss–Newton steps.

    In each step the hyperparameters (prior sds and correlation lengths of the deviations) have their most probable
    values in the coarse grid of `Linearisation.grid` (see `prior_root`). The steps end

    - before a step that would change the motion by less than `SETTLED`;
    - if no attempt in `STEPS` is accepted. An attempt is accepted if its sum of squared residuals is at most the larger
      of two values: the present sum, and the sum that the linear model predicts (apart from a small tolerance);
    - after `MOST_STEPS` steps.

    Parameters
    ----------
    solver : Solver
        Solver of the motions.
    data : Data
        The record.
    fit : LeastSquaresFit
        The fit under exact laws (g = h = 0). If `start` is given, only the parameters (priors, known values) and the
        active terms of the fit are used.
    variance : float or None
        Variance of the noise, in the record's unit squared; if None, that of `Linearisation.variance` at each step.
    start : Linearisation, optional
        The linearisation at which the steps start; by default that at the fit without deviations.

    Returns
    -------
    Linearisation or None
        The linearisation at the end of the last step; None if the motion cannot be linearised at the start.
    """
    at = start or linearise(solver, data, fit)
    if at is None:
        return None
    d, grid, first = fit.z.size, at.grid(coarse=True), 0
    for _ in range(MOST_STEPS):
        used = variance if variance is not None else at.variance(data)
        root = prior_root(at.model, grid, used)
        for i, (share, hold) in enumerate(STEPS[first:], first):
            mode = mode_of(at.model, root, used, at.z, hold)
            if at.distance(mode, used) < SETTLED:
                return at
            u = at.u + share * (mode - at.u)
            predicted = at.model.rest + float(np.sum((at.model.root @ u - at.model.target) ** 2))
            u[:d] = fit.parameters.retract(solver.restoring, at.z, u[:d])
            trial = linearise(solver, data, fit, u)
            if trial is not None and trial.squares <= max(at.squares, predicted) + SETTLED**2 * used:
                at, first = trial, max(i - 1, 0)
                break
        else:
            break
    return at


def prior_root(model: LinearModel, grid: Grid, variance: float) -> np.ndarray:
    """Return a matrix R, (K, K), for which R Rᵀ is the prior covariance of a linear model's K unknowns.

    The unknowns are the parameters, transformed so that their priors are standard normal (scores), then the deviations
    from the laws at knots in time: g (the damping force is multiplied by exp g) and h (the frequency is multiplied by 1
    + h). All scores have the variance 1 here; a common scale of coefficients is ignored. The prior sds and correlation
    lengths of g and h have their most probable values in the grid, which are computed without the condition that
    coefficients are ≥ 0. variance: variance of the noise, in the record's unit squared.
    """
    top = int(np.argmax(log_evidences(model, grid, variance, model.count)))
    root, d = np.eye(model.root.shape[1]), model.positive.size
    root[d:, d:] = grid.only(np.array([top])).factors[0]
    return root


def mode_of(
    model: LinearModel, root: np.ndarray, variance: float, scores: np.ndarray, hold: float
) -> np.ndarray:
    """Return the mode u, (K,), of a linear model's posterior, with coefficients ≥ 0.

    u contains the parameters, transformed so that their priors are standard normal (scores), then the deviations from
    the laws at knots in time: g (the damping force is multiplied by exp g) and h (the frequency is multiplied by 1 +
    h).

    Parameters
    ----------
    model : LinearModel
        The sum of squared residuals as a quadratic function of u.
    root : ndarray, shape (K, K)
        Matrix R, where R Rᵀ is the prior covariance of u.
    variance : float
        Variance of the noise, in the record's unit squared.
    scores : ndarray, shape (d,)
        Present scores, to which `hold` pulls the solution.
    hold : float
        Marquardt's damping parameter: weight of the pull, relative to the weight 1 of the prior of each score. 0 gives
        the mode, a larger value a point between it and `scores`.
    """
    d, total, sd = model.positive.size, model.root.shape[1], np.sqrt(variance)
    stacked = np.concatenate([model.root @ root / sd, np.eye(total), np.sqrt(hold) * np.eye(d, total)])
    aim = np.concatenate([model.target / sd, np.zeros(total), np.sqrt(hold) * scores])
    return root @ nonnegative(stacked, aim, np.concatenate([model.positive, np.zeros(total - d, bool)]))
