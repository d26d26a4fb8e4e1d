"""One candidate on one record under laws that hold approximately: its numbers, its motions, its density and draws."""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from threadpoolctl import threadpool_limits

from bayesdamp.inference.checks.diagnostics import summarise, verdict
from bayesdamp.inference.checks.forecast import Ahead
from bayesdamp.inference.deviation.candidate import Candidate, active_of, linearised
from bayesdamp.inference.deviation.data import Data, prepared
from bayesdamp.inference.deviation.density import ESCAPED, density_of
from bayesdamp.inference.deviation.gaussian.hyperparameters import grid_of, knots_of
from bayesdamp.inference.deviation.least_squares import SEARCHED, Fit
from bayesdamp.inference.deviation.numbers.curves import ratio_at, ratios_drawn
from bayesdamp.inference.deviation.numbers.deviations import size_of
from bayesdamp.inference.deviation.numbers.draws import Drawn, Quantity, quantity
from bayesdamp.inference.deviation.parameters import Parameters
from bayesdamp.inference.deviation.sample_noise import AUTOMATIC, SampleNoise
from bayesdamp.inference.deviation.sampled.candidates import sampled_result
from bayesdamp.inference.deviation.sampled.motions import Motions
from bayesdamp.inference.deviation.sampled.table import noise_sds
from bayesdamp.inference.deviation.weighing import Result, Weighing, weigh_all
from bayesdamp.inference.fit.mode import Mode
from bayesdamp.inference.noise._residuals import FittedNoise
from bayesdamp.machine.threads import at_once
from bayesdamp.physics.damping import PAPER_TERMS, TERMS
from bayesdamp.physics.kernel.averaged import AveragedSolver
from bayesdamp.physics.kernel.solve import NONE, PARAMETERS
from bayesdamp.physics.oscillator import Oscillator
from bayesdamp.priors import Prior
from bayesdamp.types import Friction, Posterior, Ratio, Reference, Refusal, Signal

APART = 1_000_003
"""Between the seeds of independent runs."""


def sample_motions(single: Single, chains: int, draws: int, seed: int) -> Posterior:
    """Draw the motions themselves, by so many independent runs; the first is `compare`'s for as many draws.

    Returns
    -------
    Posterior
        `arrays["u"]` has each draw with its deviations, (chain, draw, K); `diagnostics` the log evidence in nats, the
        log of the mean of the runs' evidences, and its standard error. Draws that were copied in the last resampling
        count once in effective sample sizes.
    """
    began, each, rows = time.perf_counter(), [], []
    for chain in range(chains):
        run = sampled_result(single.weighing, single.result, True, seed + APART * chain, draws).sampled
        assert run is not None
        each.append(run)
        # A run leaves its draws in the order of what they descend from, which is none of time.
        rows.append(run.draws[np.random.default_rng([seed, chain]).permutation(draws)])
    u = np.stack(rows)
    values = single.values(u)
    likelihood = single.log_likelihoods(single.motions(u.reshape(-1, u.shape[-1]))).sum(axis=1)
    summary = {}
    for i, name in enumerate(single.names):
        one, distinct = summarise(values[..., i]), float(np.unique(values[..., i]).size)
        summary[name] = {**one, **{k: min(one[k], distinct) for k in ("ess_bulk", "ess_tail")}}
    poor = [run.acceptance for run in each if not run.trusted]
    outcome = verdict(summary)
    if poor:
        outcome = f"the motions could not be led to from the linear model: {min(poor):.2f} of the last moves were taken"
    logs, errors = np.array([run.log_evidence for run in each]), np.array([run.stderr for run in each])
    log_evidence, stderr = float(logs.max()), float("nan")
    if np.isfinite(log_evidence):
        weights = np.exp(logs - log_evidence)
        stderr = float(np.linalg.norm(weights * errors) / weights.sum())
        log_evidence = float(np.logaddexp.reduce(logs) - np.log(chains))
    return Posterior(
        sampler="smc",
        names=single.names,
        draws=values,
        log_likelihood=likelihood.reshape(u.shape[:2]),
        stats={
            "acceptance_rate": np.repeat([[run.acceptance] for run in each], draws, axis=1),
            "temperatures": np.repeat([[run.temperatures] for run in each], draws, axis=1),
        },
        diagnostics={"log_evidence": log_evidence, "stderr": stderr},
        seconds=time.perf_counter() - began,
        outcome=outcome,
        summaries=summary,
        arrays={"u": u},
    )


Array = NDArray[np.float64]
DRAWS = 4000
"""Of the linear model, behind values and intervals: an end of an interval is good to a thirtieth of its width."""


