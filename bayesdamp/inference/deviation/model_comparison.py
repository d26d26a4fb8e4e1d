"""All candidates on one record, weighed under laws that hold exactly and approximately."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial

import numpy as np

from bayesdamp.inference.deviation.averaged import Averaging
from bayesdamp.inference.deviation.candidate import (
    START,
    Linearisation,
    MotionCandidate,
    exact_model,
    initial_values,
    linearise_at_mode,
    parameters_of,
    refit,
    search,
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
)
from bayesdamp.inference.deviation.sample_noise import (
    AUTOMATIC,
    AdaptedData,
    adapt,
    inflation,
    predictable_nats,
)
from bayesdamp.inference.deviation.tempered import Sampled
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
"""Widths ε of friction, as shares of the peak velocity, to try where none is given; log ε is uniform a priori."""
BETWEEN, CLEAR = 4, 1.0
"""Widths between these that are tried at most, and nats by which the likeliest must be ahead of a neighbour for it."""
LEAD = 3.0
"""Nats by which another ε must be ahead of the usual one."""
SHARPER = 0.25
"""Variance of the noise under its own model, relative to that of least squares, below which ε is chosen again with that
model: values that are rounded to coarse steps hide ε from least squares."""
Known = Mapping[str, float] | Callable[[str], Mapping[str, float]]
ROUNDS = 2
"""Number of rounds that correct the averaged solution with the full equation of motion and refit."""
REACH = 20.0
"""Nats by which the linear models of the sums of all terms expect a candidate to be behind the best, from which it is
not weighed (of 385 candidates on 22 simulated records 135 are left out, none of which is closer than 18 nats)."""
BEHIND = f"its evidence is expected to be more than {REACH:g} nats below the best"


@dataclass(frozen=True)
class CandidateResult:
    """One candidate weighed.

    Attributes
    ----------
    candidate : MotionCandidate
        A damping sum under a restoring law.
    data : Data
        The record.
    solver : Solver
        Of its motions.
    fit : LeastSquaresFit
        Under exact laws.
    variance, exact_variance : float
        Variance of the noise under the laws asked for, and under exact ones.
    exact_posterior : LinearPosterior
        Under exact laws: posterior and evidence of the linear model.
    about, weighed
        Under approximate laws: the linear model about the mode, and its posterior and evidence; None where laws hold
        exactly, or no motion with deviations was found.
    sampled : Sampled, optional
        Draws of the motions themselves.
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
    sampled: Sampled | None = None

    @property
    def posterior(self) -> LinearPosterior:
        """Posterior and evidence of the linear model under the laws asked for."""
        return self.exact_posterior if self.approximate_posterior is None else self.approximate_posterior

    @property
    def model(self) -> LinearModel:
        """The linear model under the laws asked for."""
        return exact_model(self.fit) if self.linearisation is None else self.linearisation.model

    def grid(self, coarse: bool = False) -> Grid:
        """Return the hyperparameters of the deviations under the laws asked for."""
        return NO_DEVIATIONS if self.linearisation is None else self.linearisation.grid(coarse)

    @property
    def log_evidence(self) -> float:
        """Under the laws asked for, in nats: of the motions where they were sampled, else of the linear model."""
        if self.sampled is not None and self.sampled.trusted:
            return self.sampled.log_evidence
        return self.posterior.log_evidence

    @property
    def deviations(self) -> tuple[np.ndarray, np.ndarray] | tuple[None, None]:
        """Relative deviations of damping and frequency at the knots, at the mode; None where laws hold exactly."""
        return (None, None) if self.linearisation is None else self.linearisation.deviations

    @property
    def motion(self) -> Motion:
        """The motion at the mode."""
        return self.fit.motion if self.linearisation is None else self.linearisation.motion

    @property
    def z(self) -> np.ndarray:
        """Scores at the mode, (d,)."""
        return self.fit.z if self.linearisation is None else self.linearisation.z

    @property
    def values(self) -> np.ndarray:
        """The solver's parameters at the mode, (k,)."""
        return self.fit.parameters.values(self.z)

    @property
    def law(self) -> np.ndarray:
        """Parameters of the restoring law at the mode, (r,)."""
        return self.values[self.solver.law_places]

    @property
    def further(self) -> np.ndarray:
        """The terms' own parameters at the mode, as a row, (1, e)."""
        return self.values[None, len(self.solver.terms) : self.solver.law_places.start]


