"""Sample the most probable candidates: posteriors and evidence with exact motions instead of a linear model.

Sampling starts from a linear model, in straight coordinates where the restoring law has them, and from one in each of
several slices where a damping term has a parameter of its own. A record determines the angle at rest and the
frequency far better than gravity, so that a posterior of spring, gravity and spring's angle lies along a curve, which a
linear model leaves after a few of its sds.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from zlib import crc32

import numpy as np

from bayesdamp.inference.deviation.candidate import exact_model, linearise, linearise_at_mode, refit
from bayesdamp.inference.deviation.linear import LinearModel, LinearPosterior, linear_posterior
from bayesdamp.inference.deviation.model_comparison import CandidateResult, ModelComparison
from bayesdamp.inference.deviation.parameters import Parameters, straight_at
from bayesdamp.inference.deviation.slices import SlicedProposal, sliced
from bayesdamp.inference.deviation.tempered import DRAWS, sample_posterior
from bayesdamp.machine import at_once
from bayesdamp.physics.kernel import Solver
from bayesdamp.physics.kernel.solve import NONE, TOLERANCE

ANCHORS = 3
"""Largest number of times that straight coordinates are anchored at the mode in the last ones."""
CLOSE = 0.1
"""Largest difference of coordinates and scores at the mode for which the coordinates are not anchored again."""
BEHIND = 5.0
"""Nats behind the best, by linear posteriors, up to which a candidate is sampled: more than sampling has changed any
log evidence (measured)."""
MOST = 6
"""Largest number of candidates that are sampled (conventional)."""
LOOSER = (3e-6, 1e-6, 3e-7)
"""Errors of an integration step, as fractions of the amplitude, that are tried in turn."""
APART = 0.05
"""Largest error of a motion: the norm over all samples, in standard deviations of the noise. It moves no parameter by
more of its own sd."""
TRIED = 4
"""Number of draws for which this is checked."""


@dataclass(frozen=True)
class DrawMotions:
    """Solve the motions of draws with a loose tolerance and a common correction.

    The correction is the difference that the usual tolerance makes for one of the motions. It is nearly the same for
    all motions nearby (defect correction; H. J. Stetter, Numer. Math. 29, 425 (1978)).

    Attributes
    ----------
    solver : Solver
        Of the motions.
    parameters : Parameters
        What the scores of draws stand for.
    active : ndarray of bool, shape (m,)
        Which of the solver's terms act.
    tolerance : float
        Error of an integration step, as a fraction of the amplitude.
    correction : ndarray, shape (n,), or float
        Correction that is added to each motion.
    """

    solver: Solver
    parameters: Parameters
    active: np.ndarray
    tolerance: float = TOLERANCE
    correction: np.ndarray | float = 0.0

    def at(self, row: np.ndarray) -> np.ndarray | None:
        """Return the motion of a draw, (K,), at the samples, (n,); None where it escapes."""
        d, n = self.parameters.free.size, self.solver.knots.size
        p = self.parameters.values(row[:d])
        if not np.all(np.isfinite(p)):
            return None
        g, h = (np.expm1(row[d : d + n]), row[d + n :]) if row.size > d else (None, None)
        motion = self.solver.solve(p, self.active, g, h, NONE, tolerance=self.tolerance)
        return None if motion is None else motion.y + self.correction


def motions_near(result: CandidateResult, start: LinearProposal | SlicedProposal) -> DrawMotions:
    """Return motions to the loosest tolerance that keeps draws of a candidate's linear posterior within `APART`."""
    usual, sd = DrawMotions(result.solver, start.parameters, result.fit.active), np.sqrt(result.variance)
    drawn = start.draws(TRIED, np.random.default_rng(0))[0]
    rows = [start.middle, *start.scores(drawn)]
    wanted = [usual.at(row) for row in rows]
    if any(y is None for y in wanted):
        return usual
    for tolerance in LOOSER:
        looser = replace(usual, tolerance=tolerance)
        motions = [looser.at(row) for row in rows]
        errors = [np.inf if y is None else right - y for right, y in zip(wanted, motions, strict=True)]
        if all(float(np.linalg.norm(error - errors[0])) / sd < APART for error in errors[1:]):
            return replace(looser, correction=errors[0])
    return usual


