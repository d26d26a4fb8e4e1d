"""Compare damping models on several records of one specimen, which have one set of damping coefficients in common."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from itertools import product

import numpy as np

from bayesdamp.inference.deviation.draws import orbits_of, unit_works
from bayesdamp.inference.deviation.linear import LEAST_KNOTS, grid_of
from bayesdamp.inference.deviation.model_comparison import CandidateResult
from bayesdamp.inference.deviation.repeats import RecordLikelihood, Repeats, join_runs, solve
from bayesdamp.inference.model.target import damping_priors
from bayesdamp.numerics.weights import normalise, quantiles
from bayesdamp.physics.damping import TERMS
from bayesdamp.priors import Prior, odds
from bayesdamp.types import Reference

DERIVATIVE_STEP = 1e-4
"""Step of numerical derivatives by a parameter that a damping term has besides its coefficient, such as an exponent
(conventional). In `ratio_likelihood` the step is this times the parameter's absolute value (at least 1e-3); in
`_converted` it is in the parameter's unit."""
NO_EVIDENCE = -60.0
"""Smallest log evidence, in nats relative to the best candidate, that a candidate (a sum of damping terms under a
restoring law) can have on one record (conventional). It replaces smaller values, and is used for a candidate that was
not evaluated on this record."""
NATS_BEHIND = 25.0
"""A candidate (a sum of damping terms under a restoring law) is not fitted jointly to all records if its largest
possible evidence is more than this many nats below the best joint evidence so far (conventional). The largest possible
evidence is the product of its maximum likelihoods on the single records. Both are multiplied by the prior odds."""
Model = tuple[str, str]
"""Names of a damping sum (its terms joined by +) and of a restoring law."""


@dataclass(frozen=True)
class RatioLikelihood(RecordLikelihood):
    """The likelihood of a candidate's k damping parameters on one record, and the damping ratio as a function of these.

    The parameters are the coefficients of the damping terms, and own parameters of terms, such as exponents.

    Attributes
    ----------
    per_unit : ndarray, shape (a, k)
        Equivalent damping ratio per unit of each coefficient, at the a amplitudes of the record's damping curve, with
        own parameters at the posterior mode. 0 for own parameters; nan for an amplitude that no orbit has.
    growth : ndarray, shape (a, k)
        Derivative of the log damping ratio by each own parameter at the mode; 0 for coefficients.
    """

    per_unit: np.ndarray
    growth: np.ndarray

    def log_ratio(self, amplitude: float, amplitudes: np.ndarray, draws: np.ndarray) -> np.ndarray:
        """Return the natural log of the damping ratio at one amplitude for each of n draws of the parameters, (n,).

        draws: the damping parameters, (n, k). amplitude: in rad or m. amplitudes: those of the record's damping curve,
        (a,), in rad or m. At each of them the ratio is the sum of the coefficients times `per_unit`; own parameters,
        such as an exponent, change its logarithm linearly with their distance from the mode (`growth`). The log ratio
        at `amplitude` is on a straight line, against the log amplitude, through the values at the two nearest
        `amplitudes` that have an orbit (with only one, it is the value there).
        """
        good = np.flatnonzero(np.all(np.isfinite(self.per_unit), axis=1))
        away = np.log(amplitudes[good] / amplitude)
        near = np.argsort(np.abs(away))[:2]
        rows, away = good[near], away[near]
        ratios = (draws @ self.per_unit[rows].T) * np.exp((draws - self.mode) @ self.growth[rows].T)
        logs = np.log(np.maximum(ratios, 1e-300))
        if near.size == 1:
            return logs[:, 0]
        return (logs[:, 0] * away[1] - logs[:, 1] * away[0]) / (away[1] - away[0])


