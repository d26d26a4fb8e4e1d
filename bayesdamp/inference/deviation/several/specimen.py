"""Which damping a specimen has, from several runs: evidence that integrates over one set of coefficients once."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from bayesdamp.inference.curves.weighted import summarise
from bayesdamp.inference.deviation.gaussian.hyperparameters import LEAST_KNOTS, grid_of
from bayesdamp.inference.deviation.gaussian.linear import DampingLikelihood
from bayesdamp.inference.deviation.gaussian.repeats import Repeats, RunLikelihood, joined
from bayesdamp.inference.deviation.several.run_likelihood import DampingRun
from bayesdamp.inference.model.target import damping_priors
from bayesdamp.odds import odds
from bayesdamp.physics.damping import TERMS
from bayesdamp.priors import Prior
from bayesdamp.types import Reference

FAR = -60.0
"""Nats behind a record's best that stand for a candidate which was out of the question there."""
REACH = 25.0
"""Nats behind the best from which a candidate is not joined: its runs' largest likelihoods already tell."""
Model = tuple[str, str]
"""A damping sum and a restoring law."""


@dataclass(frozen=True)
class OtherForm:
    """A form of damping that is not compared, weighed on one record under its likeliest restoring law: log evidence
    relative to the best sum; the sum that it comes to in a limit, if there is one."""

    damping: str
    restoring: str
    log_evidence: float
    place: str = ""


@dataclass(frozen=True)
class WeighedRun:
    """What one run says of every damping.

    log_evidence: of each damping and law by itself, relative to the best; others: other forms of damping; runs: of
    those that count the likelihood of the damping, in nats relative to the same best; reference: of the run's priors;
    amplitudes: at which damping ratios per unit are known, falling, (a,).
    """

    log_evidence: Mapping[Model, float]
    others: tuple[OtherForm, ...] = ()
    runs: Mapping[Model, DampingRun] = field(default_factory=dict)
    reference: Reference = field(default_factory=lambda: Reference(1.0, 1.0))
    amplitudes: np.ndarray = field(default_factory=lambda: np.ones(1))

    def best(self, restoring: str) -> float:
        """Log evidence of the best sum under a law; `FAR` where none was weighed."""
        return max([v for (_, law), v in self.log_evidence.items() if law == restoring], default=FAR)

    def run_of(self, damping: str, restoring: str) -> DampingRun | None:
        """The likelihood of a damping under a law. Another form that was weighed under another law is taken to be as
        far behind the law's best sum as it is there. None where there is none."""
        found = self.runs.get((damping, restoring))
        if found is not None:
            return found
        for one in self.others:
            run = self.runs.get((damping, one.restoring)) if one.damping == damping else None
            if run is not None:
                gap = self.best(restoring) - self.best(one.restoring)
                return run.shifted(gap)
        return None

    def missing(self, damping: str, restoring: str, limit: str = "") -> float:
        """Log evidence that stands for a damping which this run did not weigh: that of the sum to which it comes in a
        limit, else `FAR`; both with coefficients of the run's own."""
        own = self.log_evidence.get((damping, restoring))
        place = self.log_evidence.get((limit, restoring), FAR)
        return max(place if own is None else own, FAR)


