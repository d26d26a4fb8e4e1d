"""Sample the most probable candidates: posteriors and evidence with exact motions instead of a linear model.

A candidate is a sum of damping terms under a restoring law. Exact motions are solutions of the equation of motion, one
for each draw. Sampling starts from the posterior of a linear model about the candidate's mode. If a damping term has a
parameter of its own, such as an exponent, it may start from several linear models, one in each slice of this parameter.

If the restoring law allows it, the linear model has straight coordinates (`StraightParameters`) in place of some of the
standard normal scores, which stand for the parameters. They are needed because a record determines the equilibrium
angle and the frequency far better than gravity: the posterior of stiffness, gravity and spring angle is curved, and a
linear model in the scores is accurate only within a few posterior sds of the mode.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import TypeVar
from zlib import crc32

import numpy as np

from bayesdamp.inference.deviation.candidate import exact_model, linearise, linearise_at_mode, refit
from bayesdamp.inference.deviation.linear import LinearModel, LinearPosterior, linear_posterior
from bayesdamp.inference.deviation.model_comparison import CandidateResult, ModelComparison
from bayesdamp.inference.deviation.parameters import Parameters, straighten_at
from bayesdamp.inference.deviation.slices import SlicedProposal, slice_proposal
from bayesdamp.inference.deviation.tempered import SMC_DRAWS, sample_posterior
from bayesdamp.machine import at_once
from bayesdamp.physics.kernel import Solver
from bayesdamp.physics.kernel.solve import NONE, TOLERANCE

MOST_ANCHORS = 3
"""Largest number of times that the anchor of straight coordinates is moved to the new mode (conventional). In straight
coordinates motions are more nearly linear (`StraightParameters`); near the anchor, a point, they agree with the
standard normal scores of the parameters."""
ANCHOR_CHANGE = 0.1
"""The anchor of straight coordinates (see `MOST_ANCHORS`) is moved to the mode again if, at the mode, one of the
coordinates differs by at least this from the standard normal score that it replaces (conventional)."""
NATS_BEHIND = 5.0
"""A candidate (a sum of damping terms under a restoring law) is sampled if its log evidence is less than this many nats
below the best. Sampling has never changed a log evidence by more (measured)."""
MOST_SAMPLED = 6
"""Largest number of candidates and rivals (sums of damping terms under restoring laws) that are sampled
(conventional)."""
LOOSER_TOLERANCES = (3e-6, 1e-6, 3e-7)
"""Tolerances with which the motions of draws may be solved, the loosest first: errors of an integration step, as
fractions of the amplitude (conventional). The first tolerance that is accurate enough (`LARGEST_ERROR`) is used."""
LARGEST_ERROR = 0.05
"""Largest allowed error of a draw's motion that a loose tolerance of the solver causes: norm of the error over all
samples, in standard deviations of the noise. Such an error shifts no parameter by more than this fraction of the
parameter's sd."""
TRIED_DRAWS = 4
"""Number of draws for which `draw_solver` compares the motion with a more accurate one (conventional)."""
T = TypeVar("T")


@dataclass(frozen=True)
class DrawSolver:
    """Solver of the motions of draws, with a loose tolerance and one correction that is added to each motion.

    The correction is the motion with the tolerance of fits (`TOLERANCE`) minus that with `tolerance`, computed at the
    centre of the distribution from which sampling starts (`LinearProposal.middle`). It is nearly the same for all
    motions nearby (defect correction; H. J. Stetter, Numer. Math. 29, 425 (1978)).

    Attributes
    ----------
    solver : Solver
        Solver of the candidate's equation of motion.
    parameters : Parameters
        Map from the standard normal scores of a draw, or from straight coordinates, to the solver's parameters.
    active : ndarray of bool, shape (m,)
        Which of the solver's terms exert a force.
    tolerance : float
        Error of an integration step, as a fraction of the amplitude.
    correction : ndarray, shape (n,), or float
        Correction that is added to each motion, in the record's unit.
    """

    solver: Solver
    parameters: Parameters
    active: np.ndarray
    tolerance: float = TOLERANCE
    correction: np.ndarray | float = 0.0

    def at_each(self, rows: np.ndarray, use: Callable[[np.ndarray | None], T]) -> list[T]:
        """Solve the motion of each draw in `rows`, apply the function `use` to it, and return the list of m results.

        Parameters
        ----------
        rows : ndarray, shape (m, d) or (m, d + 2 k)
            Each row has the d parameters as standard normal scores, or in the coordinates that `parameters` uses
            instead. The deviations from the laws may follow, at k knots in time: g (log damping), then h (relative
            frequency). Without them the laws are exact.
        use : callable
            Function of a motion in the form of the data, (n,), with the correction. It gets None if the motion is
            unbounded, or if the scores correspond to no finite parameters.
        """
        d, n = self.parameters.free.size, self.solver.knots.size
        values, deviations = self.parameters.values(rows[:, :d]), rows[:, d:]
        g, h = np.expm1(deviations[:, :n]), deviations[:, n:]

        def at(i: int) -> T:
            if not np.all(np.isfinite(values[i])):
                return use(None)
            own = (g[i], h[i]) if deviations.size else (None, None)
            motion = self.solver.solve(values[i], self.active, *own, NONE, tolerance=self.tolerance)
            return use(None if motion is None else motion.y + self.correction)

        return at_once(at, range(len(rows)))