def ratio_likelihood(result: CandidateResult, amplitudes: np.ndarray) -> RatioLikelihood | None:
    """Return the likelihood of a candidate's damping parameters on one record, with its damping ratio per unit of each.

    amplitudes: those of the record's damping curve, in rad or m, (a,). Where no orbit has an amplitude, the row of
    `per_unit` is nan. The log likelihood is absolute: with the prior it gives the candidate's log evidence in nats.
    Return None if no damping parameter is inferred, or if no amplitude has an orbit.
    """
    posterior, parameters, solver = result.posterior, result.fit.parameters, result.solver
    if posterior.damping_likelihood is None:
        return None
    names = parameters.damping_names
    coefficients = [TERMS.get(t).parameter for t in result.candidate.damping]
    priors, z = {n: parameters.priors[n] for n in names}, result.z[parameters.damping]
    run = RecordLikelihood.of_scores(priors, coefficients, z, posterior.damping_likelihood())
    run = run.plus_nats(result.log_evidence - posterior.log_evidence)
    # Rows of `further`: the terms' own parameters at the mode, then one row with a step in each of them.
    own = [i for i, n in enumerate(solver.further) if n in names]
    steps = DERIVATIVE_STEP * np.maximum(np.abs(result.further[0, own]), 1e-3)
    further = np.repeat(result.further, 1 + len(own), axis=0)
    further[np.arange(1, 1 + len(own)), own] += steps
    columns = [names.index(n) for n in coefficients]
    own_columns = [names.index(solver.further[i]) for i in own]
    per_unit, growth = np.zeros((amplitudes.size, len(names))), np.zeros((amplitudes.size, len(names)))
    for row, orbit in enumerate(orbits_of(result, amplitudes.tolist())):
        if orbit is None:
            per_unit[row] = np.nan
            continue
        each = unit_works(orbit, solver, further, result.fit.active) / (4 * np.pi * orbit.energy)
        per_unit[row, columns] = each[0, [solver.names.index(n) for n in coefficients]]
        whole = each @ result.values[: len(solver.terms)]
        if whole[0] > 0:
            growth[row, own_columns] = np.log(whole[1:] / whole[0]) / steps
    if not np.isfinite(per_unit).all(axis=1).any():
        return None
    return RatioLikelihood(**vars(run), per_unit=per_unit, growth=growth)


@dataclass(frozen=True)
class RunComparison:
    """The evidence of every sum of damping terms under every restoring law on one record.

    A candidate is a sum of damping terms under a restoring law. A rival is a sum of damping terms with a form of
    damping that the compared sums do not contain. By default the compared sums are those of viscous, Coulomb and
    quadratic damping.

    Attributes
    ----------
    log_evidence : mapping of Model to float
        Log evidence of each candidate that was evaluated, in nats relative to the best candidate. Rivals are not
        included.
    others : mapping of str to str
        The rivals by name. The value is the name of the compared sum to which the rival reduces in a limit of its
        parameters, as Stribeck friction reduces to Coulomb friction; "" if there is none.
    runs : mapping of Model to RatioLikelihood
        Likelihood of the damping parameters of each candidate in `log_evidence` and each probable rival, relative to
        the evidence of the best candidate.
    reference : Reference
        Amplitude and frequency with which the record's default priors scale.
    amplitudes : ndarray, shape (a,)
        Falling amplitudes, in rad or m, to which the damping ratios in `runs` belong.
    """

    log_evidence: Mapping[Model, float]
    others: Mapping[str, str] = field(default_factory=dict)
    runs: Mapping[Model, RatioLikelihood] = field(default_factory=dict)
    reference: Reference = field(default_factory=lambda: Reference(1.0, 1.0))
    amplitudes: np.ndarray = field(default_factory=lambda: np.ones(1))

    def best(self, restoring: str) -> float:
        """Return the log evidence of the best sum of damping terms under a restoring law.

        It is in nats, relative to the best candidate. It is `NO_EVIDENCE` if no sum has been evaluated under this law.
        """
        return max([v for (_, law), v in self.log_evidence.items() if law == restoring], default=NO_EVIDENCE)

    def run_of(self, damping: str, restoring: str) -> RatioLikelihood | None:
        """Return the likelihood of a sum of damping terms under a restoring law; None if it was not computed.

        A rival (in `others`, a sum with a form of damping that is not compared) is evaluated under one law only. Under
        another law its likelihood is multiplied by a ratio of evidences: that of the best sum under the other law,
        divided by that of the best sum under the law of the evaluation.
        """
        for (name, law), run in self.runs.items():
            if name == damping and (law == restoring or name in self.others):
                return run.plus_nats(self.best(restoring) - self.best(law))
        return None

    def missing(self, damping: str, restoring: str, limit: str = "") -> float:
        """Return the log evidence of a sum of damping terms under a restoring law, or a substitute if there is none.

        It is in nats relative to the best candidate, and at least `NO_EVIDENCE`. It is the first of these that exists:

        - the log evidence of the sum itself;
        - the log evidence, under the same restoring law, of the sum `limit`, to which the sum reduces in a limit of its
          parameters (see `others`);
        - `NO_EVIDENCE`.
        """
        place = self.log_evidence.get((limit, restoring), NO_EVIDENCE)
        return max(self.log_evidence.get((damping, restoring), place), NO_EVIDENCE)


