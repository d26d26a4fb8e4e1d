"""Compare dampings on several records of one specimen, which have one set of coefficients in common."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from bayesdamp.inference.deviation.draws import orbit_of, unit_works
from bayesdamp.inference.deviation.linear import LEAST_KNOTS, DampingLikelihood, grid_of
from bayesdamp.inference.deviation.model_comparison import CandidateResult
from bayesdamp.inference.deviation.repeats import RecordLikelihood, Repeats, join_runs
from bayesdamp.inference.model.target import damping_priors
from bayesdamp.numerics.weights import quantiles
from bayesdamp.physics.damping import TERMS
from bayesdamp.priors import Prior, odds
from bayesdamp.types import Reference

DERIVATIVE_STEP = 1e-4
"""Step of numerical derivatives by a parameter that a term has besides its coefficient, such as an exponent. For the
derivative of a damping ratio it is multiplied by the parameter's absolute value (at least 1e-3); for the conversion to
another reference amplitude it is in the parameter's unit."""
NO_EVIDENCE = -60.0
"""Smallest log evidence, in nats relative to the best candidate, that a candidate can have on one record: smaller ones
are replaced by it, and a candidate that could not be evaluated on this record gets it."""
NATS_BEHIND = 25.0
"""A candidate is not fitted jointly to all records if even the product of its maximum likelihoods on the single records
is this many nats behind the best."""
Model = tuple[str, str]
"""Names of a damping sum (its terms joined by +) and of a restoring law."""


@dataclass(frozen=True)
class RatioLikelihood(RecordLikelihood):
    """The likelihood of a candidate's damping on one record, and the damping ratio as a function of its parameters.

    Attributes
    ----------
    per_unit : ndarray, shape (a, k)
        Equivalent damping ratio per unit of each coefficient, at the a amplitudes of the record's damping curve, with
        the terms' own parameters (such as exponents) at the mode; 0 for own parameters, nan where no orbit has the
        amplitude.
    growth : ndarray, shape (a, k)
        Derivative of the log damping ratio by each own parameter at the mode; 0 for coefficients.
    """

    per_unit: np.ndarray
    growth: np.ndarray

    def log_ratio(self, amplitude: float, amplitudes: np.ndarray, draws: np.ndarray) -> np.ndarray:
        """Return the natural log of the damping ratio at one amplitude for n draws of the parameters, (n, k), as (n,).

        The ratio is the sum of the coefficients times `per_unit`. Other parameters, such as an exponent, change its
        logarithm linearly with their distance from the mode (`growth`). Between the `amplitudes` of the record's
        damping curve, (a,), the log ratio is interpolated linearly in the log amplitude; outside their range it is
        extrapolated likewise. All amplitudes are in rad or m.
        """
        good = np.all(np.isfinite(self.per_unit), axis=1)
        order = np.flatnonzero(good)[np.argsort(amplitudes[good])]
        logs = np.log(amplitudes[order])
        low = int(np.clip(np.searchsorted(logs, np.log(amplitude)) - 1, 0, max(order.size - 2, 0)))
        high = min(low + 1, order.size - 1)
        share = (np.log(amplitude) - logs[low]) / (logs[high] - logs[low]) if high > low else 0.0
        ends = []
        for row in order[[low, high]]:
            ratio = (draws @ self.per_unit[row]) * np.exp((draws - self.mode) @ self.growth[row])
            ends.append(np.log(np.maximum(ratio, 1e-300)))
        return (1 - share) * ends[0] + share * ends[1]

    def with_order(self, names: tuple[str, ...]) -> RatioLikelihood:
        """Return a copy whose parameters are those in `names`, in this order."""
        at, x = [self.names.index(n) for n in names], self.likelihood
        likelihood = DampingLikelihood(x.log, x.slope[:, at], x.information[:, at][:, :, at])
        per_unit, growth = self.per_unit[:, at], self.growth[:, at]
        return RatioLikelihood(names, self.coefficients[at], self.mode[at], likelihood, per_unit, growth)