@dataclass(frozen=True)
class Found:
    """Where the search on a record ended: all that the rest follows from, without a search.

    terms: of the solver, those of the candidate among them. z: scores of the best motion under exact laws, (d,); u:
    scores, log g and h of the best under approximate ones, (K,). variance, inflation: of the noise that counts, κ in
    it; exact_variance: of what exact laws leave; epsilon: the width of friction's turning over, rad/s or m/s; averaged:
    whether the record was taken as amplitudes and phases. noise: of the samples; working: the values that least squares
    are made to where it is not Gaussian, (n,).
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
    """A candidate with deviations of its damping and restoring laws, linear about its best motion, and what was asked
    of it.

    weighing, result: of the candidate alone; found: where the search for it ended.
    """

    weighing: Weighing
    result: Result
    found: Found

    @cached_property
    def mode(self) -> Mode:
        """The density of the parameters, deviations integrated out, about its mode. Raises Refusal where no motion with
        deviations can be followed."""
        return density_of(self.weighing, self.result, self.scores[:, : self.result.fit.z.size], self.known)

    def with_deviations(self, z: Array, seed: int | Sequence[int]) -> Array:
        """Scores (n, d), each with a draw of log g and h given them, (n, K)."""
        likelihood, rng = self.mode.likelihood, np.random.default_rng(seed)
        deviation = likelihood.target.deviation
        assert deviation is not None
        drawn = [deviation.draw_given(r, rng) for r in at_once(likelihood.residual, z)]
        return np.concatenate([z, np.array(drawn).reshape(len(z), -1)], axis=1)

    @cached_property
    def scores(self) -> Array:
        """Draws of the linear model: scores, log g and h at the knots, (n, K)."""
        result = self.result
        assert result.weighed is not None
        return result.weighed.draws(result.fit.parameters.positive, DRAWS, np.random.default_rng(0))[0]

    @property
    def names(self) -> tuple[str, ...]:
        """Of the inferred parameters."""
        return self.result.fit.parameters.free_names

    @property
    def oscillator(self) -> Oscillator:
        """Its laws, as if they held exactly."""
        candidate = self.result.candidate
        return Oscillator(candidate.damping, candidate.restoring)

    @property
    def known(self) -> dict[str, float]:
        """What is held: parameters, friction's width where there is any, and the noise's sd of a sample."""
        weighing = self.weighing
        own = (*self.oscillator.parameters, "noise_sd")
        found = {n: v for n, v in self.found.known.items() if n in own}
        found |= {"epsilon": weighing.epsilon} if self.oscillator.switches else {}
        if self.found.working is not None:
            return {**found, **self.found.noise.values}
        variance = weighing.variance / weighing.inflation * weighing.data.thinned
        return {**found, "noise_sd": float(np.sqrt(variance))}

    def values(self, u: Array) -> Array:
        """Inferred parameters in natural units of draws (..., K): (..., p)."""
        parameters = self.result.fit.parameters
        return parameters.values(u[..., : parameters.free.size])[..., parameters.free]

    def completed(self, posterior: Posterior, seed: int) -> tuple[Posterior, Array]:
        """Return draws of the parameters with the parts of their sds, and each with deviations, (chain, draw, K): its
        own, or drawn given the parameters."""
        parts = {n: min(self.noise_sds[n], one["sd"]) for n, one in posterior.summaries.items()}
        summaries = {
            n: {**one, "sd_noise": parts[n], "sd_law": float(np.sqrt(one["sd"] ** 2 - parts[n] ** 2))}
            for n, one in posterior.summaries.items()
        }
        arrays = {n: a for n, a in posterior.arrays.items() if n != "u"}
        whole = replace(posterior, summaries=summaries, arrays=arrays)
        if "u" in posterior.arrays:
            return whole, posterior.arrays["u"]
        z = np.stack(
            [self.found.priors[n].score(posterior.draws[..., i]) for i, n in enumerate(self.names)], axis=-1
        )
        u = self.with_deviations(z.reshape(-1, z.shape[-1]), [seed, 4])
        return whole, u.reshape(*z.shape[:2], -1)

    def quantities(self) -> dict[str, Quantity]:
        """Each inferred parameter: median, 95 % interval, and the parts of its sd."""
        values, noise = self.values(self.scores), self.noise_sds
        return {
            n: quantity(values[:, i], min(noise[n], float(np.std(values[:, i]))))
            for i, n in enumerate(self.names)
        }

    @cached_property
    def noise_sds(self) -> dict[str, float]:
        """The sd that noise alone would leave of each inferred parameter, were the laws exact."""
        return dict(zip(self.names, map(float, noise_sds(self.weighing, self.result)), strict=True))

    def deviations(self, u: Array) -> tuple[Array, Array]:
        """Log g and h at the knots of draws (n, K): (n, k) each."""
        g, h = np.split(u[:, self.result.fit.z.size :], 2, axis=1)
        return g, h

    @property
    def knots(self) -> Array:
        """Times in s from the first sample."""
        return self.result.solver.knots * self.result.solver.slowness

    def sizes(self, u: Array) -> tuple[Array, Array]:
        """Energy-weighted mean of |log g| and |h| over the record, of draws (n, K): (n,) each."""
        g, h = self.deviations(u)
        return size_of(self.weighing, self.result, g), size_of(self.weighing, self.result, h)

    def ratios(self, amplitudes: Sequence[float], u: Array, sensor: float) -> tuple[Ratio, ...]:
        """Equivalent damping ratios at amplitudes (rad or m), deviation and the sensor's floor among their sds."""
        drawn, rng = Drawn.of(self.result, u), np.random.default_rng(1)
        return tuple(ratio_at(self.weighing, [drawn], a, sensor, rng) for a in amplitudes)

    def ratio_draws(self, amplitudes: Array, u: Array, sensor: float) -> Array:
        """The same as draws, (n, m); nan at amplitudes that no motion has."""
        drawn, rng = Drawn.of(self.result, u), np.random.default_rng(1)
        found = [ratios_drawn(self.weighing, drawn, float(a), sensor, rng) for a in amplitudes]
        none = np.full(len(u), np.nan)
        return np.column_stack([none if one is None else one for one in found])

    def motions(self, u: Array, t: Array | None = None, quantity: str | None = None) -> Array:
        """Motions of draws (n, K) at times t (m,) in s within the knots, (n, m); nan where one escapes. By default at
        the samples that are fitted, in their quantity."""
        result, solver = self.result, self.result.solver
        if t is not None:
            solver = solver.at(np.asarray(t, float), quantity or solver.quantity)
        motions, none = (
            Motions(solver, result.fit.parameters, result.fit.active),
            np.full(solver.t.size, np.nan),
        )
        assert solver.kernel  # compiled before several threads ask for it
        found = at_once(motions.at, u)
        return np.stack([none if y is None else y for y in found]) if len(u) else np.empty((0, none.size))

    def carried_on(self, half: Single, z: Array, seed: int) -> Ahead:
        """What draws of the scores on the first half, (n, d), say of the second: there the deviations are what their
        prior makes of the first half's. Raises Refusal where no draw goes on."""
        motions = self.motions(half.with_deviations(z, seed))
        motions = motions[np.all(np.isfinite(motions), axis=1)]
        if not len(motions):
            raise Refusal("no motion that fits the first half goes on through the second")
        weighing, count = self.weighing, half.weighing.data.y.size
        second, noise = motions[:, count:], weighing.variance / weighing.inflation  # of one sample
        return Ahead(weighing.data.y[count:] - second.mean(axis=0), np.sqrt(second.var(axis=0) + noise))

    @property
    def best(self) -> Array:
        """u of the best motion with its deviations, (1, K)."""
        about = self.result.about
        assert about is not None
        return about.u[None]

    def log_likelihoods(self, motions: Array) -> Array:
        """Log density of each sample of motions (..., n), in nats: with κ > 1 a sample counts for 1/κ of one, and its
        noise's variance is κ times larger, so that their sum is the log likelihood that was weighed."""
        weighing = self.weighing
        variance, kappa = weighing.variance, weighing.inflation
        left = np.asarray(weighing.data.y) - motions
        return -0.5 * left**2 / variance - 0.5 * np.log(2 * np.pi * variance) / kappa

    def prior_draws(self, count: int, seed: int) -> Array:
        """u under the prior, (n, K)."""
        result, rng = self.result, np.random.default_rng([seed, 1])
        parameters = result.fit.parameters
        grid = grid_of(self.knots.size, absorbed=parameters.absorbs)
        z = parameters.prior_draws(count, rng)
        mass = np.exp(grid.log_prior - grid.log_prior.max())
        combos = rng.choice(mass.size, count, p=mass / mass.sum())
        smooth = np.einsum(
            "nij,nj->ni", grid.factors[combos], rng.standard_normal((count, 2 * self.knots.size))
        )
        return np.concatenate([z, smooth], axis=1)