def draw_solver(result: CandidateResult, start: LinearProposal | SlicedProposal) -> DrawSolver:
    """Return the solver for draws with the loosest tolerance that is accurate enough.

    Its motions, after a common correction, differ by less than `LARGEST_ERROR` (norm over the record, in sds of the
    noise) from those with the tolerance of fits (`TOLERANCE`). This is checked at `TRIED_DRAWS` draws from `start`, the
    distribution from which sampling starts; the correction is computed at `start.middle`. `TOLERANCE` is used if no
    tolerance in `LOOSER_TOLERANCES` is accurate enough, or if one of these motions is unbounded.
    """
    usual, sd = DrawSolver(result.solver, start.parameters, result.fit.active), np.sqrt(result.variance)
    drawn = start.draws(TRIED_DRAWS, np.random.default_rng(0))[0]
    rows = start.scores(np.vstack([start.middle, drawn]))
    wanted = usual.at_each(rows, lambda y: y)
    if any(y is None for y in wanted):
        return usual
    for tolerance in LOOSER_TOLERANCES:
        looser = replace(usual, tolerance=tolerance)
        motions = looser.at_each(rows, lambda y: y)
        errors = [np.inf if y is None else right - y for right, y in zip(wanted, motions, strict=True)]
        if all(float(np.linalg.norm(error - errors[0])) / sd < LARGEST_ERROR for error in errors[1:]):
            return replace(looser, correction=errors[0])
    return usual