@dataclass(frozen=True)
class WeighedSpecimen:
    """Every damping and law on all runs.

    log_evidence: nats, integrated once over the coefficients that runs have in common; repeats: the posteriors of those
    that were joined; runs: of these each run's likelihood, at the specimen's reference.
    """

    records: tuple[WeighedRun, ...]
    log_evidence: Mapping[Model, float]
    probability: Mapping[Model, float]
    repeats: Mapping[Model, Repeats]
    runs: Mapping[Model, tuple[DampingRun, ...]]
    reference: Reference

    def spread(self) -> dict[str, float]:
        """Return the summary of the spread between runs (standard deviation), over every damping that was joined."""
        shares = {m: self.probability[m] for m in self.repeats}
        every = np.concatenate([self.repeats[m].spreads for m in shares])
        sizes = [self.repeats[m].spreads.size for m in shares]
        weight = np.concatenate([np.full(n, p / n) for n, p in zip(sizes, shares.values(), strict=True)])
        return summarise(every, weight / weight.sum())

    def others(self) -> dict[str, float]:
        """Return the probability of each form of damping that is not compared."""
        places = {one.damping for r in self.records for one in r.others}
        found = dict.fromkeys(sorted(places), 0.0)
        for (damping, _), p in self.probability.items():
            if damping in places:
                found[damping] += p
        return found

    def under(self, model: Model) -> list[WeighedRun]:
        """Return the runs under one model alone, which was joined, at the specimen's reference."""
        return [
            WeighedRun({model: 0.0}, (), {model: run}, self.reference, record.amplitudes)
            for record, run in zip(self.records, self.runs[model], strict=True)
        ]

    def ratios(self, amplitude: float, count: int, seed: int = 0) -> tuple[np.ndarray, np.ndarray]:
        """Draws of the specimen's damping ratio at an amplitude under its laws, over every damping, and of the spread
        that belongs to each, (n,) both."""
        rng = np.random.default_rng(seed)
        chosen = {m: p for m, p in self.probability.items() if m in self.repeats}
        shares = np.array(list(chosen.values()))
        numbers = rng.multinomial(count, shares / shares.sum())
        values, spreads = [], []
        for model, number in zip(chosen, numbers, strict=True):
            if number:
                found = self.repeats[model]
                rows = rng.choice(len(found.draws), number)
                values.append(self._ratio(model, amplitude, found.draws[rows]))
                spreads.append(found.spreads[rows])
        return np.concatenate(values), np.concatenate(spreads)

    def _ratio(self, model: Model, amplitude: float, draws: np.ndarray) -> np.ndarray:
        """The geometric mean over the runs' own restoring laws."""
        logs = []
        for record, run in zip(self.records, self.runs[model], strict=True):
            good = np.all(np.isfinite(run.per_unit), axis=1)
            order = np.flatnonzero(good)[np.argsort(record.amplitudes[good])]
            at = np.interp(np.log(amplitude), np.log(record.amplitudes[order]), np.arange(order.size))
            low = min(int(at), max(order.size - 2, 0))
            high, share = min(low + 1, order.size - 1), at - low
            ends = [np.log(np.maximum(run.ratio(int(order[i]), draws), 1e-300)) for i in (low, high)]
            logs.append((1 - share) * ends[0] + share * ends[1])
        return np.exp(np.mean(logs, axis=0))


def weigh_specimen(
    records: Sequence[WeighedRun],
    given: Mapping[str, Prior] | None = None,
    *,
    spread: float | None = None,
    seed: int = 0,
) -> WeighedSpecimen:
    """Weigh every damping and law on several runs of one specimen.

    Parameters
    ----------
    records
        One or more.
    given
        Priors that are stated, by parameter; the others are the default ones at the geometric mean of the runs'
        references.
    spread
        Of the logarithm of a run's factor where it is known; else it is inferred.
    """
    reference = common_reference(records)
    places = {one.damping: one.place for r in records for one in r.others}
    laws = {law for r in records for _, law in r.log_evidence}
    models = {m for r in records for m in r.log_evidence} | {(d, law) for law in laws for d in places}
    own = {m: sum(r.missing(*m, places.get(m[0], "")) for r in records) for m in models}

    def prior(model: Model) -> float:
        terms = model[0].split("+")
        return float(np.log(odds(terms, len(places) if model[0] in places else 0)))

    logs: dict[Model, float] = {}
    repeats: dict[Model, Repeats] = {}
    runs: dict[Model, tuple[DampingRun, ...]] = {}
    best = -np.inf
    for model in sorted(models, key=lambda m: (-own[m], m)):
        found = [r.run_of(*model) for r in records]
        known = [
            _at_reference(run, model[0], r.reference, reference)
            for r, run in zip(records, found, strict=True)
            if run is not None
        ]
        limit = places.get(model[0], "")
        rest = sum(r.missing(*model, limit) for r, run in zip(records, found, strict=True) if run is None)
        most = rest + sum(map(_largest, known))
        if not known or most + prior(model) < best - REACH:
            logs[model] = min(own[model], most)
            continue
        priors = priors_of(model[0], reference, given)
        known = [_ordered(run, tuple(priors)) for run in known]
        alike, log_sizes = _alike(known)
        one = joined(alike, priors, log_sizes, spread=spread, seed=seed)
        logs[model] = one.log_evidence + rest
        best = max(best, logs[model] + prior(model))
        if len(known) == len(records):
            repeats[model] = one
            runs[model] = tuple(known)
    weights = {m: v + prior(m) for m, v in logs.items()}
    top = max(weights.values())
    total = sum(np.exp(v - top) for v in weights.values())
    probability = {m: float(np.exp(v - top) / total) for m, v in weights.items()}
    return WeighedSpecimen(tuple(records), logs, probability, repeats, runs, reference)