@dataclass(frozen=True)
class LinearProposal:
    """A linear posterior as the proposal of scores and deviations u, (K,), in the coordinates of `parameters`."""

    parameters: Parameters
    model: LinearModel
    posterior: LinearPosterior

    @property
    def log_evidence(self) -> float:
        """Log evidence of the linear model, in nats."""
        return self.posterior.log_evidence

    @property
    def middle(self) -> np.ndarray:
        """Posterior mean of u under the most probable hyperparameters, (K,)."""
        return self.posterior.means[int(np.argmax(self.posterior.log_each))]

    def draws(self, count: int, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
        """Draw u, (count, K). Return also the index of each draw's hyperparameters, (count,)."""
        return self.posterior.draws(self.parameters.positive, count, rng)

    def moved(self, u: np.ndarray, combos: np.ndarray, step: float, rng: np.random.Generator) -> np.ndarray:
        """Return draws after a Crank–Nicolson step, (n, K). Its stationary distribution is this proposal."""
        return self.posterior.moved(u, combos, step, rng)

    def inside(self, u: np.ndarray) -> np.ndarray:
        """Return for each draw, (n, K), whether all scores that must not be negative are not, (n,)."""
        return np.all(u[:, np.flatnonzero(self.parameters.positive)] >= 0, axis=1)

    def scores(self, u: np.ndarray) -> np.ndarray:
        """Return u itself: draws are made in these coordinates."""
        return u

    def log_ratio(self, u: np.ndarray, squares: np.ndarray, variance: float) -> np.ndarray:
        """Return the log importance weights of draws u, (n,), from the sums of squares of their motions, (n,)."""
        prior = self.parameters.log_prior_ratio(u[:, : self.parameters.free.size])
        return 0.5 * (self.model.squares(u) - squares) / variance + prior


def proposal_of(comparison: ModelComparison, result: CandidateResult) -> LinearProposal | SlicedProposal:
    """Return the linear posterior that a candidate's draws start from.

    It is in straight coordinates where the restoring law has any, and in slices of a parameter of the damping terms
    where they have one; else it is the one by which the candidate was posterior.
    """
    start = _straightened(comparison, result)
    if start is None:
        start = LinearProposal(result.fit.parameters, result.model, result.posterior)
    return sliced(comparison, result, start.parameters, start.posterior) or start


def _straightened(comparison: ModelComparison, result: CandidateResult) -> LinearProposal | None:
    """Return the linear model in straight coordinates; None where there are none, or the motion escapes."""
    data, solver, law = comparison.data, result.solver, result.candidate.restoring
    coordinates = straight_at(result.fit.parameters, law, result.z)
    if coordinates is None:
        return None
    fit = replace(result.fit, parameters=coordinates, z=result.z)
    if result.linearisation is None:
        fit = refit(solver, data, fit)
        model = None if fit is None else exact_model(fit)
    else:
        at = linearise(solver, data, fit, result.linearisation.u)
        for _ in range(ANCHORS):
            mode = None if at is None else linearise_at_mode(solver, data, at.fit, result.variance, at)
            if mode is None:
                return None
            z, d = mode[0].z, mode[0].z.size
            plain = mode[0].fit.parameters.plain(z)
            coordinates = straight_at(result.fit.parameters, law, plain)
            if coordinates is None:
                return None
            fit = replace(result.fit, parameters=coordinates, z=plain)
            at = linearise(solver, data, fit, np.concatenate([plain, mode[0].u[d:]]))
            if np.abs(plain - z).max() < CLOSE:
                break
        model = None if at is None else at.model
    if fit is None or model is None:
        return None
    posterior = linear_posterior(model, result.grid(), result.variance, comparison.samples)
    return LinearProposal(fit.parameters, model, posterior)


def with_samples(comparison: ModelComparison, seed: int = 0) -> ModelComparison:
    """Return the comparison with its likeliest candidates and rivals sampled.

    The evidence of the linear models decides which they are.
    """
    every = [r for r in (*comparison.results, *comparison.forms) if comparison.compares(r)]
    if not every:
        return comparison
    best = max(r.log_evidence for r in every)
    close = sorted((r for r in every if r.log_evidence > best - BEHIND), key=lambda r: -r.log_evidence)[:MOST]
    sampled = {id(r): sampled_result(comparison, r, seed) for r in close}
    results = tuple(sampled.get(id(r), r) for r in comparison.results)
    return replace(comparison, results=results, forms=tuple(sampled.get(id(r), r) for r in comparison.forms))


def sampled_result(
    comparison: ModelComparison, result: CandidateResult, seed: int = 0, draws: int = DRAWS
) -> CandidateResult:
    """Return the result with draws from the posterior with exact motions; equal seeds give equal draws."""
    start, y = proposal_of(comparison, result), comparison.data.y
    motions = motions_near(result, start)

    def squares(row: np.ndarray) -> float:
        motion = motions.at(row)
        return np.inf if motion is None else float(np.sum((y - motion) ** 2))

    def ratio(w: np.ndarray) -> np.ndarray:
        """Return the log importance weights of draws w, (n, K): (n,)."""
        return start.log_ratio(w, np.array(at_once(squares, start.scores(w))), result.variance)

    own_seed = crc32(result.candidate.name.encode()) + seed % 2**32
    sampled = sample_posterior(ratio, start, draws=draws, seed=own_seed)
    w = sampled.draws
    if isinstance(start, SlicedProposal):
        # All were at the middles of their slices: a Metropolis step moves each within its own.
        rng = np.random.default_rng([own_seed, 1])
        new = start.spread(w, rng)
        accepted = np.log(rng.random(len(w))) < ratio(new) - sampled.log_ratios
        w = np.where(accepted[:, None], new, w)
    d, u = start.parameters.free.size, start.scores(w)
    u[:, :d] = [start.parameters.plain(row) for row in u[:, :d]]
    return replace(result, sampled=replace(sampled, draws=u))
