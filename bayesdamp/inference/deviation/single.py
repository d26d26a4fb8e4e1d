"""One candidate on one record, with deviations from its laws: its posterior density, draws and motions.

A candidate is a sum of damping terms under a restoring law. The deviations are g (log damping) and h (relative
frequency), with values at knots in time. u = (scores, g, h) are all unknowns of the candidate.
"""

import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from threadpoolctl import threadpool_limits

from bayesdamp.inference.deviation.candidate import MotionCandidate, active_of, linearise, solve_at
from bayesdamp.inference.deviation.data import Data, prepare_data
from bayesdamp.inference.deviation.draws import (
    CandidateDraws,
    Quantity,
    mean_deviation,
    noise_sds,
    quantity,
    ratios_at,
    with_parts_of_sd,
)
from bayesdamp.inference.deviation.least_squares import SEARCHED, LeastSquaresFit
from bayesdamp.inference.deviation.linear import knots_of
from bayesdamp.inference.deviation.model_comparison import (
    CandidateResult,
    ModelComparison,
    compare_candidates,
)
from bayesdamp.inference.deviation.parameters import Parameters
from bayesdamp.inference.deviation.sample_noise import AUTOMATIC
from bayesdamp.inference.deviation.sampling import DrawSolver, LinearProposal, draw_solver, sampled_result
from bayesdamp.inference.diagnostics import summarise, verdict
from bayesdamp.inference.mode import LinearDraws, Mode
from bayesdamp.inference.model.likelihood import Likelihood
from bayesdamp.inference.model.target import Deviation, Target
from bayesdamp.inference.noise import FittedNoise, SampleNoise
from bayesdamp.machine import at_once
from bayesdamp.physics.damping import PAPER_TERMS, TERMS
from bayesdamp.physics.kernel import Motion, Solver
from bayesdamp.physics.kernel.averaged import AveragedSolver
from bayesdamp.physics.kernel.solve import NONE, PARAMETERS, TOLERANCE
from bayesdamp.physics.oscillator import Oscillator, Trajectories
from bayesdamp.priors import Prior
from bayesdamp.types import Friction, Posterior, Ratio, Reference, Refusal, Signal

Array = NDArray[np.float64]
ESCAPED = (
    'the equation of motion cannot be solved near the fit with deviations from its laws; use deviation "none"'
)
"""Message of the Refusal if a `Single` (one candidate with deviations from its laws) cannot be computed, because the
motion near the fit is unbounded or cannot be linearised."""
NEGLIGIBLE_PROBABILITY = 1e-8
"""`Single.mode` leaves out combinations of sizes and correlation lengths of the deviations from the laws if their
posterior probability, in the linear model about the mode, is at most this (conventional)."""
LINEAR_DRAWS = 4000
"""Number of draws in `Single.scores`, from the posterior of the linear model about the mode: the ends of a 95 %
interval are then accurate to a thirtieth of its width."""
SEED_STEP = 1_000_003
"""Difference between the random seeds of independent chains, so that they have different random streams
(conventional)."""


class DeviatingTrajectories(Trajectories):
    """Motions with fixed deviations g and h from the laws, in the form of the fitted data.

    g is the log deviation of the damping, h the relative deviation of the frequency. The data are samples, means of
    neighbouring samples, or amplitudes and phases of blocks of cycles. The methods are those of `Trajectories`, but a
    value of epsilon has no effect: that of the solver is used.

    Parameters
    ----------
    motions : DrawSolver
        Solver of the motions, with its tolerance and correction. They are not used where derivatives are computed: the
        tolerance is then `SEARCHED`.
    deviations : tuple of ndarray, shape (k,)
        Relative deviations of damping (exp g − 1) and frequency (h) at the k knots in time.
    given : mapping of str to float
        Values, by name, of the parameters of the motion that are not inferred; those that are missing are 0.
    """

    def __init__(
        self, motions: DrawSolver, deviations: tuple[np.ndarray, np.ndarray], given: Mapping[str, float]
    ) -> None:
        self._solver, self._motions, self._deviations = motions.solver, motions, deviations  # type: ignore[assignment]
        self._given = {**dict.fromkeys(motions.solver.names, 0.0), **given}
        self._rests, self._count = False, motions.solver.t.size

    def _solve(self, p: Mapping[str, float], tangents: int, solver: Solver | None = None) -> Motion | None:
        vector = np.array([float(p.get(name, self._given[name])) for name in self._solver.names])
        motions, tolerance = self._motions, SEARCHED if tangents else self._motions.tolerance
        motion = motions.solver.solve(
            vector, motions.active, *self._deviations, tangents, tolerance=tolerance
        )
        return motion if motion is None or tangents else replace(motion, y=motion.y + motions.correction)