def ratio_likelihood(result: CandidateResult, amplitudes: np.ndarray) -> RatioLikelihood | None:
    """Return the likelihood of a candidate's damping parameters on one record, and its damping ratio per unit of each.

    amplitudes: those of the record's damping curve, in rad or m, (a,); where no orbit has an amplitude, the row of
    `per_unit` is nan. The log likelihood is absolute: with the prior it gives the candidate's log evidence in nats.
    None if no damping parameter is inferred.
    """
    posterior, parameters, solver = result.posterior, result.fit.parameters, result.solver
    if posterior.damping_likelihood is None:
        return None
    names, active = parameters.damping_names, result.fit.active
    coefficients = [TERMS.get(t).parameter for t in result.candidate.damping]
    priors, z = {n: parameters.priors[n] for n in names}, result.z[parameters.damping]
    run = RecordLikelihood.of_scores(priors, coefficients, z, posterior.damping_likelihood())
    run = run.plus_nats(result.log_evidence - posterior.log_evidence)
    values, further = result.values[: len(solver.terms)], result.further
    per_unit, growth = np.zeros((amplitudes.size, len(names))), np.zeros((amplitudes.size, len(names)))
    place = {n: i for i, n in enumerate(names)}
    for row, amplitude in enumerate(amplitudes):
        orbit = orbit_of(result, float(amplitude))
        if orbit is None:
            per_unit[row] = np.nan
            continue
        cycle = 4 * np.pi * orbit.energy
        each = unit_works(orbit, solver, further, active)[0] / cycle
        for name, value in zip(solver.names, each):
            if name in place:
                per_unit[row, place[name]] = value
        whole = float(each @ values)
        for i, name in enumerate(solver.further):
            if name in place and whole > 0:
                step = DERIVATIVE_STEP * max(abs(further[0, i]), 1e-3)
                moved = further.copy()
                moved[0, i] += step
                changed = unit_works(orbit, solver, moved, active)[0] / cycle
                growth[row, place[name]] = float(np.log((changed @ values) / whole)) / step
    return RatioLikelihood(**vars(run), per_unit=per_unit, growth=growth)


@dataclass(frozen=True)
class OtherForm:
    """The evidence on one record of a rival: a damping sum with another form of damping than the compared sums.

    The compared sums are by default those of viscous, Coulomb and quadratic damping.

    Attributes
    ----------
    damping : str
        Name of the rival's damping sum.
    restoring : str
        The one restoring law under which it was evaluated: that of the candidate with the largest evidence on this
        record.
    log_evidence : float
        Its log evidence minus that of the best compared sum, in nats.
    place : str
        Name of the compared sum to which the rival reduces in a limit of its parameters (Stribeck friction to Coulomb
        friction); "" if there is none.
    """

    damping: str
    restoring: str
    log_evidence: float
    place: str = ""