def single(
    data: Data,
    damping: Sequence[str],
    restoring: str,
    *,
    known: Mapping[str, float],
    priors: Mapping[str, Prior],
    reference: Reference,
    noises: Sequence[str] = AUTOMATIC,
) -> Single:
    """Fit and weigh one candidate. The noise, and friction's width, are those under the sum of all terms, as where
    candidates are compared: so evidence of two dampings under one law is of one noise.

    Raises Refusal where no motion stays in phase with the record, or none can be followed with deviations.
    """
    asked = Candidate(tuple(damping), restoring)
    whole = Candidate((*PAPER_TERMS, *(t for t in damping if t not in PAPER_TERMS)), restoring)
    with threadpool_limits(1, "blas"):
        weighing = weigh_all(
            data,
            dict.fromkeys([whole, asked]),
            known=known,
            priors=priors,
            reference=reference,
            noises=noises,
        )
    result = next((r for r in weighing.results if set(r.candidate.damping) == set(damping)), None)
    if result is None:
        raise Refusal(weighing.refused.get(asked, ESCAPED))
    return again(data, result.candidate, found_of(weighing, result))


def found_of(weighing: Weighing, result: Result) -> Found:
    """Where the search for one of the candidates that were weighed ended. Raises Refusal where none with deviations
    did."""
    if result.about is None:
        raise Refusal(ESCAPED)
    parameters, solver = result.fit.parameters, result.solver
    return Found(
        terms=solver.terms,
        reference=weighing.reference,
        priors=parameters.priors,
        known=parameters.known,
        z=result.fit.z,
        u=result.about.u,
        variance=weighing.variance,
        inflation=weighing.inflation,
        exact_variance=result.exact_variance,
        epsilon=solver.epsilon,
        frictions=weighing.frictions,
        averaged=weighing.data.averaged is not None,
        noise=weighing.noise.fitted,
        working=None if weighing.data.readings is None else weighing.data.y,
    )