@dataclass(frozen=True)
class FitState:
    """The stored result of a candidate's fit, from which `rebuild_single` rebuilds a `Single` without fitting again.

    The candidate is a sum of damping terms under a restoring law. A score stands for an inferred parameter and has the
    prior N(0, 1). Deviations from the laws are g (log damping) and h (relative frequency) at knots in time.

    Attributes
    ----------
    terms : tuple of str
        Damping terms of the solver. The candidate has only those of them whose coefficient is inferred.
    reference : Reference
        Amplitude and frequency with which default priors scale.
    priors, known : mapping
        Priors of the inferred parameters, and values of the other parameters, by name.
    z : ndarray, shape (d,)
        Scores of the fit under exact laws (without deviations).
    u : ndarray, shape (K,)
        Scores, g and h at the mode (most probable point) with deviations.
    variance, inflation : float
        `variance` is the variance of the noise, in the record's unit squared. It contains the factor `inflation`, κ ≥
        1, for correlated residuals (see `sample_noise.inflation`).
    exact_variance : float
        Variance of the noise if laws are exact, in the record's unit squared.
    epsilon : float
        Width ε of the velocity range in which dry friction changes its sign, in rad/s or m/s.
    frictions : tuple of Friction
        Possible values of ε and their probabilities.
    averaged : bool
        Whether the record is reduced to amplitudes and phases.
    noise : FittedNoise
        Noise model of the samples.
    working : ndarray, shape (n,), optional
        The values to which the motion is fitted by least squares if the noise is not Gaussian: motion plus working
        residuals (see `sample_noise`). None under Gaussian noise, and for a record that is reduced to amplitudes and
        phases.
    """

    terms: tuple[str, ...]
    reference: Reference
    priors: Mapping[str, Prior]
    known: Mapping[str, float]
    z: np.ndarray
    u: np.ndarray
    variance: float
    inflation: float
    exact_variance: float
    epsilon: float
    frictions: tuple[Friction, ...] = ()
    averaged: bool = False
    noise: FittedNoise = field(default_factory=FittedNoise)
    working: np.ndarray | None = None