@dataclass(frozen=True)
class SpecimenComparison:
    """The Bayesian comparison of every model (a sum of damping terms and a restoring law) on all records of a specimen.

    Attributes
    ----------
    records : tuple of RunComparison
        The comparisons on the single records.
    log_evidence : mapping of Model to float
        Log evidence of each model on all records together, in nats relative to the sum of the log evidences of the best
        candidates of the single records. The coefficients, which the records have in common, are integrated out once. A
        record without a likelihood of the model counts with `RunComparison.missing`. For a model that is not fitted
        jointly (`NATS_BEHIND`, or no record has its likelihood), it is an estimate from the single records.
    probability : mapping of Model to float
        Posterior probability of each model, also of those with other forms of damping; the sum is 1.
    repeats : mapping of Model to Repeats
        Joint posterior of each probable model that has a likelihood on every record.
    runs : mapping of Model to tuple of RatioLikelihood
        For the models in `repeats`, the likelihood of each record, with coefficients converted to the specimen's
        reference (see `compare_runs`).
    """

    records: tuple[RunComparison, ...]
    log_evidence: Mapping[Model, float]
    probability: Mapping[Model, float]
    repeats: Mapping[Model, Repeats]
    runs: Mapping[Model, tuple[RatioLikelihood, ...]]

    def spread(self) -> tuple[float, float, float]:
        """Return the median and the lower and upper end of the 95 % interval of the spread between records.

        The spread is the sd of the log factors by which a record's coefficients differ from those of the specimen. The
        result is an average over the models in `repeats`, which are weighted by their probabilities. Raises ValueError
        if there are none.
        """
        every = np.concatenate([r.spreads for r in self.repeats.values()])
        sizes = [(r.spreads.size, self.probability[m]) for m, r in self.repeats.items()]
        weight = np.concatenate([np.full(n, p / n) for n, p in sizes])
        low, middle, high = quantiles(every, weight / weight.sum(), (0.025, 0.5, 0.975)).tolist()
        return middle, low, high

    def others(self) -> dict[str, float]:
        """Return the total probability of each rival over all restoring laws, by the name of its sum of damping terms.

        Rivals are sums of damping terms with a form of damping that is not in the compared sums.
        """
        names = sorted({name for r in self.records for name in r.others})
        return {n: sum(p for (damping, _), p in self.probability.items() if damping == n) for n in names}

    def ratios(
        self, amplitude: float, reaching: Sequence[int], count: int, seed: int = 0
    ) -> tuple[np.ndarray, np.ndarray]:
        """Draw the specimen's equivalent damping ratio at an amplitude (rad or m), and the spread between records.

        The ratio is the geometric mean over some of the records. The spread is the sd of the log factors by which a
        record's coefficients differ from those of the specimen. Models in `repeats` are drawn by their probabilities,
        and the draws are ordered by model.

        Parameters
        ----------
        amplitude : float
            The amplitude in rad or m.
        reaching : sequence of int
            Indices in `records` of the records to average, at least one; they should be those that reach the amplitude.
        count, seed : int
            Number of draws, and seed of their random stream.

        Returns
        -------
        ratios, spreads : ndarray, shape (count,)
            The damping ratio and the spread of each draw.
        """
        rng = np.random.default_rng(seed)
        shares = np.array([self.probability[m] for m in self.repeats])
        numbers = rng.multinomial(count, shares / shares.sum())
        values, spreads = [], []
        for (model, repeats), number in zip(self.repeats.items(), numbers, strict=True):
            if number:
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
    records: Sequence[RunComparison], given: Mapping[str, Prior] | None = None, *, seed: int = 0
) -> SpecimenComparison:
    """Compare every model (a sum of damping terms and a restoring law) on several records of one specimen.

    If a model's likelihood on one record is for exact laws only, its laws are taken as exact on all records.

    Parameters
    ----------
    records : sequence of RunComparison
        Comparisons on one or more single records.
    given : mapping of str to Prior, optional
        Priors of the specimen's damping parameters by name. The others have default priors, which scale with the
        geometric means of the records' reference amplitudes and frequencies (the specimen's reference).
    seed : int
        Seed of the random streams.
    """
    references = np.log([(r.reference.amplitude, r.reference.frequency) for r in records])
    reference = Reference(*np.exp(references.mean(axis=0)).tolist())
    limits = {name: limit for r in records for name, limit in r.others.items()}
    laws = {law for r in records for _, law in r.log_evidence}
    models = {m for r in records for m in r.log_evidence} | set(product(limits, laws))
    own = {m: sum(r.missing(*m, limits.get(m[0], "")) for r in records) for m in models}
    log_odds = {m: float(np.log(odds(m[0].split("+"), m[0] in limits))) for m in models}
    logs: dict[Model, float] = {}
    repeats: dict[Model, Repeats] = {}
    runs: dict[Model, tuple[RatioLikelihood, ...]] = {}
    best = -np.inf
    for model in sorted(models, key=lambda m: (-own[m], m)):
        defaults = damping_priors(model[0].split("+"), reference)
        priors = {n: (given or {}).get(n, p) for n, p in defaults.items()}
        pairs = [(r, r.run_of(*model)) for r in records]
        known = [_converted(run, model[0], tuple(priors), r.reference, reference) for r, run in pairs if run]
        rest = sum(r.missing(*model, limits.get(model[0], "")) for r, run in pairs if run is None)
        each = [run.likelihood for run in known]
        # The maxima of the log likelihoods over all parameters and grid points; coefficients may be negative there.
        maxima = (x.log + 0.5 * np.sum(x.slope * solve(x.information, x.slope), axis=1) for x in each)
        most = rest + float(np.sum([np.max(log) for log in maxima]))
        if not known or most + log_odds[model] < best - NATS_BEHIND:
            logs[model] = min(own[model], most)
            continue
        # If one record has only exact laws, use only the first grid point, g = h = 0, of all.
        exact = any(run.likelihood.log.size == 1 for run in known)
        log_sizes = np.zeros(1) if exact else grid_of(LEAST_KNOTS).log_prior
        posterior = join_runs(known, priors, log_sizes, seed=seed)
        logs[model] = posterior.log_evidence + rest
        best = max(best, logs[model] + log_odds[model])
        if len(known) == len(records):
            repeats[model], runs[model] = posterior, tuple(known)
    probability = normalise(np.array([v + log_odds[m] for m, v in logs.items()])).tolist()
    return SpecimenComparison(tuple(records), logs, dict(zip(logs, probability, strict=True)), repeats, runs)