@dataclass(frozen=True)
class RunComparison:
    """The evidence of every damping sum under every restoring law on one record.

    Attributes
    ----------
    log_evidence : mapping of Model to float
        Log evidence of each candidate, in nats relative to the best candidate.
    others : tuple of OtherForm
        The rivals: damping sums with a form of damping that is not compared.
    runs : mapping of Model to RatioLikelihood
        Likelihood of the damping parameters of each probable candidate and rival, relative to the same best evidence.
    reference : Reference
        Amplitude and frequency with which the record's default priors scale.
    amplitudes : ndarray, shape (a,)
        Falling amplitudes, in rad or m, to which the damping ratios in `runs` belong.
    """

    log_evidence: Mapping[Model, float]
    others: tuple[OtherForm, ...] = ()
    runs: Mapping[Model, RatioLikelihood] = field(default_factory=dict)
    reference: Reference = field(default_factory=lambda: Reference(1.0, 1.0))
    amplitudes: np.ndarray = field(default_factory=lambda: np.ones(1))

    def best(self, restoring: str) -> float:
        """Return the log evidence of the best sum under a restoring law, in nats relative to the best candidate.

        `NO_EVIDENCE` if no sum has this law.
        """
        return max([v for (_, law), v in self.log_evidence.items() if law == restoring], default=NO_EVIDENCE)

    def run_of(self, damping: str, restoring: str) -> RatioLikelihood | None:
        """Return the likelihood of a damping sum under a restoring law; None if it was not computed on this record.

        A sum with another form of damping (in `others`) is evaluated under one law only. Under another law the same
        likelihood is used, times the evidence of that law's best sum divided by the evidence of the first law's best
        sum.
        """
        run = self.runs.get((damping, restoring))
        if run is not None:
            return run
        for form in self.others:
            run = self.runs.get((damping, form.restoring)) if form.damping == damping else None
            if run is not None:
                return run.plus_nats(self.best(restoring) - self.best(form.restoring))
        return None

    def missing(self, damping: str, restoring: str, limit: str = "") -> float:
        """Return the log evidence of a damping sum whose likelihood was not computed on this record.

        It is the sum's own log evidence if there is one; else that of the sum `limit`, to which it reduces (see
        `OtherForm.place`), under the same restoring law; else, or for a `limit` of "", `NO_EVIDENCE`. The result is in
        nats relative to the best candidate, at least `NO_EVIDENCE`.
        """
        own = self.log_evidence.get((damping, restoring))
        place = self.log_evidence.get((limit, restoring), NO_EVIDENCE)
        return max(place if own is None else own, NO_EVIDENCE)


@dataclass(frozen=True)
class SpecimenComparison:
    """The Bayesian comparison of every damping and restoring law on all records.

    Attributes
    ----------
    records : tuple of RunComparison
        The comparisons on the single records.
    log_evidence : mapping of Model to float
        Log evidence of each model on all records together, in nats relative to the sum of the best on each; the
        coefficients, which the records have in common, are integrated out once. For a model that is not fitted jointly
        (`NATS_BEHIND`), an estimate from the single records.
    probability : mapping of Model to float
        Posterior probability of each damping, other forms of damping included, and law; the sum is 1.
    repeats : mapping of Model to Repeats
        Joint posterior of each probable damping and law that has a likelihood on every record.
    runs : mapping of Model to tuple of RatioLikelihood
        The likelihood of each record, with coefficients converted to the specimen's reference (`common_reference`), for
        the models in `repeats`.
    """

    records: tuple[RunComparison, ...]
    log_evidence: Mapping[Model, float]
    probability: Mapping[Model, float]
    repeats: Mapping[Model, Repeats]
    runs: Mapping[Model, tuple[RatioLikelihood, ...]]

    def spread(self) -> tuple[float, float, float]:
        """Return the median and the ends of the 95 % interval of the spread between records, over `repeats`' models.

        Models are weighted by their probabilities. The spread is the sd of the log factors by which a record's
        coefficients differ from those of the specimen.
        """
        every = np.concatenate([r.spreads for r in self.repeats.values()])
        sizes = [(r.spreads.size, self.probability[m]) for m, r in self.repeats.items()]
        weight = np.concatenate([np.full(n, p / n) for n, p in sizes])
        low, middle, high = quantiles(every, weight / weight.sum(), (0.025, 0.5, 0.975)).tolist()
        return middle, low, high

    def others(self) -> dict[str, float]:
        """Return the total probability of each rival over all restoring laws, by the name of its damping sum.

        Rivals are damping sums with a form of damping that is not compared.
        """
        sums = dict.fromkeys(sorted({form.damping for r in self.records for form in r.others}), 0.0)
        for (damping, _), p in self.probability.items():
            if damping in sums:
                sums[damping] += p
        return sums

    def ratios(
        self, amplitude: float, reaching: Sequence[int], count: int, seed: int = 0
    ) -> tuple[np.ndarray, np.ndarray]:
        """Draw the specimen's equivalent damping ratio at an amplitude (rad or m), (count,), over models in `repeats`.

        The ratio is the geometric mean over the records with the indices `reaching` in `records`, which should be those
        that reach the amplitude. Return also the spread between records (sd of log coefficients) of each draw,
        (count,). Models are drawn by their probabilities, and the draws are ordered by model.
        """
        rng = np.random.default_rng(seed)
        models = [m for m in self.probability if m in self.repeats]
        shares = np.array([self.probability[m] for m in models])
        numbers = rng.multinomial(count, shares / shares.sum())
        values, spreads = [], []
        for model, number in zip(models, numbers, strict=True):
            if number:
                repeats = self.repeats[model]
                rows = rng.choice(len(repeats.draws), number)
                # The geometric mean over the records, each with its own parameters of the restoring law.
                logs = [
                    self.runs[model][i].log_ratio(amplitude, self.records[i].amplitudes, repeats.draws[rows])
                    for i in reaching
                ]
                values.append(np.exp(np.mean(logs, axis=0)))
                spreads.append(repeats.spreads[rows])
        return np.concatenate(values), np.concatenate(spreads)