@dataclass(frozen=True)
class Single:
    """One candidate with deviations from its laws, linearised about its mode.

    `bayesdamp.fit` uses it unless laws are assumed to be exact. A candidate is a sum of damping terms under a restoring
    law. The deviations are g (log damping) and h (relative frequency). The mode is the most probable point.

    Attributes
    ----------
    comparison, result
        A `ModelComparison` with this candidate as its only result, and its `CandidateResult`.
    state : FitState
        The stored result of the fit.
    """

    comparison: ModelComparison
    result: CandidateResult
    state: FitState

    @cached_property
    def mode(self) -> Mode:
        """Return the mode of the posterior of the parameters, with the deviations g and h from the laws integrated out.

        The parameters are standard normal scores. `z` of the result are the scores at the joint mode of scores and
        deviations; the motion is linear in the deviations about this point. `linear` contains the draws `scores` of the
        linear model's posterior, without g and h. `information` is the inverse of their covariance. Raises Refusal if
        the motion with deviations is unbounded or could not be linearised.
        """
        comparison, data, result = self.comparison, self.comparison.data, self.result
        solver, parameters = result.solver, result.fit.parameters
        linearisation, posterior = result.linearisation, result.posterior
        if linearisation is None:
            raise Refusal(ESCAPED)
        solution = solve_at(solver, result.fit, linearisation.u, SEARCHED)
        if solution is None:
            raise Refusal(ESCAPED)
        tangents = solution[1]
        # Integrate out the deviations, linearised about the mode, over the probable grid points.
        z, d, grid = linearisation.z, linearisation.z.size, result.grid()
        basis, upper = np.linalg.qr(tangents[:, d:])
        probability = np.bincount(posterior.combos, posterior.weights, minlength=grid.log_prior.size)
        probable = np.flatnonzero(probability > NEGLIGIBLE_PROBABILITY)
        deviation = Deviation(
            DeviatingTrajectories(
                draw_solver(result, LinearProposal(parameters, result.model, posterior)),
                linearisation.deviations,
                parameters.known,
            ),
            comparison.variance,
            comparison.samples,
            basis,
            tangents[:, d:] @ linearisation.u[d:],
            grid.log_prior[probable],
            grid.factors[probable],
            upper @ grid.factors[probable] / np.sqrt(comparison.variance),
            probability[probable] / probability[probable].sum(),
        )
        signal = Signal(data.t, data.y, data.quantity)
        known = {**parameters.known, "epsilon": solver.epsilon, **self.known}
        target = Target(signal, self.oscillator, "gaussian", parameters.priors, known, deviation=deviation)
        likelihood = Likelihood.near(target, z, TOLERANCE * data.recorded_amplitude)
        scores = self.scores[:, :d]
        information = np.linalg.inv(np.atleast_2d(np.cov(scores.T)))
        linear = LinearDraws(scores, float(posterior.log_evidence))
        return Mode(z, likelihood.log_posterior(z), information, likelihood, linear=linear)

    @cached_property
    def scores(self) -> Array:
        """Return `LINEAR_DRAWS` draws of all K unknowns from the posterior of the linear model about the mode, (n, K).

        A draw contains the parameters as standard normal scores, then the deviations g (log damping) and h (relative
        frequency) at knots in time. The draws are ordered by component of the posterior (see `LinearPosterior`), so a
        part of them must be chosen from the whole range. The seed is fixed, so that they are always the same.
        """
        return self.result.posterior.draws(LINEAR_DRAWS, np.random.default_rng(0))[0]

    @property
    def names(self) -> tuple[str, ...]:
        """Return the names of the inferred parameters, in the order of their scores in a draw."""
        return self.result.fit.parameters.free_names

    @property
    def oscillator(self) -> Oscillator:
        """Return the oscillator with the candidate's damping terms and restoring law, without deviations from them."""
        candidate = self.result.candidate
        return Oscillator(candidate.damping, candidate.restoring)

    @property
    def known(self) -> dict[str, float]:
        """Return, by name, the values of the parameters that are not inferred.

        These are the known parameters of the motion, and the parameters of the noise (only `noise_sd`, the sd of a
        sample, for Gaussian noise or a record that is reduced to amplitudes and phases). The parameters of the noise
        are fixed at the values that were chosen for this fit: they are estimated from the record, unless the noise is
        given. If a term is dry friction, or steep at zero velocity, there is also `epsilon`, the width of the velocity
        range in which it changes its sign.
        """
        comparison = self.comparison
        own = (*self.oscillator.parameters, "noise_sd")
        known = {n: v for n, v in self.state.known.items() if n in own}
        known |= {"epsilon": comparison.epsilon} if self.oscillator.switches else {}
        if self.state.working is not None:
            return {**known, **self.state.noise.values}
        variance = comparison.variance / comparison.inflation * comparison.data.thinned
        return {**known, "noise_sd": float(np.sqrt(variance))}

    def values(self, u: Array) -> Array:
        """Return the inferred parameters in their units, (..., p), in the order of `names`.

        u: draws of all unknowns, (..., K), whose first p elements are the parameters as standard normal scores.
        """
        parameters = self.result.fit.parameters
        return parameters.values(u[..., : parameters.free.size])[..., parameters.free]

    def with_parts_of_sds(self, posterior: Posterior) -> Posterior:
        """Return a copy of a posterior whose summaries contain two parts of each parameter's standard deviation (sd).

        `sd_noise` is the sd that noise alone would cause, at most the sd. `sd_law` is the part that is caused by
        deviations of the motion from the damping law and the restoring law. They add up as sd² = sd_noise² + sd_law².
        """
        each = posterior.summaries.items()
        return replace(posterior, summaries={n: with_parts_of_sd(s, self.noise_sds[n]) for n, s in each})

    def draw_deviations(self, draws: np.ndarray, seed: int) -> Array:
        """Draw the deviations g and h given draws of the parameters, (chain, draw, p), and return u, (chain, draw, K).

        draws: the inferred parameters in their units. u contains the parameters as standard normal scores, then g (log
        damping) and h (relative frequency) at knots in time. Given the parameters, the motion is linear in g and h
        about the mode.
        """
        scores = [self.state.priors[n].score(draws[..., i]) for i, n in enumerate(self.names)]
        z = np.stack(scores, axis=-1).reshape(-1, len(scores))
        likelihood, rng = self.mode.likelihood, np.random.default_rng([seed, 4])
        deviation = likelihood.target.deviation
        assert deviation is not None
        drawn = [deviation.draw_given(r, rng) for r in at_once(likelihood.residual, z)]
        u = np.concatenate([z, np.array(drawn).reshape(len(z), -1)], axis=1)
        return u.reshape(*draws.shape[:2], -1)

    def quantities(self) -> dict[str, Quantity]:
        """Return median, 95 % interval and parts of the sd (see `Quantity`) of each inferred parameter, by name.

        They are computed from draws of the linear model about the mode (`scores`), and are in the parameter's unit.
        """
        values, noise = self.values(self.scores), self.noise_sds
        return {n: quantity(values[:, i], noise[n]) for i, n in enumerate(self.names)}

    @cached_property
    def noise_sds(self) -> dict[str, float]:
        """Return, by name, the sd of each inferred parameter, in its unit, that noise alone would cause.

        It would be the posterior sd if the laws were exact.
        """
        return noise_sds(self.comparison, self.result)

    def deviations(self, u: Array) -> tuple[Array, Array]:
        """Return the deviations g (log damping) and h (relative frequency) at k knots in time, (n, k) each.

        u: n draws of all unknowns, (n, K), which contain g and h after the scores of the parameters.
        """
        g, h = np.split(u[:, self.result.fit.z.size :], 2, axis=1)
        return g, h

    @property
    def knots(self) -> Array:
        """Return the times, in s from the start of the record, of the k knots of the deviations from the laws, (k,).

        The deviations change linearly between knots.
        """
        return self.result.solver.knots * self.result.solver.slowness

    def sizes(self, u: Array) -> tuple[Array, Array]:
        """Return for each draw the mean size over the record of the deviations g and h from the laws, (n,) each.

        g is the log deviation of the damping, h the relative deviation of the frequency. The size is the mean of |g −
        mean of g| or |h − mean of h|; all means over the record are weighted by the oscillation's energy. u: draws of
        all unknowns, (n, K).
        """
        g, h = self.deviations(u)
        return mean_deviation(self.result, g), mean_deviation(self.result, h)

    def ratios(self, amplitudes: Sequence[float], u: Array, sensor: float) -> tuple[Ratio, ...]:
        """Return median, 95 % interval and parts of the sd (`Quantity`) of the damping ratio at each amplitude.

        amplitudes: in rad or m. u: draws of all unknowns, (n, K), from which the numbers are computed; the ratio
        includes the deviations from the laws. sensor: relative sd of the sensor's linearity and clock; each draw is
        multiplied by a random factor with mean 1 and this sd. All numbers but the amplitude are nan if no orbit has
        this amplitude.
        """
        drawn, rng = CandidateDraws.of(self.result, u), np.random.default_rng(1)
        return ratios_at(self.comparison, [drawn], amplitudes, sensor, rng)

    def motions(self, u: Array, t: Array | None = None, quantity: str | None = None) -> Array:
        """Return the motions, (n, m), of n draws u of all unknowns, (n, K); a motion that is unbounded is NaN.

        By default motions have the form of the fitted data (samples, means, or amplitudes and phases). If t is given,
        they are values at the m times t instead, in s from the first sample, between the first and the last of `knots`.
        quantity: angle, velocity or acceleration, only used with t; by default the recorded quantity. With t, values
        are in the unit of the displacement, per s for a velocity and per s² for an acceleration; otherwise in that of
        `Data.y`.
        """
        fit, solver = self.result.fit, self.result.solver
        if t is not None:
            solver = solver.at(np.asarray(t, float), quantity or solver.quantity)
        assert solver.kernel  # compile it before several threads need it
        none = np.full(solver.t.size, np.nan)
        solve = DrawSolver(solver, fit.parameters, fit.active).at_each
        return np.array(solve(u, lambda y: none if y is None else y)).reshape(len(u), none.size)

    @property
    def best(self) -> Array:
        """Return the mode (most probable point) of all unknowns with deviations from the laws, as a row, (1, K).

        It contains the parameters as standard normal scores, then the deviations g (log damping) and h (relative
        frequency) at knots in time.
        """
        linearisation = self.result.linearisation
        assert linearisation is not None
        return linearisation.u[None]

    def log_likelihoods(self, motions: Array) -> Array:
        """Return the log likelihood of each of the record's n values (`Data.y`) under motions, (..., n), in nats.

        The result has the shape of `motions`, and the noise counts as white and Gaussian: under other noise, `Data.y`
        is a motion plus working residuals, with which least squares are correct (see `sample_noise`). The sum over the
        values is the log likelihood that the evidence uses. If residuals are correlated, the variance of the noise
        contains a factor κ > 1; the term −log(2π variance)/2 of each value is then divided by κ.
        """
        comparison = self.comparison
        variance, kappa = comparison.variance, comparison.inflation
        left = np.asarray(comparison.data.y) - motions
        return -0.5 * left**2 / variance - 0.5 * np.log(2 * np.pi * variance) / kappa

    def prior_draws(self, count: int, seed: int) -> Array:
        """Draw all unknowns from the prior, (count, K).

        A draw contains the parameters as standard normal scores, then the deviations g (log damping) and h (relative
        frequency) at knots in time. With probability 0.8 each (`PROBABILITY_EXACT`), g and h are 0 at all knots.
        """
        grid, rng = self.result.grid(), np.random.default_rng([seed, 1])
        z = self.result.fit.parameters.prior_draws(count, rng)
        mass = np.exp(grid.log_prior - grid.log_prior.max())
        combos = rng.choice(mass.size, count, p=mass / mass.sum())
        normal = rng.standard_normal((count, 2 * self.knots.size))
        return np.concatenate([z, np.einsum("nij,nj->ni", grid.factors[combos], normal)], axis=1)