@dataclass(frozen=True)
class LinearProposal:
    """The distribution from which sampling starts (the proposal): the posterior of a linear model.

    Its unknowns u, (K,), are the parameters, as standard normal scores or straight coordinates (in which motions are
    more nearly linear), then the deviations from the laws, g (log damping) and h (relative frequency), at knots in
    time. parameters: maps the first elements of u to parameters. model: the linear model. posterior: its posterior.
    """

    parameters: Parameters
    model: LinearModel
    posterior: LinearPosterior

    @property
    def log_evidence(self) -> float:
        """Log evidence of the linear model, in nats."""
        return self.posterior.log_evidence

    @property
    def middle(self) -> np.ndarray:
        """Posterior mean of the unknowns u, (K,), in the most probable component of the mixture.

        A component is one of the normal distributions whose mixture is the posterior. The cut-off of coefficients at
        zero is ignored.
        """
        return self.posterior.top_mean

    def draws(self, count: int, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
        """Draw the unknowns u, (count, K), from the posterior of the linear model.

        u contains the parameters, as standard normal scores or straight coordinates (in which motions are more nearly
        linear), then the deviations g and h from the laws at knots in time. The posterior is a mixture of normal
        distributions (components); return also the index of the component from which each draw comes, (count,).
        """
        return self.posterior.draws(count, rng)

    def crank_nicolson_step(
        self, u: np.ndarray, combos: np.ndarray, step: float, rng: np.random.Generator
    ) -> np.ndarray:
        """Return draws u, (n, K), after a random Crank–Nicolson step, which leaves the proposal distribution as it is.

        u: the draws before the step. combos: index of each draw's mixture component, (n,). step: size of the step in
        posterior sds, between 0 and 1; a step of 1 gives independent draws. Scores of coefficients may become negative.
        """
        return self.posterior.crank_nicolson_step(u, combos, step, rng)

    def scores(self, u: np.ndarray) -> np.ndarray:
        """Return u itself, (n, K): draws of this proposal are already in the coordinates of `parameters`."""
        return u

    def log_ratio(self, u: np.ndarray, squares: np.ndarray, variance: float) -> np.ndarray:
        """Return the log importance weights of draws u, (n,): log posterior minus log proposal density.

        The mean weight is the evidence with exact motions divided by that of the linear model. For exact motions the
        equation of motion is solved for each draw. squares: sums of squared residuals of the exact motions, (n,).
        variance: variance of the noise, in the record's unit squared.
        """
        prior = self.parameters.log_prior_ratio(u[:, : self.parameters.free.size])
        return 0.5 * (self.model.squares(u) - squares) / variance + prior


def proposal_of(comparison: ModelComparison, result: CandidateResult) -> LinearProposal | SlicedProposal:
    """Return the distribution from which the sampling of a candidate starts.

    It is the posterior of the candidate's linear model about its mode, in straight coordinates (`StraightParameters`)
    if these exist. If a damping term has a parameter of its own that the record determines poorly, such as an exponent,
    it is a mixture of such posteriors over slices of this parameter (see `slice_proposal`).
    """
    start = _straighten(comparison, result)
    if start is None:
        start = LinearProposal(result.fit.parameters, result.model, result.posterior)
    return slice_proposal(comparison, result, start.parameters, start.posterior) or start


def _straighten(comparison: ModelComparison, result: CandidateResult) -> LinearProposal | None:
    """Return the linear model and the posterior of a candidate about its mode, in straight coordinates.

    In these coordinates (`StraightParameters`) motions are more nearly linear. Return None if the coordinates do not
    exist (see `straighten_at`), or if the motion cannot be linearised.
    """
    data, solver, law = comparison.data, result.solver, result.candidate.restoring
    coordinates = straighten_at(result.fit.parameters, law, result.z)
    if coordinates is None:
        return None
    fit = replace(result.fit, parameters=coordinates, z=result.z)
    if result.linearisation is None:
        fit = refit(solver, data, fit)
        model = None if fit is None else exact_model(fit)
    else:
        at = linearise(solver, data, fit, result.linearisation.u)
        for _ in range(MOST_ANCHORS):
            mode = None if at is None else linearise_at_mode(solver, data, at.fit, result.variance, at)
            if mode is None:
                return None
            z, d = mode.z, mode.z.size
            plain = mode.fit.parameters.plain(z)
            coordinates = straighten_at(result.fit.parameters, law, plain)
            if coordinates is None:
                return None
            fit = replace(result.fit, parameters=coordinates, z=plain)
            at = linearise(solver, data, fit, np.concatenate([plain, mode.u[d:]]))
            if np.abs(plain - z).max() < ANCHOR_CHANGE:
                break
        model = None if at is None else at.model
    if fit is None or model is None:
        return None
    posterior = linear_posterior(model, result.grid(), result.variance, comparison.samples)
    return LinearProposal(fit.parameters, model, posterior)


def with_samples(comparison: ModelComparison, seed: int = 0) -> ModelComparison:
    """Return a copy of the comparison in which the most probable candidates and rivals have draws in `sampled`.

    Rivals are sums of damping terms with a form of damping that is not compared. At most `MOST_SAMPLED` results are
    sampled: those with the largest log evidence, within `NATS_BEHIND` nats of the best. Only results whose evidence may
    be compared with the others are considered (`ModelComparison.compares`). Equal seeds give equal draws.
    """
    every = [r for r in (*comparison.results, *comparison.forms) if comparison.compares(r)]
    every.sort(key=lambda r: -r.log_evidence)
    close = [r for r in every[:MOST_SAMPLED] if r.log_evidence > every[0].log_evidence - NATS_BEHIND]
    drawn = at_once(lambda r: sampled_result(comparison, r, seed), close)
    sampled = dict(zip(map(id, close), drawn, strict=True))
    results = tuple(sampled.get(id(r), r) for r in comparison.results)
    return replace(comparison, results=results, forms=tuple(sampled.get(id(r), r) for r in comparison.forms))


def sampled_result(
    comparison: ModelComparison, result: CandidateResult, seed: int = 0, draws: int = SMC_DRAWS
) -> CandidateResult:
    """Return a copy of a candidate's result with draws from its posterior in `sampled`.

    The equation of motion is solved for each draw. `sampled.draws` contains the parameters as standard normal scores,
    then the deviations g (log damping) and h (relative frequency) unless laws are exact, even if other coordinates are
    used in the sampling. draws: number of draws. Equal seeds give equal draws of the same candidate; different
    candidates have different random streams.
    """
    start, y = proposal_of(comparison, result), comparison.data.y
    motions, evaluations = draw_solver(result, start), 0

    def squares(motion: np.ndarray | None) -> float:
        return np.inf if motion is None else float(np.sum((y - motion) ** 2))

    def ratio(w: np.ndarray) -> np.ndarray:
        """Return the log importance weights, (n,), of draws w, (n, K), from the proposal `start`.

        They are −∞ where a coefficient that must be ≥ 0 is negative, or where the motion is unbounded.
        """
        nonlocal evaluations
        ratios = np.full(len(w), -np.inf)
        inside = np.flatnonzero(np.all(w[:, np.flatnonzero(start.parameters.positive)] >= 0, axis=1))
        evaluations += inside.size
        if inside.size:
            left = motions.at_each(start.scores(w[inside]), squares)
            ratios[inside] = start.log_ratio(w[inside], np.array(left), result.variance)
        return ratios

    own_seed = crc32(result.candidate.name.encode()) + seed % 2**32
    sampled = sample_posterior(ratio, start, draws=draws, seed=own_seed)
    w = sampled.draws
    if isinstance(start, SlicedProposal):
        # In all draws the sliced parameter is at the middle of a slice: a Metropolis step moves it within the slice.
        rng = np.random.default_rng([own_seed, 1])
        new = start.redraw_within_slice(w, rng)
        accepted = np.log(rng.random(len(w))) < ratio(new) - sampled.log_ratios
        w = np.where(accepted[:, None], new, w)
    d, u = start.parameters.free.size, start.scores(w)
    u[:, :d] = start.parameters.plain(u[:, :d])
    return replace(result, sampled=replace(sampled, draws=u, evaluations=evaluations))