@dataclass(frozen=True)
class ModelComparison:
    """Every candidate on one record.

    Attributes
    ----------
    data : Data
        The record.
    reference : Reference
        Of the priors.
    epsilon : float
        Width of friction, in rad/s or m/s.
    frictions : tuple of Friction
        Widths of friction and their probabilities; none where the width is known or there is no friction.
    solvers : mapping of str to Solver
        By restoring law.
    variance, inflation : float
        Variance of the noise that counts, and κ: how much larger it is than that of the residuals.
    noise : SampleNoise
        Of the samples.
    approximate : bool
        Whether laws may hold approximately.
    noise_known, epsilon_known : bool
        Whether the noise's sd and the width of friction were given.
    refused : mapping of MotionCandidate to str
        Why other candidates were not weighed.
    results : tuple of CandidateResult
        Of the candidates.
    forms : tuple of CandidateResult
        Of other forms of damping.
    exponents : tuple of float
        Quantiles of a power law's exponent; none where it was not asked for.
    averaging : Averaging, optional
        Of a record that is taken as amplitudes and phases: how far these are from the ODE's.
    """

    data: Data
    reference: Reference
    epsilon: float
    frictions: tuple[Friction, ...]
    solvers: Mapping[str, Solver]
    variance: float
    inflation: float
    noise: SampleNoise
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
        """Number of independent samples that the record stands for."""
        return self.data.y.size / self.inflation

    @property
    def best(self) -> CandidateResult:
        """The likeliest candidate's result."""
        return max(self.results, key=lambda r: r.log_evidence)

    def result(self, candidate: MotionCandidate) -> CandidateResult:
        """Return a candidate's result."""
        return next(r for r in (*self.results, *self.forms) if r.candidate == candidate)

    @property
    def terms(self) -> tuple[str, ...]:
        """The damping terms that candidates are made of."""
        return next(iter(self.solvers.values())).terms

    def compares(self, result: CandidateResult) -> bool:
        """Return whether a candidate is compared: under approximate laws only where it could be linearised."""
        every = (result, *self.results)
        return result.approximate_posterior is not None or all(r.approximate_posterior is None for r in every)

    def known_motion(self) -> dict[str, float]:
        """Return the known values of the likeliest candidate's start and of its restoring law's parameters."""
        solver, known = self.best.solver, self.best.fit.parameters.known
        return {n: v for n, v in known.items() if n in (*solver.names[solver.law_places], *START)}

    def exact_variance(self, fit: LeastSquaresFit) -> float:
        """Return the variance of the noise, in the record's unit squared, if a fit under exact laws were right."""
        if self.noise_known:
            return self.variance
        degrees = max(self.data.y.size - fit.z.size, 1)
        return self.data.least_variance + self.inflation * fit.squares / degrees

    def expected(self, candidate: MotionCandidate, whole: Linearisation) -> float:
        """Return the log evidence that a candidate is expected to have, in nats, without fitting it.

        It is that of the linear model of a sum of more terms, `whole`, without those that the candidate lacks; infinite
        if the candidate has a term which that sum lacks.
        """
        parameters, terms = whole.fit.parameters, [TERMS.get(t) for t in candidate.damping]
        names = {n for t in terms for n in (t.parameter, *(p.name for p in t.inferred))}
        if not {t.parameter for t in terms} <= set(parameters.free_names):
            return np.inf
        present = np.array([n in names for n in parameters.free_names])
        model = whole.model.only(present | ~parameters.damping)
        return linear_posterior(model, whole.grid(coarse=True), self.variance, self.samples).log_evidence

    def evaluate(self, candidate: MotionCandidate, solver: Solver, fit: LeastSquaresFit) -> CandidateResult:
        """Weigh a candidate from its fit to the record."""
        mode = linearise_at_mode(solver, self.data, fit, self.variance) if self.approximate else None
        return self.evaluate_about(candidate, solver, fit, mode and mode[0], self.exact_variance(fit))

    def evaluate_about(
        self,
        candidate: MotionCandidate,
        solver: Solver,
        fit: LeastSquaresFit,
        linearisation: Linearisation | None,
        exact_variance: float,
    ) -> CandidateResult:
        """Weigh a candidate from its fit, the linear model about its mode, and the noise if exact laws were right."""
        exact_posterior = linear_posterior(exact_model(fit), NO_DEVIATIONS, exact_variance, self.samples)
        variances = exact_variance, exact_variance
        if linearisation is None:
            return CandidateResult(candidate, self.data, solver, fit, *variances, exact_posterior)
        grid, variances = linearisation.grid(coarse=False), (self.variance, exact_variance)
        posterior = linear_posterior(linearisation.model, grid, self.variance, self.samples)
        return CandidateResult(
            candidate, self.data, solver, fit, *variances, exact_posterior, linearisation, posterior
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
    """Fit and weigh candidates; the fits under one law start from that of the sum of all terms.

    Parameters
    ----------
    data : Data
        The record.
    candidates : iterable of MotionCandidate
        Damping sums under restoring laws.
    known : mapping or callable, optional
        Values of parameters, `noise_sd` among them, or a function of a law's name that returns them.
    priors : mapping of str to Prior, optional
        By parameter; the others have default priors.
    reference : Reference, optional
        Of the default priors; by default the record's own amplitude and frequency.
    approximate : bool
        Whether deviations from the laws are weighed too.
    noises : sequence of str
        Noise models to choose from.

    Raises
    ------
    Refusal
        Where no motion follows the record, or no candidate can be compiled.
    """
    given, priors = list(candidates), dict(priors or {})
    refused: dict[MotionCandidate, str] = {}
    for c in given:
        if LAWS.ships(c.restoring) and all(map(TERMS.ships, c.damping)):
            continue
        try:  # a user's own term or law
            source_of(c.damping, (c.restoring,))
        except Refusal as refusal:
            refused[c] = str(refusal)
    asked = [c for c in given if c not in refused]
    if not asked:
        raise Refusal(next(iter(refused.values())))
    reference = reference or Reference(float(f"{data.amplitude:.2g}"), float(f"{data.frequency:.2g}"))
    fits = _CandidateFits(data, asked, reference, priors, known or {}, refused)
    at_once(fits.seek_whole, fits.laws)
    for _ in range(ROUNDS if data.averaged is not None else 0):
        fits.correct()
        fits.repeat()
    stated = fits.known_under(fits.laws[0])
    frictions = [] if "epsilon" in stated else fits.choose_friction()
    abouts = fits.about_modes()
    if not abouts:
        raise Refusal("no motion under any of the laws stays in phase with the record")
    # The noise is that of the sum of all terms under the law that leaves least.
    whole, law = fits.whole, min(abouts, key=lambda name: abouts[name][1])
    at, variance = abouts[law]
    adapting = partial(adapt, data=data, known=fits.known_under(law), priors=priors, approximate=approximate)
    adapted = adapting(noises, solver=fits.solvers[law], at=at)
    noise, noise_known = data.noise_model if adapted is None else adapted.noise, False
    if adapted is not None and noise.name != GAUSSIAN:
        if frictions and adapted.variance < SHARPER * variance:
            usual, adapting = fits.epsilon, partial(adapting, (noise.name,))
            frictions = fits.choose_friction(adapting)
            if fits.epsilon != usual:
                at = fits.about_modes()[law][0]
                adapted = adapting(solver=fits.solvers[law], at=at) or adapted
                noise = adapted.noise
        data, noise_known = adapted.data, True
        fits.data = data
        fits.repeat()
        abouts = fits.about_modes()
        at = abouts[law][0]
        kappa = inflation(data.t, at.left, data.frequency, at.u.size, adapted.variance)
        variance = kappa * adapted.variance
    elif "noise_sd" in stated and data.noise_model.name == GAUSSIAN:
        variance, kappa = data.least_variance + stated["noise_sd"] ** 2 / data.thinned, 1.0
        noise_known = True
    else:
        # Amplitudes and phases only have the noise near the oscillation. Where laws hold exactly and the residual
        # cannot be predicted, the noise is white, and κ, which a short record determines only to a few tens of per
        # cent, is 1.
        white = data.averaged is not None or (not approximate and predictable_nats(at.left) == 0.0)
        kappa = 1.0 if white else inflation(data.t, at.left, data.frequency, at.u.size)
        variance *= kappa
        if adapted is not None and adapted.variance > variance:
            variance, kappa = adapted.variance, kappa * adapted.variance / variance
    comparison = ModelComparison(
        data, reference, fits.epsilon, tuple(frictions), fits.solvers, variance, kappa, noise, approximate,
        noise_known, "epsilon" in stated,
    )  # fmt: skip
    followed = [c for c in asked if c.restoring in abouts]
    expected = {c: comparison.expected(c, abouts[c.restoring][0]) for c in followed}
    top = max((log for log in expected.values() if np.isfinite(log)), default=-np.inf)
    refused |= {c: BEHIND for c, log in expected.items() if log < top - REACH and c not in refused}

    def evaluate(c: MotionCandidate) -> CandidateResult | None:
        fit = fits.of(c)
        return None if fit is None else comparison.evaluate(c, fits.solvers[c.restoring], fit)

    results = at_once(evaluate, [c for c in followed if c not in refused])
    # In an order that does not depend on which thread was first.
    order = dict.fromkeys([*whole, *(MotionCandidate(fits.terms, law) for law in fits.laws), *given])
    return replace(
        comparison,
        results=tuple(r for r in results if r is not None),
        refused={c: refused[c] for c in order if c in refused},
    )


class _CandidateFits:
    """Fits of candidates to one record, under solvers with a common width of friction.

    Under each law, the sum of all terms is fitted first, and the other candidates start from its fit. Candidates that
    no motion follows are added to `refused`, with the reason.
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
        self.epsilon = self.known_under(self.laws[0]).get("epsilon", reference.friction_width)
        knots = knots_of(data.end, data.cycles)
        self.solvers = {law: data.solver(self.terms, law, self.epsilon, knots) for law in self.laws}
        self.scales = {law: self._scales(law) for law in self.laws}
        assert all(
            solver.kernel for solver in self.solvers.values()
        )  # compiled before several threads ask for it

    def known_under(self, law: str) -> Mapping[str, float]:
        """Return what is known of a law's parameters.

        Velocities and accelerations do not depend on where the law's zero is. It is put at 0, as the zero of terms that
        depend on the position.
        """
        stated, shift = self.known(law) if callable(self.known) else self.known, LAWS.get(law).shift
        if shift and self.data.quantity != "angle" and shift not in self.priors:
            return {shift: 0.0, **stated}
        return stated

    def _scales(self, law: str) -> dict[str, float]:
        """Return the reference values of the terms under a law; the equilibrium is that of a viscous fit."""
        data, rest, known = self.data, self.data.rest, self.known_under(law)
        if "rest" in self.solvers[law].further:
            c, viscous = MotionCandidate(("viscous",), law), replace(self.solvers[law], terms=("viscous",))
            parameters = parameters_of(c, viscous, data, self.reference, self.priors, known)
            fit = search(viscous, data, parameters, [initial_values(c, data, known)], windows=True)
            if fit is not None:
                rest = data.rest_under(law, fit.values[viscous.law_places])
        return self.reference.scales(rest)

    def seek_whole(self, law: str) -> None:
        """Fit the sum of all terms, after that of the terms without parameters of their own."""
        if self.plain and self.plain != self.terms:
            self._seek(MotionCandidate(self.plain, law), None)
        self._seek(MotionCandidate(self.terms, law), self.fits.get(MotionCandidate(self.plain, law)))

    @property
    def whole(self) -> list[MotionCandidate]:
        """The sum of most terms that is fitted, under each law."""
        every = [MotionCandidate(self.terms, law) for law in self.laws]
        return [c if c in self.fits else MotionCandidate(self.plain, c.restoring) for c in every]

    def of(self, c: MotionCandidate) -> LeastSquaresFit | None:
        """Return a candidate's fit."""
        if c not in self.fits:
            plain = self.fits.get(MotionCandidate(self.plain, c.restoring))
            self._seek(c, self.fits.get(MotionCandidate(self.terms, c.restoring), plain))
        return self.fits.get(c)

    def _seek(self, c: MotionCandidate, near: LeastSquaresFit | None) -> None:
        data, solver = self.data, self.solvers[c.restoring]
        known = {**self.scales[c.restoring], **self.known_under(c.restoring)}
        start = initial_values(c, data, known)
        parameters = parameters_of(c, solver, data, self.reference, self.priors, known)
        own_starts, fit = start_values(c, parameters), None
        if near is not None:
            coefficients = {TERMS.get(t).parameter for t in c.damping}
            begin = near.parameters.named(near.z) | {k: v for k, v in start.items() if k in coefficients}
            fit = search(solver, data, parameters, [begin | own for own in own_starts], windows=False)
        if fit is None:
            fit = search(solver, data, parameters, [start | own for own in own_starts], windows=True)
        if fit is None:
            self.refused[c] = "no motion under it stays in phase with the record"
        else:
            self.fits[c] = fit

    def correct(self) -> None:
        """Correct averaged motions with the ODE, under each law at the fit with the most terms."""
        most = {
            c.restoring: fit for c, fit in sorted(self.fits.items(), key=lambda item: len(item[0].damping))
        }

        def corrected(law: str) -> AveragedSolver | None:
            solver = self.solvers[law]
            assert isinstance(solver, AveragedSolver)
            return solver.corrected(most[law].values, most[law].active)

        new = zip(most, at_once(corrected, most), strict=True)
        self.solvers |= {law: solver for law, solver in new if solver is not None}

    def repeat(self) -> None:
        """Repeat the fits with changed solvers or data."""
        every = list(self.fits)
        fits = at_once(lambda c: refit(self.solvers[c.restoring], self.data, self.fits[c]), every)
        self.fits |= {c: fit for c, fit in zip(every, fits, strict=True) if fit is not None}

    def about_modes(self) -> dict[str, tuple[Linearisation, float]]:
        """Return the sums of most terms by law, about their modes, with the variance of what each leaves."""
        whole = [c for c in self.whole if c in self.fits]
        modes = at_once(
            lambda c: linearise_at_mode(self.solvers[c.restoring], self.data, self.fits[c], None), whole
        )
        return {c.restoring: at for c, at in zip(whole, modes, strict=True) if at is not None}

    def choose_friction(self, adapting: Callable[..., AdaptedData | None] | None = None) -> list[Friction]:
        """Return widths ε of friction and their probabilities, under the best law and all terms; none without friction.

        From then on, the fits have the likeliest width if it is clearly ahead of the usual one. `adapting` adapts the
        record to the noise model whose evidence weighs the widths, by default to Gaussian noise.
        """
        switching = [i for i, t in enumerate(self.terms) if TERMS.get(t).switches]
        if not self.fits:
            return []
        best = min(self.fits, key=lambda c: self.fits[c].squares)
        near, solver = self.fits[best], self.solvers[best.restoring]
        m, peak = len(self.terms), self.reference.peak_velocity

        def under(share: float) -> tuple[float, float, np.ndarray] | None:
            """Return ε, the log likelihood, and the terms' parameters."""
            own = replace(solver, epsilon=share * peak)
            fit = refit(own, self.data, near)
            if fit is None:
                return None
            log = -0.5 * self.data.y.size * np.log(fit.squares)
            if adapting is not None:
                mode = linearise_at_mode(own, self.data, fit, None)
                adapted = None if mode is None else adapting(solver=own, at=mode[0])
                if adapted is None:
                    return None
                log = adapted.noise.fitted.log_evidence
            return share * peak, log, fit.values[: solver.law_places.start]

        shares = SHARES if any(near.values[i] > 0 for i in switching) else ()
        tried = [width for width in at_once(under, shares) if width is not None]
        if not tried:
            return []
        for _ in range(BETWEEN if len(tried) > 2 else 0):
            between = _between(
                np.log([e / peak for e, _, _ in tried]), np.array([log for _, log, _ in tried])
            )
            new = None if between is None else under(float(np.exp(between)))
            if new is None:
                break
            tried.append(new)
        tried.sort(key=lambda width: -width[0])
        widths, logs = np.array([e for e, _, _ in tried]), np.array([log for _, log, _ in tried])
        # The length of log ε that each of them stands for; ends reach as far outwards.
        gaps = np.abs(np.diff(np.log(widths)))
        cells = 0.5 * (np.append(gaps, gaps[-1:]) + np.append(gaps[:1], gaps)) if gaps.size else np.ones(1)
        weights = np.exp(logs - logs.max()) * cells
        weights /= weights.sum()
        density = weights / cells
        first, usual = int(np.argmax(density)), int(np.argmin(np.abs(widths - self.epsilon)))
        if np.log(density[first] / max(density[usual], 1e-300)) > LEAD:
            self.epsilon = float(widths[first])
            self.solvers = {law: replace(s, epsilon=self.epsilon) for law, s in self.solvers.items()}
            self.repeat()
        each = zip(tried, weights.tolist(), strict=True)
        return [Friction(e, w, tuple(p[:m].tolist()), tuple(p[m:].tolist())) for (e, _, p), w in each]


def _between(at: np.ndarray, logs: np.ndarray) -> float | None:
    """Return the log of a width between those that were tried, at the top of a parabola through the likeliest three.

    None where the likeliest is at an end, or is not `CLEAR` nats ahead of a neighbour, so that a width between them
    would add nothing. Log widths `at` and log likelihoods, (k,) each.
    """
    order = np.argsort(at)
    at, logs = at[order], logs[order]
    i = int(np.argmax(logs))
    if i in (0, at.size - 1) or logs[i] - min(logs[i - 1], logs[i + 1]) < CLEAR:
        return None
    three = slice(i - 1, i + 2)
    bend, slope, _ = np.polyfit(at[three] - at[i], logs[three], 2)
    top = -0.5 * slope / bend
    sd = 1 / np.sqrt(-2 * bend)
    if abs(top) < sd:  # the likeliest is at the top already: its neighbours are too far away
        wide = at[i + 1] - at[i] > at[i] - at[i - 1]
        top = min(2 * sd, 0.5 * (at[i + 1] - at[i])) if wide else -min(2 * sd, 0.5 * (at[i] - at[i - 1]))
    return float(at[i] + np.clip(top, 0.75 * (at[i - 1] - at[i]), 0.75 * (at[i + 1] - at[i])))