def fit_single(
    data: Data,
    damping: Sequence[str],
    restoring: str,
    *,
    known: Mapping[str, float],
    priors: Mapping[str, Prior],
    reference: Reference,
    noises: Sequence[str] = AUTOMATIC,
) -> Single:
    """Fit one candidate with deviations from its laws, and compute its evidence.

    A candidate is a sum of damping terms under a restoring law. The noise and the width of friction are chosen with a
    larger sum, that of `PAPER_TERMS` and the candidate's other terms, as in a comparison, so that two dampings under
    one restoring law are compared under the same noise.

    Parameters
    ----------
    data : Data
        The record.
    damping : sequence of str
        Names of the candidate's damping terms.
    restoring : str
        Name of its restoring law.
    known : mapping of str to float
        Values of parameters that are not inferred, by name. They may include `noise_sd` (sd of a sample's noise) and
        `epsilon` (width of the velocity range in which dry friction changes its sign).
    priors : mapping of str to Prior
        Priors by the name of the parameter; the others have default priors.
    reference : Reference
        Amplitude and frequency with which default priors scale.
    noises : sequence of str
        Names of the noise models from which one is chosen. They have no effect if `data` is reduced to amplitudes and
        phases, whose noise model is `data.noise_model`.

    Raises
    ------
    InputError
        If a name is unknown, or an inferred parameter has neither a given nor a default prior.
    Refusal
        Where no motion stays in phase with the record, the motion with deviations is unbounded, or none of the noise
        models applies. Also where the predicted log evidence of the candidate is more than `REACH` nats below that of
        the larger sum (`model_comparison.FAR_BEHIND`).
    """
    asked = MotionCandidate(tuple(damping), restoring)
    whole = MotionCandidate((*PAPER_TERMS, *(t for t in damping if t not in PAPER_TERMS)), restoring)
    with threadpool_limits(1, "blas"):
        comparison = compare_candidates(
            data,
            dict.fromkeys([whole, asked]),
            known=known,
            priors=priors,
            reference=reference,
            noises=noises,
        )
    result = next((r for r in comparison.results if set(r.candidate.damping) == set(damping)), None)
    if result is None:
        raise Refusal(comparison.refused.get(asked, ESCAPED))
    return _rebuild(data, result.candidate, state_of(comparison, result))