def compare_runs(
    records: Sequence[RunComparison],
    given: Mapping[str, Prior] | None = None,
    *,
    seed: int = 0,
) -> SpecimenComparison:
    """Compare every damping and restoring law on several records of one specimen.

    Parameters
    ----------
    records : sequence of RunComparison
        Comparisons on one or more single records.
    given : mapping of str to Prior, optional
        Priors by the name of the parameter, for the specimen's coefficients; the others have default priors at the
        geometric mean of the records' references (`common_reference`).
    seed : int
        Seed of the random streams.
    """
    reference = common_reference(records)
    places = {form.damping: form.place for r in records for form in r.others}
    laws = {law for r in records for _, law in r.log_evidence}
    models = {m for r in records for m in r.log_evidence} | {(d, law) for law in laws for d in places}
    own = {m: sum(r.missing(*m, places.get(m[0], "")) for r in records) for m in models}

    def prior(model: Model) -> float:
        return float(np.log(odds(model[0].split("+"), model[0] in places)))

    logs: dict[Model, float] = {}
    repeats: dict[Model, Repeats] = {}
    runs: dict[Model, tuple[RatioLikelihood, ...]] = {}
    best = -np.inf
    for model in sorted(models, key=lambda m: (-own[m], m)):
        pairs = [(r, r.run_of(*model)) for r in records]
        known = [_at_reference(run, model[0], r.reference, reference) for r, run in pairs if run is not None]
        rest = sum(r.missing(*model, places.get(model[0], "")) for r, run in pairs if run is None)
        most = rest + sum(map(_largest, known))
        if not known or most + prior(model) < best - NATS_BEHIND:
            logs[model] = min(own[model], most)
            continue
        priors = priors_of(model[0], reference, given)
        known = [run.with_order(tuple(priors)) for run in known]
        # All records need the same grid: if one has only exact laws, use only the first grid point, g = h = 0, of all.
        sizes, common = {run.likelihood.log.size for run in known}, known
        if len(sizes) > 1:
            parts = [(run.likelihood.log, run.likelihood.slope, run.likelihood.information) for run in known]
            exact = [DampingLikelihood(*(values[:1] for values in part)) for part in parts]
            common = [replace(run, likelihood=x) for run, x in zip(known, exact, strict=True)]
        log_sizes = np.zeros(1) if len(sizes) > 1 or sizes == {1} else grid_of(LEAST_KNOTS).log_prior
        posterior = join_runs(common, priors, log_sizes, seed=seed)
        logs[model] = posterior.log_evidence + rest
        best = max(best, logs[model] + prior(model))
        if len(known) == len(records):
            repeats[model], runs[model] = posterior, tuple(known)
    weights = {m: v + prior(m) for m, v in logs.items()}
    top = max(weights.values())
    total = sum(np.exp(v - top) for v in weights.values())
    probability = {m: float(np.exp(v - top) / total) for m, v in weights.items()}
    return SpecimenComparison(tuple(records), logs, probability, repeats, runs)