def under(one: Single, priors: Mapping[str, Prior]) -> Single:
    """A candidate about the same motion under other priors of what it infers. Raises Refusal where it cannot be
    followed there."""
    parameters, found = one.result.fit.parameters, one.found
    other, d = replace(parameters, priors=priors), found.z.size
    z, start = (other.scores(parameters.named(scores)) for scores in (found.z, found.u[:d]))
    moved = replace(found, priors=priors, z=z, u=np.concatenate([start, found.u[d:]]))
    return again(one.weighing.data, one.result.candidate, moved)


def first_half(one: Single) -> Single:
    """A candidate on the first half of its record, with the knots, the noise and the motion of the whole, so that its
    evidence is a factor of the whole's. Raises Refusal where the record is not taken as samples, or has too few."""
    data, knots = one.weighing.data, one.result.solver.knots
    if data.averaged is not None:
        raise Refusal("not applicable: a record that is taken as amplitudes and phases is not cut in halves")
    count, inferred = data.t.size // 2, one.found.u.size
    if count <= inferred:
        raise Refusal(f"half the record has {count} samples for {inferred} parameters and deviations")
    half = data.first(count)
    return again(half, one.result.candidate, one.found, knots)


def again(data: Data, candidate: Candidate, found: Found, knots: np.ndarray | None = None) -> Single:
    """What a search found, put together without it. knots: in s, where they are not the record's own. Raises Refusal
    where it was on another record."""
    knots = knots_of(data.end, data.cycles) if knots is None else knots
    if found.working is not None:
        data = replace(data, y=found.working[: data.y.size], readings=data.recorded)
    solver = data.solver(found.terms, candidate.restoring, found.epsilon, knots)
    parameters = Parameters(solver.names, found.priors, found.known)
    active, p = active_of(candidate, solver), parameters.values(found.z)
    if isinstance(solver, AveragedSolver):
        z, g, h = np.split(found.u, [found.z.size, found.z.size + knots.size])
        solver = solver.corrected(parameters.values(z), active, np.expm1(g), h) or solver
    motion = solver.solve(p, active, tangents=NONE)
    moved = solver.solve(p, active, tangents=PARAMETERS, tolerance=SEARCHED)
    if motion is None or moved is None:
        raise Refusal(ESCAPED)
    tangents = parameters.by_scores(moved.tangents, found.z)
    best = Fit(parameters, active, found.z, data.y - motion.y, tangents, motion)
    about = linearised(candidate, solver, data, best, found.u)
    if about is None:
        raise Refusal(ESCAPED)
    variances, samples = (found.exact_variance, found.variance), data.y.size / found.inflation
    result = Result.of(candidate, solver, best, about, variances, samples)
    weighing = Weighing(
        data,
        found.reference,
        found.epsilon,
        found.frictions,
        {candidate.restoring: solver},
        (result,),
        found.variance,
        found.inflation,
        noise=SampleNoise(found.noise),
    )
    return Single(weighing, result, found)


def put_together(signal: Signal, restoring: str, found: Found) -> Single:
    """The candidate on its record, without a search. Raises Refusal where it was found on another record."""
    damping = tuple(t for t in found.terms if TERMS.get(t).parameter in found.priors)
    return again(prepared(signal, found.averaged), Candidate(damping, restoring), found)