def state_of(comparison: ModelComparison, result: CandidateResult) -> FitState:
    """Return the values from which `rebuild_single` restores a candidate's result without fitting again.

    comparison: the comparison that contains `result`. Raises Refusal if the result has no deviations from the laws.
    """
    if result.linearisation is None:
        raise Refusal(ESCAPED)
    parameters, solver = result.fit.parameters, result.solver
    return FitState(
        terms=solver.terms,
        reference=comparison.reference,
        priors=parameters.priors,
        known=parameters.known,
        z=result.fit.z,
        u=result.linearisation.u,
        variance=comparison.variance,
        inflation=comparison.inflation,
        exact_variance=result.exact_variance,
        epsilon=solver.epsilon,
        frictions=comparison.frictions,
        averaged=comparison.data.averaged is not None,
        noise=comparison.noise.fitted,
        working=None if comparison.data.readings is None else comparison.data.y,
    )


def rebuild_single(signal: Signal, restoring: str, state: FitState) -> Single:
    """Rebuild the result of a candidate from its stored fit, without fitting it again.

    signal: the complete record to which the candidate was fitted. restoring: name of the candidate's restoring law.
    state: the stored fit, which also determines the damping terms. Raises Refusal if the motion is unbounded or the
    record does not oscillate.
    """
    damping = tuple(t for t in state.terms if TERMS.get(t).parameter in state.priors)
    return _rebuild(
        prepare_data(signal, state.averaged, SampleNoise(state.noise)),
        MotionCandidate(damping, restoring),
        state,
    )


