"""The candidates that matter, sampled: posteriors and evidence of the motions themselves, not of a linear model.

Sampling starts from a linear model, in straight coordinates where the restoring law has them, and along the ridge of
the damping terms' own parameters where they have one. A record determines the angle at rest and the frequency far
better than gravity, so that a posterior of spring, gravity and spring's angle lies along a curve, which a linear
model leaves after a few of its sds.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from zlib import crc32

import numpy as np

from bayesdamp.inference.deviation.candidate import exact_model, linearise, linearise_at_mode, refit
from bayesdamp.inference.deviation.linear import LinearModel, LinearPosterior, linear_posterior
from bayesdamp.inference.deviation.model_comparison import CandidateResult, ModelComparison
from bayesdamp.inference.deviation.parameters import Parameters, straight_at
from bayesdamp.inference.deviation.ridge import Ridge, ridge_of
from bayesdamp.inference.deviation.tempered import DRAWS, sample_posterior
from bayesdamp.machine import at_once
from bayesdamp.physics.kernel import Solver
from bayesdamp.physics.kernel.solve import NONE, TOLERANCE

ANCHORS = 3
"""How often the coordinates are laid through the mode in the last ones, at most."""
CLOSE = 0.1
"""Largest difference of v and z at the mode, in scores, for which the coordinates are not laid again."""
BEHIND = 5.0
"""Nats behind the best under linear models up to which a candidate is sampled: more than sampling has moved any by."""
MOST = 6
"""Candidates that are sampled at most."""
LOOSER = (3e-6, 1e-6, 3e-7)
"""Errors of a step, as shares of the amplitude, that are tried in turn."""
APART = 0.05
"""Largest error of a motion, in standard deviations of the whole record's noise: no parameter moves by more of its own
sd."""
TRIED = 4
"""Draws for which this is checked."""


@dataclass(frozen=True)
class DrawMotions:
    """Motions of draws, solved only as closely as the record's noise requires.

    The motions are solved to a tolerance, and all get the correction to `TOLERANCE` that one of them needs: the
    errors of motions that are near each other are nearly the same (defect correction; H. J. Stetter, Numer. Math. 29,
    425 (1978)).

    Attributes
    ----------
    solver : Solver
        Of the motions.
    parameters : Parameters or Ridge
        What the scores of draws stand for.
    active : ndarray of bool, shape (m,)
        Which of the solver's terms act.
    tolerance : float
        Error of a step as a share of the amplitude.
    correction : ndarray, shape (n,), or float
        What is added to each motion.
    """

    solver: Solver
    parameters: Parameters | Ridge
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


def motions_near(
    result: CandidateResult, parameters: Parameters | Ridge, posterior: LinearPosterior
) -> DrawMotions:
    """Return motions to the loosest tolerance that keeps draws of the linear posterior within `APART`.

    Parameters
    ----------
    result : CandidateResult
        Of the candidate.
    parameters : Parameters or Ridge
        As of `DrawMotions`.
    posterior : LinearPosterior
        The linear posterior in the coordinates of `parameters`.
    """
    usual, sd = DrawMotions(result.solver, parameters, result.fit.active), np.sqrt(result.variance)
    middle = posterior.means[int(np.argmax(posterior.log_each))]
    rows = [middle, *posterior.draws(parameters.positive, TRIED, np.random.default_rng(0))[0]]
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
class SamplingStart:
    """What sampling starts from: a linear model in the coordinates of `parameters`, weighed."""

    parameters: Parameters | Ridge
    model: LinearModel
    posterior: LinearPosterior

    def scores(self, draws: np.ndarray) -> np.ndarray:
        """Return standard normal scores with g and h, (n, K), of draws."""
        d, scores = self.parameters.free.size, draws.copy()
        scores[:, :d] = [self.parameters.plain(row[:d]) for row in draws]
        return scores


def reference_of(comparison: ModelComparison, result: CandidateResult) -> SamplingStart:
    """Return the linear model that a candidate's draws start from.

    In straight coordinates, about the mode in them, where there are any; else the model by which it was weighed.
    Along a ridge where there is one.
    """
    start = _straightened(comparison, result)
    if start is None:
        start = SamplingStart(result.fit.parameters, result.model, result.posterior)
    assert isinstance(start.parameters, Parameters)
    ridge = ridge_of(result, start.parameters, start.model, start.posterior)
    if ridge is None:
        return start
    model = replace(start.model, positive=ridge.positive)
    return SamplingStart(
        ridge, model, linear_posterior(model, result.grid(), result.variance, comparison.samples)
    )


def _straightened(comparison: ModelComparison, result: CandidateResult) -> SamplingStart | None:
    """Return the linear model in straight coordinates; None where there are none."""
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
    return SamplingStart(fit.parameters, model, posterior)


def with_samples(comparison: ModelComparison, seed: int = 0) -> ModelComparison:
    """Return the weighing with its likeliest candidates and rivals sampled.

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
    """Return a candidate's result with its motions sampled; a seed always gives the same draws of a candidate."""
    start = reference_of(comparison, result)
    parameters, model, y = start.parameters, start.model, comparison.data.y
    motions = motions_near(result, parameters, start.posterior)

    def squares(row: np.ndarray) -> float:
        motion = motions.at(row)
        return np.inf if motion is None else float(np.sum((y - motion) ** 2))

    def ratio(u: np.ndarray) -> np.ndarray:
        """Return the log of the motions' likelihood over the linear model's, of draws (n, K): (n,)."""
        solved = np.array(at_once(squares, u))
        linear = np.sum((u @ model.root.T - model.target) ** 2, axis=1) + model.rest
        prior = parameters.log_prior_ratio(u[:, : parameters.free.size])
        return 0.5 * (linear - solved) / result.variance + prior

    own_seed = crc32(result.candidate.name.encode()) + seed % 2**32
    sampled = sample_posterior(ratio, start.posterior, parameters.positive, draws=draws, seed=own_seed)
    return replace(result, sampled=replace(sampled, draws=start.scores(sampled.draws)))