def common_reference(records: Sequence[WeighedRun]) -> Reference:
    """Return the geometric mean of the references of several runs."""
    amplitude, frequency = (
        float(np.exp(np.mean(np.log([getattr(r.reference, n) for r in records]))))
        for n in ("amplitude", "frequency")
    )
    return Reference(amplitude, frequency)


def priors_of(
    damping: str, reference: Reference, given: Mapping[str, Prior] | None = None
) -> dict[str, Prior]:
    """Return the priors of a specimen's damping parameters: those that are stated, else the default ones."""
    priors = damping_priors(damping.split("+"), reference)
    return {n: (given or {}).get(n, p) for n, p in priors.items()}


def _largest(run: RunLikelihood) -> float:
    """The largest log likelihood of a run, whatever its damping and the deviations' sizes."""
    found = run.likelihood
    scale = np.sqrt(np.maximum(np.diagonal(found.information, axis1=1, axis2=2), 1e-300))
    part = found.information / (scale[:, :, None] * scale[:, None, :]) + 1e-10 * np.eye(scale.shape[1])
    aim = found.slope / scale
    gain = 0.5 * np.sum(aim * np.linalg.solve(part, aim[:, :, None])[:, :, 0], axis=1)
    return float(np.max(found.log + gain))


def _alike(runs: Sequence[DampingRun]) -> tuple[list[DampingRun], np.ndarray]:
    """Return runs with the same combinations of the deviations' sizes, and the log prior probabilities of these: all of
    them, or, where a run has none, that laws hold exactly."""
    sizes = {r.likelihood.log.size for r in runs}
    if len(sizes) == 1:
        return list(runs), np.zeros(1) if sizes == {1} else grid_of(LEAST_KNOTS).log_prior
    parts = ((r, r.likelihood) for r in runs)
    exact = [
        replace(r, likelihood=DampingLikelihood(x.log[:1], x.slope[:1], x.information[:1])) for r, x in parts
    ]
    return exact, np.zeros(1)


def _ordered(run: DampingRun, names: tuple[str, ...]) -> DampingRun:
    """Return a run with its parameters in an order."""
    at, found = [run.names.index(n) for n in names], run.likelihood
    likelihood = DampingLikelihood(found.log, found.slope[:, at], found.information[:, at][:, :, at])
    return DampingRun(
        names, run.coefficients[at], run.mode[at], likelihood, run.per_unit[:, at], run.growth[:, at]
    )


def _at_reference(run: DampingRun, damping: str, own: Reference, common: Reference) -> DampingRun:
    """A run with the coefficients that its terms have at another reference.

    The force of a term such as a power of the velocity is written with a reference velocity: its coefficient at
    another one is larger by a factor that depends on the exponent. To first order about the run's own best motion.
    """
    names = run.names
    jacobian, moved = np.eye(len(names)), run.mode.copy()
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
        moved[place] *= at
        jacobian[place, place] = at
        per_unit[:, place] /= at
        for i in further:
            step = 1e-4
            changed = run.mode.copy()
            changed[i] += step
            slope = float(np.log(factor(changed) / at)) / step
            jacobian[place, i] = moved[place] * slope
            growth[:, i] -= slope
    if np.array_equal(jacobian, np.eye(len(names))):
        return run
    inverse = np.linalg.inv(jacobian)
    changed = run.likelihood.mapped(run.mode - inverse @ moved, inverse)
    return replace(run, mode=moved, likelihood=changed, per_unit=per_unit, growth=growth)