def _rebuild(data: Data, candidate: MotionCandidate, state: FitState) -> Single:
    """Rebuild the result of a candidate from its stored fit, and linearise it about the stored motion.

    data: the record, prepared as for the fit. state: the stored fit. Raises Refusal if the motion is unbounded or the
    deviations are too large, for example because the fit belongs to another record.
    """
    knots = knots_of(data.end, data.cycles)
    if state.working is not None:
        data = replace(data, y=state.working, readings=data.recorded)
    solver = data.solver(state.terms, candidate.restoring, state.epsilon, knots)
    parameters = Parameters(solver.names, state.priors, state.known)
    active, p = active_of(parameters, solver), parameters.values(state.z)
    if isinstance(solver, AveragedSolver):
        z, g, h = np.split(state.u, [state.z.size, state.z.size + knots.size])
        solver = solver.with_defect(parameters.values(z), active, np.expm1(g), h) or solver
    motion = solver.solve(p, active, tangents=NONE)
    moved = solver.solve(p, active, tangents=PARAMETERS, tolerance=SEARCHED)
    if motion is None or moved is None:
        raise Refusal(ESCAPED)
    tangents = parameters.by_scores(moved.tangents, state.z)
    fit = LeastSquaresFit(parameters, active, state.z, data.y - motion.y, tangents, motion)
    linearisation = linearise(solver, data, fit, state.u)
    if linearisation is None:
        raise Refusal(ESCAPED)
    comparison = ModelComparison(
        data, state.reference, state.epsilon, state.frictions, {candidate.restoring: solver}, state.variance,
        state.inflation, SampleNoise(state.noise),
    )  # fmt: skip
    result = comparison.evaluate_about(candidate, solver, fit, linearisation, state.exact_variance)
    return Single(replace(comparison, results=(result,)), result, state)