def _converted(
    run: RatioLikelihood, damping: str, names: tuple[str, ...], own: Reference, common: Reference
) -> RatioLikelihood:
    """Convert a record's likelihood to parameters in the order of `names`, with the specimen's common reference.

    The force of some terms, such as a power of the velocity, contains a reference velocity or amplitude. With another
    reference the coefficient changes by a factor that depends on the exponent. This dependence is linearised about the
    record's mode. damping: names of the terms, joined by +. own, common: references (amplitude and frequency) of the
    record and of the specimen.
    """
    order = [run.names.index(n) for n in names]
    mode, jacobian = run.mode[order], np.eye(len(names))[order]
    per_unit, growth = run.per_unit[:, order], run.growth[:, order]
    for term in (TERMS.get(t) for t in damping.split("+")):
        if not {"reference_velocity", "reference_amplitude"} & set(term.given):
            continue

        def factor(further: Mapping[str, float], term=term) -> float:
            states = ({**r.scales(0.0), **further} for r in (own, common))
            before, after = (term.work(common.amplitude, common.frequency, state) for state in states)
            return before / after

        further = {p.name: float(mode[names.index(p.name)]) for p in term.inferred}
        place, at = names.index(term.parameter), factor(further)
        mode[place] *= at
        jacobian[place] *= at
        per_unit[:, place] /= at
        for name, value in further.items():
            slope = np.log(factor({**further, name: value + DERIVATIVE_STEP}) / at) / DERIVATIVE_STEP
            jacobian[place, run.names.index(name)] = mode[place] * slope
            growth[:, names.index(name)] -= slope
    inverse = np.linalg.inv(jacobian)
    likelihood = run.likelihood.transform(run.mode - inverse @ mode, inverse)
    return RatioLikelihood(names, run.coefficients[order], mode, likelihood, per_unit, growth)
