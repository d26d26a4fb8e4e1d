"""Fit all candidates to one record, choose its noise model, and compute the evidence of each candidate.

A candidate is a sum of damping terms under a restoring law. Its evidence is the probability density of the record, with
all parameters integrated out.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from copy import copy
from dataclasses import dataclass, field, replace
from functools import cached_property, partial

import numpy as np

from bayesdamp.inference.deviation.averaged import Averaging
from bayesdamp.inference.deviation.candidate import (
    Linearisation,
    MotionCandidate,
    exact_model,
    initial_values,
    linearise_at_mode,
    parameters_of,
    refit,
    search,
    search_near,
    start_values,
)
from bayesdamp.inference.deviation.data import Data
from bayesdamp.inference.deviation.least_squares import LeastSquaresFit
from bayesdamp.inference.deviation.linear import (
    NO_DEVIATIONS,
    Grid,
    LinearModel,
    LinearPosterior,
    knots_of,
    linear_posterior,
    score_normals,
    with_priors,
)
from bayesdamp.inference.deviation.sample_noise import (
    AUTOMATIC,
    AdaptedData,
    adapt_to_noise,
    inflation,
    predictable_nats,
)
from bayesdamp.inference.deviation.tempered import TemperedDraws
from bayesdamp.inference.noise import GAUSSIAN, SampleNoise
from bayesdamp.machine import at_once
from bayesdamp.physics.damping import TERMS
from bayesdamp.physics.kernel import Motion, Solver
from bayesdamp.physics.kernel.averaged import AveragedSolver
from bayesdamp.physics.kernel.build import source_of
from bayesdamp.physics.restoring import LAWS
from bayesdamp.priors import Prior
from bayesdamp.types import Friction, Reference, Refusal

SHARES = (0.05, 0.02, 0.01, 0.005, 0.002, 0.0005, 0.0001)
"""Values of the width ε of dry friction that are tried if the user gives none and the best fit contains friction, as
fractions of the peak velocity (conventional). ε is the width of the velocity range in which the friction force changes
its sign. Its prior is uniform in log ε."""
BETWEEN, CLEAR = 4, 1.0
"""`BETWEEN`: largest number of widths ε of dry friction that are tried in addition to `SHARES`. `CLEAR`: such a width
is tried only if the best width has a log likelihood at least this many nats above that of one of its two neighbours
(conventional). ε is the width of the velocity range in which friction changes its sign."""
LEAD = 3.0
"""The width ε of dry friction is changed to the most probable width only if the log posterior density is more than this
many nats larger there than at the present width (conventional). ε is the width of the velocity range in which friction
changes its sign."""
SHARPER = 0.25
"""The width ε of dry friction is chosen again under the chosen noise model if the noise variance of this model is less
than this fraction of the variance from least squares (conventional). Least squares do not determine ε from values that
are rounded to coarse steps. ε is the width of the velocity range in which friction changes its sign."""
Known = Mapping[str, float] | Callable[[str], Mapping[str, float]]
"""Known values of parameters by name, or a function that returns them for the name of a restoring law."""
ROUNDS = 2
"""Number of rounds of corrections for a record of very many cycles, whose motions are computed by averaging over
cycles. Each round corrects the averaged motions with the full equation of motion and repeats the fits."""
REACH, CLOSE_REACH, TRUSTED = 20.0, 10.0, 1.0
"""A candidate (a sum of damping terms under a restoring law) is not fitted if its predicted log evidence is more than
`REACH` nats below the best prediction. The prediction is from the fit of the sum of all terms
(`ModelComparison.expected_evidences`). The limit is `CLOSE_REACH` if the predictions for the candidates within it are
right: if each differs by less than `TRUSTED` nats from the evidence after the fit, both relative to the best. Of 549
candidates between the two limits, on 100 simulated and 20 measured records, this left out 425, none of which was closer
than 9 nats."""
NEAR = 20.0
"""For a record of very many cycles, motions are computed by averaging over cycles. The motion of a candidate (a sum of
damping terms under a restoring law) is then corrected by the full equation of motion if the candidate's log evidence is
at most this many nats below the best (conventional)."""
FAR_BEHIND = f"its log evidence is expected to be more than {CLOSE_REACH:g} nats below the best"
"""Reason, stored in `ModelComparison.refused`, for a candidate that is not fitted because its predicted log evidence is
too small (see `REACH`)."""
NO_LARGEST = "the sum of all damping terms cannot be fitted or linearised under the same restoring law"
"""Reason, stored in `ModelComparison.refused`, for a candidate whose fit would start from such a sum."""


@dataclass(frozen=True)
class CandidateResult:
    """The fit, the posterior and the evidence of one candidate on one record.

    A candidate is a sum of damping terms under a restoring law. Deviations are time-dependent departures of the forces
    from their laws: g (log damping) and h (relative frequency). The mode is the most probable point.

    Attributes
    ----------
    candidate : MotionCandidate
        The candidate.
    data : Data
        The record.
    solver : Solver
        Solver of the candidate's motions.
    fit : LeastSquaresFit
        The fit under exact laws (without deviations g and h).
    variance, exact_variance : float
        Variance of the noise with which `posterior` and `exact_posterior` are computed, in the record's unit squared.
        They are equal if `linearisation` is None.
    exact_posterior : LinearPosterior
        The posterior of the linear model about the fit under exact laws.
    linearisation, approximate_posterior : optional
        The linearisation about the mode with deviations, and its posterior. Both are None if laws are assumed to be
        exact, or if the motion cannot be linearised.
    sampled : TemperedDraws, optional
        Draws for each of which the equation of motion is solved (`sampling.sampled_result`), also if they cannot be
        trusted (`TemperedDraws.doubt`); None if not sampled.
    """

    candidate: MotionCandidate
    data: Data
    solver: Solver
    fit: LeastSquaresFit
    variance: float
    exact_variance: float
    exact_posterior: LinearPosterior
    linearisation: Linearisation | None = None
    approximate_posterior: LinearPosterior | None = None
    sampled: TemperedDraws | None = None

    @property
    def posterior(self) -> LinearPosterior:
        """Return the posterior of the linear model about the mode (the most probable motion).

        It is `approximate_posterior`, which includes deviations from the laws, or `exact_posterior` if that is None.
        """
        return self.exact_posterior if self.approximate_posterior is None else self.approximate_posterior

    @property
    def model(self) -> LinearModel:
        """Return the linear model of the motion about the mode, from which `posterior` is computed."""
        return exact_model(self.fit) if self.linearisation is None else self.linearisation.model

    def grid(self, coarse: bool = False) -> Grid:
        """Return the grid of sizes (prior sds) and correlation lengths of the deviations behind `posterior`.

        The deviations from the laws are g (log damping) and h (relative frequency). `posterior` is a mixture over this
        grid. Without a `linearisation` the grid has only the point g = h = 0. coarse: whether to use only every other
        size, and only the shortest and the longest correlation length.
        """
        return NO_DEVIATIONS if self.linearisation is None else self.linearisation.grid(coarse)

    @property
    def log_evidence(self) -> float:
        """Return the log evidence in nats.

        If the draws in `sampled` can be trusted, it is computed from them, with the motion of each draw. Otherwise it
        is the log evidence of the linear model in `posterior`.
        """
        if self.sampled is not None and not self.sampled.doubt:
            return self.sampled.log_evidence
        return self.posterior.log_evidence

    @property
    def deviations(self) -> tuple[np.ndarray, np.ndarray] | tuple[None, None]:
        """Return the deviations from the laws at the posterior mode: exp g − 1 of damping, h of frequency, (k,) each.

        They are relative deviations at the k knots in time. Both are None if there is no `linearisation`, as under
        exact laws.
        """
        return (None, None) if self.linearisation is None else self.linearisation.deviations

    @property
    def motion(self) -> Motion:
        """Return the motion at the posterior mode, with deviations from the laws if there is a `linearisation`."""
        return self.fit.motion if self.linearisation is None else self.linearisation.motion

    @property
    def z(self) -> np.ndarray:
        """Return the inferred parameters at the posterior mode as standard normal scores, (d,).

        A score stands for a parameter and has the prior N(0, 1).
        """
        return self.fit.z if self.linearisation is None else self.linearisation.z

    @cached_property
    def values(self) -> np.ndarray:
        """Return the values of all k parameters of the solver at the posterior mode, in the order of `Solver.names`."""
        return self.fit.parameters.values(self.z)

    @property
    def law(self) -> np.ndarray:
        """Return the restoring parameters at the posterior mode, (r,), in the order of `RestoringLaw.parameters`."""
        return self.values[self.solver.law_places]

    @property
    def further(self) -> np.ndarray:
        """Return the damping terms' own parameters (such as exponents) and references at the posterior mode, (1, e).

        References are the fixed equilibrium, amplitude or velocity that a force may contain. The order is that of
        `Solver.further`.
        """
        return self.values[None, len(self.solver.terms) : self.solver.law_places.start]


@dataclass(frozen=True)
class ModelComparison:
    """The Bayesian comparison of all candidates (sums of damping terms under restoring laws) on one record.

    Attributes
    ----------
    data : Data
        The record.
    reference : Reference
        Amplitude and frequency that set the scales of default priors.
    epsilon : float
        Width ε of the velocity range in which dry friction changes its sign, in rad/s or m/s.
    frictions : tuple of Friction
        Tried values of ε and their probabilities; empty if ε is known or the best fit contains no dry friction.
    solvers : mapping of str to Solver
        For each restoring law, by name, the solver of the sum of all damping terms of the candidates.
    variance, inflation : float
        `variance` is the variance of the noise, in the record's unit squared. It contains the factor `inflation`, κ ≥
        1, for correlated residuals: their mean power near the oscillation relative to white noise (see
        `sample_noise.inflation`).
    noise : SampleNoise
        Noise model of the samples.
    priors : mapping of str to Prior
        Priors that the user gives, by name of the parameter; the other parameters have default priors.
    approximate : bool
        Whether the forces may deviate from their laws (deviations g of the log damping and h of the frequency); if
        False, laws are exact.
    noise_known : bool
        Whether `variance` is also used under exact laws, because the noise's sd is given or the record's samples were
        adapted to noise that is not Gaussian.
    epsilon_known : bool
        Whether the user has given ε.
    refused : mapping of MotionCandidate to str
        Candidates without a result, with the reason; also the sum of all terms if its fit fails, even if it is not a
        candidate.
    results : tuple of CandidateResult
        Results of the candidates that were evaluated.
    forms : tuple of CandidateResult
        Results of the rivals: sums of damping terms with a form of damping that is not in the compared sums.
    exponents : tuple of float
        Quantiles of the exponent p of a damping force c |v|^p, at the probabilities `slices.LEVELS`. Empty if they were
        not computed (see `slices.exponent_quantiles`).
    averaging : Averaging, optional
        Error of motions that are averaged over cycles; None unless the record is reduced to amplitudes and phases.
    """

    data: Data
    reference: Reference
    epsilon: float
    frictions: tuple[Friction, ...]
    solvers: Mapping[str, Solver]
    variance: float
    inflation: float
    noise: SampleNoise
    priors: Mapping[str, Prior] = field(default_factory=dict)
    approximate: bool = True
    noise_known: bool = False
    epsilon_known: bool = False
    refused: Mapping[MotionCandidate, str] = field(default_factory=dict)
    results: tuple[CandidateResult, ...] = ()
    forms: tuple[CandidateResult, ...] = ()
    exponents: tuple[float, ...] = ()
    averaging: Averaging | None = None

    @property
    def samples(self) -> float:
        """Return the effective number of independent values in the record.

        It is the number of values in `data.y` divided by `inflation`, by which correlated residuals increase the
        variance of the noise.
        """
        return self.data.y.size / self.inflation

    @property
    def best(self) -> CandidateResult:
        """Return the result with the largest evidence among `results`; those in `forms` (rivals) are not considered."""
        return max(self.results, key=lambda r: r.log_evidence)

    def result(self, candidate: MotionCandidate) -> CandidateResult:
        """Return the result of a candidate (a sum of damping terms under a restoring law).

        It is in `results` or `forms`. Raise StopIteration if it is in neither.
        """
        return next(r for r in (*self.results, *self.forms) if r.candidate == candidate)

    @property
    def terms(self) -> tuple[str, ...]:
        """Return the names of all damping terms of the candidates, in the solvers' order.

        Terms that occur only in the rivals (`forms`) are not included.
        """
        return next(iter(self.solvers.values())).terms

    def compares(self, result: CandidateResult) -> bool:
        """Return whether a result's evidence may be compared with that of the other results.

        This is so if the result includes deviations from the laws, or if neither it nor any of `results` includes them.
        """
        every = (result, *self.results)
        return result.approximate_posterior is not None or all(r.approximate_posterior is None for r in every)

    def exact_variance(self, fit: LeastSquaresFit) -> float:
        """Return the variance of the noise under exact laws, in the record's unit squared, from the residual of a fit.

        It is κ S / (n − d), plus the variance of the solver's error. S is the sum of squared residuals of the n values,
        d the number of inferred parameters (n − d is at least 1), and κ is `inflation`, the factor for correlated
        residuals. If `noise_known` is set, the result is `variance`.
        """
        if self.noise_known:
            return self.variance
        degrees = max(self.data.y.size - fit.z.size, 1)
        return self.data.least_variance + self.inflation * fit.squares / degrees

    def expected_evidences(
        self, candidates: Iterable[MotionCandidate], whole: Linearisation
    ) -> dict[MotionCandidate, float]:
        """Predict the log evidences, in nats, of candidates without fits.

        Candidates are sums of damping terms, here under one restoring law. whole: a larger sum under the same law,
        linearised about its mode. The predicted evidence is that of this linear model, with deviations from the laws,
        and with coefficients of 0 for all terms that the candidate does not have. It is infinite if the candidate has a
        term that `whole` does not have. Candidates with much smaller predictions than the best are not fitted.
        """
        parameters = whole.fit.parameters
        # The score of a coefficient of 0 may be infinite under the user's prior. The model is linear in coefficients:
        # `off` contains the score of 0 by linear extrapolation from the mode.
        coefficients = np.isin(parameters.free_names, [TERMS.get(t).parameter for t in TERMS.names()])
        off = whole.z - parameters.values(whole.z)[parameters.free] / parameters.rates(whole.z)
        off = np.where(coefficients, off, whole.z)
        normals = score_normals(whole.model, whole.grid(coarse=True), self.variance, self.samples)

        def expected(candidate: MotionCandidate) -> float:
            terms = [TERMS.get(t) for t in candidate.damping]
            names = {n for t in terms for n in (t.parameter, *(p.name for p in t.inferred))}
            if not {t.parameter for t in terms} <= set(parameters.free_names):
                return np.inf
            absent = parameters.damping & ~np.isin(parameters.free_names, list(names))
            masks = (mask[~absent] for mask in (parameters.positive, parameters.shared))
            return with_priors(normals.given(absent, off), *masks).log_evidence

        return {c: expected(c) for c in candidates}

    def evaluate(self, candidate: MotionCandidate, solver: Solver, fit: LeastSquaresFit) -> CandidateResult:
        """Linearise a candidate about its mode (most probable motion), and return its posterior and evidence.

        fit: the candidate's fit under exact laws, from which the search for the mode starts. If laws are assumed to be
        exact, or if the linearisation fails, the result has only the posterior under exact laws.
        """
        mode = linearise_at_mode(solver, self.data, fit, self.variance) if self.approximate else None
        return self.evaluate_about(candidate, solver, fit, mode, self.exact_variance(fit))

    def corrected(self, r: CandidateResult, near: float = NEAR) -> CandidateResult:
        """Return a result again, with its averaged motion corrected by the full equation of motion at its own mode.

        Averaged motions are used for a record that is reduced to amplitudes and phases of blocks of cycles. With the
        correction of another candidate, the right law may seem far behind. Return `r` itself if motions are not
        averaged, if its log evidence is more than `near` nats below the best, or if the correction or its fit fails.
        """
        if self.data.averaged is None or self.best.log_evidence - r.log_evidence > near:
            return r
        assert isinstance(r.solver, AveragedSolver)
        solver = r.solver.with_defect(r.values, r.fit.active, *r.deviations)
        fit = None if solver is None else refit(solver, self.data, r.fit)
        if solver is None or fit is None:
            return r
        return self.evaluate(r.candidate, solver, fit)

    def evaluate_about(
        self,
        candidate: MotionCandidate,
        solver: Solver,
        fit: LeastSquaresFit,
        linearisation: Linearisation | None,
        exact_variance: float,
    ) -> CandidateResult:
        """Compute posterior and evidence of a candidate from its linearisation about the mode (most probable motion).

        fit: the candidate's fit under exact laws. linearisation: that about the mode with deviations from the laws; if
        None, the result has only the posterior under exact laws. exact_variance: variance of the noise under exact
        laws, in the record's unit squared; with deviations it is `variance`.
        """
        exact = linear_posterior(exact_model(fit), NO_DEVIATIONS, exact_variance, self.samples)
        variance, posterior = exact_variance, None
        if linearisation is not None:
            variance, grid = self.variance, linearisation.grid(coarse=False)
            posterior = linear_posterior(linearisation.model, grid, variance, self.samples)
        return CandidateResult(
            candidate, self.data, solver, fit, variance, exact_variance, exact, linearisation, posterior
        )


def compare_candidates(
    data: Data,
    candidates: Iterable[MotionCandidate],
    *,
    known: Known | None = None,
    priors: Mapping[str, Prior] | None = None,
    reference: Reference | None = None,
    approximate: bool = True,
    noises: Sequence[str] = AUTOMATIC,
) -> ModelComparison:
    """Fit every candidate (a sum of damping terms under a restoring law) and compute its evidence.

    Under each restoring law the sum of all terms that occur in the candidates is fitted first; the fits of the other
    candidates start from it. Candidates with a much smaller predicted evidence are not fitted (`REACH`, `CLOSE_REACH`).

    Parameters
    ----------
    data : Data
        The record.
    candidates : iterable of MotionCandidate
        Sums of damping terms under restoring laws.
    known : mapping or callable, optional
        Values of parameters by name, or a function from the name of a restoring law to such a mapping. They may include
        `noise_sd` (sd of a sample's noise, in the record's unit) and `epsilon` (width ε of the velocity range in which
        dry friction changes its sign, in rad/s or m/s). A known value of a coefficient has no effect: it is inferred.
    priors : mapping of str to Prior, optional
        Priors by the name of the parameter; the others have default priors. Priors of parameters that are not inferred
        have no effect.
    reference : Reference, optional
        Amplitude and frequency with which default priors scale; by default the record's own, to two digits.
    approximate : bool
        Whether to allow deviations from the laws; if False, laws are exact.
    noises : sequence of str
        Names of the noise models from which one is chosen, the same for all candidates. They have no effect if `data`
        is reduced to amplitudes and phases, whose noise model is `data.noise_model`.

    Returns
    -------
    ModelComparison
        The results of the candidates, and the reasons for those without a result (`refused`). `forms`, `exponents` and
        `averaging` are not filled.

    Raises
    ------
    InputError
        If a name is unknown, or an inferred parameter has neither a given nor a default prior.
    Refusal
        Where no motion stays in phase with the record, no candidate can be compiled, or none of the noise models
        applies to the record.
    """
    given, priors = list(candidates), dict(priors or {})
    refused: dict[MotionCandidate, str] = {}
    for c in given:
        if LAWS.ships(c.restoring) and all(map(TERMS.ships, c.damping)):
            continue
        try:  # to compile a plug-in
            source_of(c.damping, (c.restoring,))
        except Refusal as refusal:
            refused[c] = str(refusal)
    asked = [c for c in given if c not in refused]
    if not asked:
        raise Refusal(next(iter(refused.values())))
    reference = reference or Reference(float(f"{data.amplitude:.2g}"), float(f"{data.frequency:.2g}"))
    fits = _CandidateFits(data, asked, reference, priors, known or {}, refused)
    at_once(fits.fit_fullest, fits.laws, data.slow)
    for _ in range(ROUNDS if data.averaged is not None else 0):
        fits = fits.refitted(solvers=fits.corrected_solvers())
    frictions: tuple[Friction, ...] = ()
    if "epsilon" not in fits.known_under(fits.laws[0]):
        frictions, epsilon = fits.choose_friction()
        fits = fits.with_width(epsilon)
    comparison, fits, modes = choose_noise(fits, frictions, noises, approximate)
    refused |= {c: NO_LARGEST for c in asked if c.restoring not in modes and c not in refused}
    expected: dict[MotionCandidate, float] = {}
    for law, mode in modes.items():
        expected |= comparison.expected_evidences([c for c in asked if c.restoring == law], mode)
    top = max((log for log in expected.values() if np.isfinite(log)), default=-np.inf)
    refused |= {c: FAR_BEHIND for c, log in expected.items() if log < top - REACH and c not in refused}

    def evaluate(c: MotionCandidate) -> CandidateResult | None:
        fit = fits.fit_of(c)
        return None if fit is None else comparison.evaluate(c, fits.solvers[c.restoring], fit)

    probable = [c for c in asked if c not in refused and not expected[c] < top - CLOSE_REACH]
    improbable = [c for c in asked if c not in refused and c not in probable]
    fitted = dict(zip(probable, at_once(evaluate, probable, data.slow), strict=True))
    logs = {c: r.log_evidence for c, r in fitted.items() if r is not None and np.isfinite(expected[c])}
    best = max(logs.values(), default=np.nan)
    if logs and all(abs(log - best - expected[c] + top) < TRUSTED for c, log in logs.items()):
        refused |= dict.fromkeys(improbable, FAR_BEHIND)
    else:
        fitted |= zip(improbable, at_once(evaluate, improbable, data.slow), strict=True)
    results = [fitted[c] for c in asked if c in fitted]
    if not any(results):
        what = "the equation of motion cannot be fitted with any of the damping models"
        raise Refusal(f"{what}; choose a part of the record, or compare other damping models")
    # The order must not depend on which thread was first.
    order = dict.fromkeys([*fits.fullest, *(MotionCandidate(fits.terms, law) for law in fits.laws), *given])
    return replace(
        comparison,
        results=tuple(r for r in results if r is not None),
        refused={c: refused[c] for c in order if c in refused},
    )


def choose_noise(
    fits: _CandidateFits, frictions: tuple[Friction, ...], noises: Sequence[str], approximate: bool
) -> tuple[ModelComparison, _CandidateFits, dict[str, Linearisation]]:
    """Choose the noise model and the variance of the noise, which are the same for all candidates.

    They are chosen for the residual of the sum of all damping terms, under the restoring law for which this residual
    has the smallest variance. If `noise_sd` (sd of a sample's noise) is known, it gives the variance of Gaussian noise.

    Parameters
    ----------
    fits : _CandidateFits
        Fits to the record under Gaussian noise.
    frictions : tuple of Friction
        Values of the width ε of dry friction and their probabilities. They and the fits are replaced if ε is chosen
        again under the noise model (`SHARPER`).
    noises : sequence of str
        Names of the models to choose from. Not used if the record is reduced to amplitudes and phases; its model is in
        `fits.data`.
    approximate : bool
        Whether deviations from the laws are allowed.

    Returns
    -------
    ModelComparison
        The comparison, still without results.
    _CandidateFits
        The fits, repeated if the record's values were adapted to a noise model that is not Gaussian.
    dict of str to Linearisation
        For each restoring law, by name: the candidate with the most terms, linearised about its mode (most probable
        motion). Laws for which this fails are left out.

    Raises
    ------
    Refusal
        If no motion stays in phase with the record, or if none of the noise models applies.
    """
    modes, data, stated = fits.modes(), fits.data, fits.known_under(fits.laws[0])
    if not modes:
        raise Refusal(
            "the equation of motion cannot be fitted: no solution stays in phase with the record; check the unit and "
            "the sampling rate, or choose a part of the record"
        )
    law = min(modes, key=lambda name: modes[name].variance(data))
    mode, variance, kappa, noise_known = modes[law], modes[law].variance(data), 1.0, True
    known = fits.known_under(law)
    adapting = partial(adapt_to_noise, data=data, known=known, priors=fits.priors, approximate=approximate)
    adapted = adapting(noises, solver=fits.solvers[law], at=mode)
    noise = data.noise_model if adapted is None else adapted.noise
    if adapted is not None and noise.name != GAUSSIAN:
        if frictions and adapted.variance < SHARPER * variance:
            adapting = partial(adapting, (noise.name,))
            frictions, epsilon = fits.choose_friction(adapting)
            if epsilon != fits.epsilon:
                fits = fits.with_width(epsilon)
                again = adapting(solver=fits.solvers[law], at=fits.modes().get(law, mode))
                if again is not None:
                    adapted, noise = again, replace(again.noise, weighed=noise.weighed)
        fits = fits.refitted(data=adapted.data)
        modes = fits.modes() or modes
        mode = modes.get(law, mode)
        kappa = inflation(data.t, mode.left, data.frequency, mode.u.size, adapted.variance)
        variance = kappa * adapted.variance
    elif "noise_sd" in stated and data.noise_model.name == GAUSSIAN:
        variance = data.least_variance + stated["noise_sd"] ** 2 / data.thinned
    else:
        noise_known = False
        # Amplitudes and phases contain only the noise near the oscillation. Under exact laws, a residual that no
        # autoregression predicts is white, so that κ = 1; a short record determines κ only to a few tens of per cent.
        if data.averaged is None and (approximate or predictable_nats(mode.left) > 0.0):
            kappa = inflation(data.t, mode.left, data.frequency, mode.u.size)
        variance *= kappa
        if adapted is not None and adapted.variance > variance:
            variance, kappa = adapted.variance, kappa * adapted.variance / variance
    comparison = ModelComparison(
        fits.data, fits.reference, fits.epsilon, frictions, fits.solvers, variance, kappa, noise, fits.priors,
        approximate, noise_known, "epsilon" in stated,
    )  # fmt: skip
    return comparison, fits, modes


class _CandidateFits:
    """Fits of candidates (sums of damping terms under restoring laws) to one record, with one width ε of dry friction.

    ε is the width of the velocity range in which friction changes its sign.

    `fits` contains the fits that have been made, by candidate. A candidate that cannot be fitted is added to `refused`
    with the reason. terms: names of all damping terms of the candidates. plain: names of the terms whose only parameter
    is the coefficient. laws: names of the restoring laws. solvers: by law, the solver of the sum of all terms. scales:
    by law, the fixed references (equilibrium, amplitude, peak velocity) that forces may contain.
    """

    def __init__(
        self,
        data: Data,
        candidates: Sequence[MotionCandidate],
        reference: Reference,
        priors: Mapping[str, Prior],
        known: Known,
        refused: dict[MotionCandidate, str],
    ) -> None:
        self.data, self.reference, self.priors = data, reference, priors
        self.known, self.refused = known, refused
        self.terms = tuple(dict.fromkeys(t for c in candidates for t in c.damping))
        self.plain = tuple(t for t in self.terms if not TERMS.get(t).inferred)
        self.laws = list(dict.fromkeys(c.restoring for c in candidates))
        self.fits: dict[MotionCandidate, LeastSquaresFit] = {}
        epsilon = self.known_under(self.laws[0]).get("epsilon", reference.friction_width)
        knots = knots_of(data.end, data.cycles)
        self.solvers = {law: data.solver(self.terms, law, epsilon, knots) for law in self.laws}
        self.scales = {law: self._scales(law) for law in self.laws}
        # Compile before several threads need the kernels.
        assert all(solver.kernel for solver in self.solvers.values())

    @property
    def epsilon(self) -> float:
        """Return the width ε of the velocity range in which dry friction changes its sign, in rad/s or m/s."""
        return self.solvers[self.laws[0]].epsilon

    def known_under(self, law: str) -> Mapping[str, float]:
        """Return the known values of parameters, by name, under a restoring law.

        A record of velocities or accelerations does not determine the position of the equilibrium. The parameter of
        this position is therefore fixed at 0 for such a record, unless it has a given value or prior.
        """
        stated, shift = self.known(law) if callable(self.known) else self.known, LAWS.get(law).shift
        if shift and self.data.quantity != "angle" and shift not in self.priors:
            return {shift: 0.0, **stated}
        return stated

    def _scales(self, law: str) -> dict[str, float]:
        """Return, by name, the fixed references in the damping forces: equilibrium, amplitude and peak velocity.

        If a term needs the equilibrium, it is computed from a fit with viscous damping under the restoring law.
        Otherwise, or if the fit fails, it is the record's midline.
        """
        data, rest, known = self.data, self.data.rest, self.known_under(law)
        if "rest" in self.solvers[law].further:
            c, viscous = MotionCandidate(("viscous",), law), replace(self.solvers[law], terms=("viscous",))
            parameters = parameters_of(c, viscous, data, self.reference, self.priors, known)
            fit = search(viscous, data, parameters, [initial_values(c, data, known)])
            if fit is not None:
                rest = data.rest_under(law, fit.values[viscous.law_places])
        return self.reference.scales(rest)

    def fit_fullest(self, law: str) -> None:
        """Fit the sum of all damping terms under a restoring law, and store the fit in `fits`.

        Some terms may have parameters besides their coefficient, such as an exponent. Then the sum of the other terms
        is fitted and stored first, and the fit of all terms starts from it.
        """
        if self.plain and self.plain != self.terms:
            self._fit(MotionCandidate(self.plain, law), None)
        self._fit(MotionCandidate(self.terms, law), self.fits.get(MotionCandidate(self.plain, law)))

    @property
    def fullest(self) -> list[MotionCandidate]:
        """Return, for each restoring law, the candidate with all damping terms.

        If it could not be fitted, it is replaced by the sum of the terms whose only parameter is the coefficient, which
        may have no fit either.
        """
        every = [MotionCandidate(self.terms, law) for law in self.laws]
        return [c if c in self.fits else MotionCandidate(self.plain, c.restoring) for c in every]

    def fit_of(self, c: MotionCandidate) -> LeastSquaresFit | None:
        """Return the fit of a candidate (a sum of damping terms under a restoring law); None if the fit fails.

        If it does not exist yet, it is computed, starting from the fit of the sum of all terms (or of `plain`, if this
        failed), and stored in `fits`.
        """
        if c not in self.fits:
            plain = self.fits.get(MotionCandidate(self.plain, c.restoring))
            self._fit(c, self.fits.get(MotionCandidate(self.terms, c.restoring), plain))
        return self.fits.get(c)

    def _fit(self, c: MotionCandidate, near: LeastSquaresFit | None) -> None:
        """Fit a candidate (a sum of damping terms under a restoring law), and store the fit in `fits`.

        The fit starts at `near`, the fit of another sum under the same law. If this fails, or if `near` is None, it
        starts at guesses: it then begins with the first cycles and goes on to longer and longer parts of the record. If
        both fail, the reason is stored in `refused`.
        """
        data, solver = self.data, self.solvers[c.restoring]
        known = {**self.scales[c.restoring], **self.known_under(c.restoring)}
        start = initial_values(c, data, known)
        parameters = parameters_of(c, solver, data, self.reference, self.priors, known)
        own_starts, fit = start_values(c, parameters), None
        if near is not None:
            fit = search_near(solver, data, parameters, near.parameters.named(near.z), own_starts)
        if fit is None:
            fit = search(solver, data, parameters, [start | own for own in own_starts])
        if fit is None:
            self.refused[c] = "no motion with this damping stays in phase with the record"
        else:
            self.fits[c] = fit

    def corrected_solvers(self) -> dict[str, Solver]:
        """Return, by restoring law, solvers whose averaged motions have a correction (`AveragedSolver.with_defect`).

        This is for a record that is reduced to amplitudes and phases, whose motions are computed by averaging over
        cycles. The correction is the motion under the full equation minus the averaged motion, both for the fit with
        the most damping terms. Laws for which it cannot be computed are left out.
        """
        by_size = sorted(self.fits.items(), key=lambda item: len(item[0].damping))
        most = {c.restoring: fit for c, fit in by_size}

        def corrected(law: str) -> AveragedSolver | None:
            solver = self.solvers[law]
            assert isinstance(solver, AveragedSolver)
            return solver.with_defect(most[law].values, most[law].active)

        new = zip(most, at_once(corrected, most), strict=True)
        return {law: solver for law, solver in new if solver is not None}

    def refitted(
        self, data: Data | None = None, solvers: Mapping[str, Solver] | None = None
    ) -> _CandidateFits:
        """Return a copy in which all fits are repeated, with other data or other solvers.

        data: the new data; None for the present ones. solvers: new solvers by restoring law; the other laws keep their
        solver. If a new fit fails, the earlier one is kept.
        """
        other = copy(self)
        other.data, other.solvers = data or self.data, {**self.solvers, **(solvers or {})}
        every = list(self.fits)

        def fit(c: MotionCandidate) -> LeastSquaresFit | None:
            return refit(other.solvers[c.restoring], other.data, self.fits[c])

        fits = at_once(fit, every, other.data.slow)
        other.fits = self.fits | {c: fit for c, fit in zip(every, fits, strict=True) if fit is not None}
        return other

    def with_width(self, epsilon: float) -> _CandidateFits:
        """Return a copy with all fits repeated for another width of dry friction; self if the width is the present one.

        epsilon: width of the velocity range in which friction changes its sign, in rad/s or m/s.
        """
        if epsilon == self.epsilon:
            return self
        fits = self.refitted(solvers={law: replace(s, epsilon=epsilon) for law, s in self.solvers.items()})
        return fits if self.data.averaged is None else fits.refitted(solvers=fits.corrected_solvers())

    def modes(self) -> dict[str, Linearisation]:
        """Linearise the candidate with the most damping terms (`fullest`) about its mode, for each restoring law.

        The mode is the most probable motion. Return the linearised candidates by the name of the law. Candidates that
        have no fit or cannot be linearised are left out.
        """
        whole = [c for c in self.fullest if c in self.fits]

        def mode(c: MotionCandidate) -> Linearisation | None:
            return linearise_at_mode(self.solvers[c.restoring], self.data, self.fits[c], None)

        modes = at_once(mode, whole, self.data.slow)
        return {c.restoring: at for c, at in zip(whole, modes, strict=True) if at is not None}

    def choose_friction(
        self, adapting: Callable[..., AdaptedData | None] | None = None
    ) -> tuple[tuple[Friction, ...], float]:
        """Compute the probabilities of values of the width ε of dry friction, and choose the ε to use.

        ε is the width of the velocity range in which friction changes its sign, in rad/s or m/s. The candidate whose
        fit has the smallest sum of squared residuals is fitted again with each ε in `SHARES`, and with up to `BETWEEN`
        more.

        Parameters
        ----------
        adapting : callable, optional
            Function with arguments `solver` and `at` (a linearisation), which returns the record adapted to a noise
            model, or None, which leaves out this ε. The evidence of the noise model then gives the probabilities; by
            default the noise is Gaussian.

        Returns
        -------
        frictions : tuple of Friction
            For each fitted ε, the largest first: ε, its posterior probability, and the fitted parameters of the damping
            terms. Empty if the best fit has no friction or no fit succeeds.
        epsilon : float
            The ε to use. It is the ε with the largest posterior density (per unit of ln ε) if its log density is more
            than `LEAD` nats above that of the fitted ε nearest to `self.epsilon`. Otherwise it is `self.epsilon`.
        """
        switching = [i for i, t in enumerate(self.terms) if TERMS.get(t).switches]
        if not self.fits:
            return (), self.epsilon
        best = min(self.fits, key=lambda c: self.fits[c].squares)
        near, solver = self.fits[best], self.solvers[best.restoring]
        m, peak = len(self.terms), self.reference.peak_velocity

        def under(share: float) -> tuple[float, float, LeastSquaresFit] | None:
            """Fit with one width ε; return ε (rad/s or m/s), its log likelihood in nats, and the fit; None on failure.

            share: ε as a fraction of the peak velocity. The log likelihood is that of white noise, up to a constant;
            with `adapting` it is the log evidence of the noise model.
            """
            own = replace(solver, epsilon=share * peak)
            if isinstance(own, AveragedSolver):  # its correction depends on ε
                own = own.with_defect(near.values, near.active) or own
            fit = refit(own, self.data, near)
            if fit is None:
                return None
            log = -0.5 * self.data.y.size * np.log(fit.squares)
            if adapting is not None:
                mode = linearise_at_mode(own, self.data, fit, None)
                adapted = None if mode is None else adapting(solver=own, at=mode)
                if adapted is None:
                    return None
                log = adapted.noise.fitted.log_evidence
            return share * peak, log, fit

        shares = SHARES if any(near.values[i] > 0 for i in switching) else ()
        tried = [width for width in at_once(under, shares, self.data.slow) if width is not None]
        if not tried:
            return (), self.epsilon
        for _ in range(BETWEEN if len(tried) > 2 else 0):
            logs = np.array([log for _, log, _ in tried])
            between = _between(np.log([e / peak for e, _, _ in tried]), logs)
            new = None if between is None else under(float(np.exp(between)))
            if new is None:
                break
            tried.append(new)
        tried.sort(key=lambda width: -width[0])
        widths, logs = np.array([e for e, _, _ in tried]), np.array([log for _, log, _ in tried])
        if adapting is None and self.data.averaged is None:
            # Correlated residuals contain fewer independent values. With the best width the residual has least misfit.
            fit = tried[int(np.argmax(logs))][2]
            logs /= inflation(self.data.t, fit.residual, self.data.frequency, fit.z.size)
        # Quadrature over log ε: each width has a cell that ends half way to its neighbours.
        gaps = np.abs(np.diff(np.log(widths)))
        cells = 0.5 * (np.append(gaps, gaps[-1:]) + np.append(gaps[:1], gaps)) if gaps.size else np.ones(1)
        weights = np.exp(logs - logs.max()) * cells
        weights /= weights.sum()
        density = weights / cells
        first, usual = int(np.argmax(density)), int(np.argmin(np.abs(widths - self.epsilon)))
        clear = np.log(density[first] / max(density[usual], 1e-300)) > LEAD
        frictions = tuple(
            Friction(e, w, *(tuple(v.tolist()) for v in np.split(fit.values[: solver.law_places.start], [m])))
            for (e, _, fit), w in zip(tried, weights.tolist(), strict=True)
        )
        return frictions, float(widths[first]) if clear else self.epsilon


def _between(at: np.ndarray, logs: np.ndarray) -> float | None:
    """Return the log of another width ε of dry friction to try: near the maximum of a parabola through three widths.

    The three are the best width and its two neighbours. If the maximum is within one sd of the best width, the result
    is between this width and the more distant neighbour instead. Return None if the best width is the first or the
    last, or if its log likelihood is not at least `CLEAR` nats above that of one of the neighbours. at, logs: log
    widths, and their log likelihoods in nats, (k,) each.
    """
    order = np.argsort(at)
    at, logs = at[order], logs[order]
    i = int(np.argmax(logs))
    if i in (0, at.size - 1) or logs[i] - min(logs[i - 1], logs[i + 1]) < CLEAR:
        return None
    three = slice(i - 1, i + 2)
    curvature, slope, _ = np.polyfit(at[three] - at[i], logs[three], 2)
    top = -0.5 * slope / curvature
    sd = 1 / np.sqrt(-2 * curvature)
    if abs(top) < sd:  # the best width is at the maximum already: try one towards its more distant neighbour
        wide = at[i + 1] - at[i] > at[i] - at[i - 1]
        top = min(2 * sd, 0.5 * (at[i + 1] - at[i])) if wide else -min(2 * sd, 0.5 * (at[i] - at[i - 1]))
    return float(at[i] + np.clip(top, 0.75 * (at[i - 1] - at[i]), 0.75 * (at[i + 1] - at[i])))