def sample_motions(single: Single, chains: int, draws: int, seed: int) -> tuple[Posterior, Array]:
    """Draw from the posterior of a candidate with exact motions, which are solved for each draw.

    Each chain is an independent run of sequential Monte Carlo, which starts from the linear model about the mode. The
    first chain has the draws of `sampling.sampled_result` with this seed, in another order.

    Parameters
    ----------
    single : Single
        The candidate.
    chains, draws : int
        Number of chains, and of draws in each.
    seed : int
        Seed of the random streams.

    Returns
    -------
    posterior : Posterior
        Its `draws` are the inferred parameters in their units, (chain, draw, parameter), in the order of
        `Single.names`. Its `diagnostics` are `log_evidence`, the log of the mean evidence of the chains in nats, and
        `stderr`, the standard error of this (−∞ and nan if the first motions of all chains are unbounded). Its
        `outcome` is not "ok" if a chain cannot be trusted or if the chains have not converged. Effective sample sizes
        are at most the number of different draws, because resampling makes copies.
    u : ndarray, shape (chain, draw, K)
        Draws of all unknowns: the parameters as standard normal scores, then the deviations from the laws, g (log
        damping) and h (relative frequency), at knots in time.
    """
    began, runs, rows = time.perf_counter(), [], []
    for chain in range(chains):
        run = sampled_result(single.comparison, single.result, seed + SEED_STEP * chain, draws).sampled
        assert run is not None
        runs.append(run)
        # Shuffle: resampling puts copies of a draw next to each other, which would look like autocorrelation.
        rows.append(run.draws[np.random.default_rng([seed, chain]).permutation(draws)])
    u = np.stack(rows)
    values = single.values(u)
    likelihood = single.log_likelihoods(single.motions(u.reshape(-1, u.shape[-1]))).sum(axis=1)
    summaries = {}
    for i, name in enumerate(single.names):
        summary, distinct = summarise(values[..., i]), float(np.unique(values[..., i]).size)
        summaries[name] = {**summary, **{k: min(summary[k], distinct) for k in ("ess_bulk", "ess_tail")}}
    doubts = dict.fromkeys(run.doubt for run in runs if run.doubt)
    outcome = f"sampling has not converged: {'; '.join(doubts)}" if doubts else verdict(summaries)
    logs, errors = np.array([run.log_evidence for run in runs]), np.array([run.stderr for run in runs])
    log_evidence, stderr = float(logs.max()), float("nan")
    if np.isfinite(log_evidence):
        weights = np.exp(logs - log_evidence)
        stderr = float(np.linalg.norm(weights * errors) / weights.sum())
        log_evidence = float(np.logaddexp.reduce(logs) - np.log(chains))
    posterior = Posterior(
        sampler="smc",
        names=single.names,
        draws=values,
        log_likelihood=likelihood.reshape(u.shape[:2]),
        stats={
            "acceptance_rate": np.repeat([[run.acceptance] for run in runs], draws, axis=1),
            "temperatures": np.repeat([[run.temperatures] for run in runs], draws, axis=1),
        },
        diagnostics={"log_evidence": log_evidence, "stderr": stderr},
        seconds=time.perf_counter() - began,
        outcome=outcome,
        summaries=summaries,
        evaluations=sum(run.evaluations for run in runs),
    )
    return posterior, u