def common_reference(records: Sequence[RunComparison]) -> Reference:
    """Return the geometric means of the records' reference amplitudes and frequencies, as a `Reference`."""
    amplitude, frequency = (
        float(np.exp(np.mean(np.log([getattr(r.reference, n) for r in records]))))
        for n in ("amplitude", "frequency")
    )
    return Reference(amplitude, frequency)


def priors_of(
    damping: str, reference: Reference, given: Mapping[str, Prior] | None = None
) -> dict[str, Prior]:
    """Return the prior of each parameter of a damping sum: that in `given`, else the default one for the reference.

    damping: names of the terms, joined by +. reference: amplitude and frequency with which default priors scale. The
    result is by the name of the parameter.
    """
    priors = damping_priors(damping.split("+"), reference)
    return {n: (given or {}).get(n, p) for n, p in priors.items()}


def _largest(run: RecordLikelihood) -> float:
    """Return the maximum of a record's log likelihood over all parameters and grid points, in nats.

    A grid point is a combination of sizes and correlation lengths of the deviations from the laws. Coefficients may be
    negative at this maximum.
    """
    x = run.likelihood
    scale = np.sqrt(np.maximum(np.diagonal(x.information, axis1=1, axis2=2), 1e-300))
    part = x.information / (scale[:, :, None] * scale[:, None, :]) + 1e-10 * np.eye(scale.shape[1])
    aim = x.slope / scale
    gain = 0.5 * np.sum(aim * np.linalg.solve(part, aim[:, :, None])[:, :, 0], axis=1)
    return float(np.max(x.log + gain))


def _at_reference(run: RatioLikelihood, damping: str, own: Reference, common: Reference) -> RatioLikelihood:
    """Convert the coefficients of a record's likelihood from the record's own reference to the common one.

    The force of a term such as a power of the velocity contains a reference velocity. With another reference its
    coefficient changes by a factor that depends on the exponent; this dependence is linearised about the record's mode.
    Without such a term the likelihood is returned unchanged. damping: names of the terms, joined by +. own, common: the
    reference before and after.
    """
    names = run.names
    jacobian, mode = np.eye(len(names)), run.mode.copy()
    per_unit, growth = run.per_unit.copy(), run.growth.copy()
    for term in (TERMS.get(t) for t in damping.split("+")):
        if not {"reference_velocity", "reference_amplitude"} & set(term.given):
            continue
        place = names.index(term.parameter)
        further = [names.index(p.name) for p in term.inferred]

        def factor(values: np.ndarray, term=term, further=further) -> float:
            known = {names[i]: float(values[i]) for i in further}
            work = [
                term.work(common.amplitude, common.frequency, {**r.scales(0.0), **known})
                for r in (own, common)
            ]
            return work[0] / work[1]

        at = factor(run.mode)
        mode[place] *= at
        jacobian[place, place] = at
        per_unit[:, place] /= at
        for i in further:
            changed = run.mode.copy()
            changed[i] += DERIVATIVE_STEP
            slope = float(np.log(factor(changed) / at)) / DERIVATIVE_STEP
            jacobian[place, i] = mode[place] * slope
            growth[:, i] -= slope
    if np.array_equal(jacobian, np.eye(len(names))):
        return run
    inverse = np.linalg.inv(jacobian)
    likelihood = run.likelihood.transform(run.mode - inverse @ mode, inverse)
    return replace(run, mode=mode, likelihood=likelihood, per_unit=per_unit, growth=growth)
