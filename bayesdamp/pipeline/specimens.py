"""Several records of one specimen, fitted jointly from their answers, and the population of all specimens."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from bayesdamp.config import SignalSpec, Study
from bayesdamp.inference.deviation.repeats import Repeats
from bayesdamp.inference.deviation.specimen import (
    Model,
    RunComparison,
    SpecimenComparison,
    common_reference,
    compare_runs,
    priors_of,
)
from bayesdamp.inference.population import Sample, population
from bayesdamp.numerics.weights import summarise
from bayesdamp.outcomes import Status
from bayesdamp.physics.damping import parse_model
from bayesdamp.physics.symbols import parameter_unit
from bayesdamp.pipeline.answering import (
    ANSWERED,
    SAMPLED,
    answer_key,
    answered_of,
    is_approximate,
    stated_priors,
)
from bayesdamp.pipeline.tasks import Product, cell_seed, task_key
from bayesdamp.priors import Prior, SharedHalfNormal
from bayesdamp.store import Store
from bayesdamp.store.contents import (
    JointCandidate,
    JointContent,
    PopulationContent,
    PopulationFound,
    Summary,
    WeighingContent,
)
from bayesdamp.types import OK, Reference, Refusal, candidate_parts, summed
from bayesdamp.units import UNITS

NOT_JOINED = Status.PRUNED.because("far behind, so its coefficients were not inferred from all records")
NOT_WEIGHED = Status.PRUNED.because("not weighed in the answer on any record")
WIDE = 3.0
"""Scale of the prior of a population's location, in units of the largest coefficient of a specimen, where the study
states no prior of the coefficient. Much wider than the specimens' own intervals."""
Arrays = dict[str, np.ndarray]


@dataclass(frozen=True)
class AnsweredRecord:
    """A record that has an answer: its label, signal and repeat, and the weighing of every damping in its answer."""

    label: str
    signal: str
    repeat: int
    weighed: RunComparison


class Specimen:
    """One specimen of a study: its records, its candidates and their weighing."""

    def __init__(self, study: Study, name: str, specs: Sequence[SignalSpec], store: Store) -> None:
        self.study, self.name, self.specs, self.store = study, name, tuple(specs), store
        self.records = [(spec, repeat) for spec in self.specs for repeat in range(spec.repeats)]
        self.labels = [f"{s.name}, {r + 1}" if s.repeats > 1 else s.name for s, r in self.records]
        self.candidates = study.compare(self.specs[0])

    @property
    def deviation(self) -> str:
        """Return "law" where laws may hold approximately in every record's answer, else "none"."""
        return "law" if all(is_approximate(self.study, spec) for spec in self.specs) else "none"

    @property
    def key(self) -> str:
        """The key of its joint fit, which depends on the answers on its records, sampled or not."""
        keys = [
            answer_key(self.study, spec, repeat, self.store, kind)
            for spec, repeat in self.records
            for kind in (ANSWERED, SAMPLED)
        ]
        return task_key(
            "joint", self.name, self.candidates, {n: str(p) for n, p in self.priors.items()}, keys
        )

    @property
    def priors(self) -> dict[str, Prior]:
        """The priors of damping terms that the study states, by parameter."""
        return stated_priors(self.study)

    @property
    def seed(self) -> int:
        """The seed of this specimen's draws: the same as for the verdict on it."""
        return cell_seed(self.study, f"specimen/{self.name}")

    @cached_property
    def answered(self) -> list[AnsweredRecord]:
        """The records that have an answer, in the study's order."""
        records = []
        for label, (spec, repeat) in zip(self.labels, self.records, strict=True):
            answer = answered_of(self.store, spec.name, repeat)
            if answer is not None:
                records.append(AnsweredRecord(label, spec.name, repeat, answer.comparison))
        return records

    @property
    def reference(self) -> Reference:
        """The reference of its priors: the geometric mean over its records."""
        return common_reference([r.weighed for r in self.answered])

    @cached_property
    def weighed(self) -> SpecimenComparison:
        """Every damping and law on all records that have an answer. Raises Refusal where none has one."""
        if not self.answered:
            raise Refusal("no record has an answer")
        return compare_runs([r.weighed for r in self.answered], self.priors, seed=self.seed)

    def model_of(self, candidate: str) -> Model | None:
        """Return a candidate as the answers name it; None where no record weighed it."""
        damping, law = candidate_parts(candidate)
        terms, law = set(parse_model(damping)), law or self.specs[0].restoring[0]
        models = self.weighed.log_evidence
        return next((m for m in models if set(m[0].split("+")) == terms and m[1] == law), None)

    def units(self, candidate: str, names: Sequence[str]) -> dict[str, str]:
        """Return the units of parameters, as tables have them."""
        law = candidate_parts(candidate)[1] or self.specs[0].restoring[0]
        source = self.specs[0].source
        return {n: parameter_unit(n, law, UNITS[source.unit].base, source.quantity) for n in names}


def summarise_draws(draws: Repeats) -> dict[str, Summary]:
    """Return the summary of each damping parameter of the specimen, from draws of equal weight."""
    weights = np.full(len(draws.draws), 1.0 / len(draws.draws))
    return {n: summarise(draws.draws[:, i], weights) for i, n in enumerate(draws.names)}


def compute_joint(specimen: Specimen) -> Product:
    """Return the joint fit (`joint/SPECIMEN`) and its draws. Raises Refusal where fewer than two records have one."""
    if len(specimen.answered) < 2:
        raise Refusal("fewer than two of its records have an answer")
    rows, arrays = weigh_candidates(specimen)
    weighed = specimen.weighed
    if not weighed.repeats:
        raise Refusal("no damping model was weighed on all records")
    best = find_likeliest({c: row.probability for c, row in rows.items()})
    model = specimen.model_of(best)
    alone: dict[str, WeighingContent] = {}
    no_spread = float("nan")
    if model is not None and model in weighed.repeats:
        runs, units = weighed.under(model), rows[best].units
        for record, run in zip(specimen.answered, runs, strict=True):
            single = compare_runs([run], specimen.priors, seed=specimen.seed)
            summary = summarise_draws(single.repeats[model])
            alone[record.label] = WeighingContent(OK, single.log_evidence[model], summary, units)
        same = compare_runs(runs, specimen.priors, spread=0.0, seed=specimen.seed)
        no_spread = same.log_evidence[model] - weighed.log_evidence[model]
    content = JointContent(
        records=tuple(r.label for r in specimen.answered),
        members=tuple((r.signal, r.repeat) for r in specimen.answered),
        deviation=specimen.deviation,
        reference=weighed.reference,
        best=best,
        candidates=rows,
        others=weighed.others(),
        spread=weighed.spread(),
        no_spread=no_spread,
        alone=alone,
    )
    return Product(content, arrays)


def weigh_candidates(specimen: Specimen) -> tuple[dict[str, JointCandidate], Arrays]:
    """Return each candidate of a study on a specimen's records, and draws as `JointContent` explains them."""
    rows: dict[str, JointCandidate] = {}
    arrays: Arrays = {}
    weighed = specimen.weighed
    for candidate in specimen.candidates:
        model = specimen.model_of(candidate)
        if model is None:
            rows[candidate] = JointCandidate(NOT_WEIGHED)
            continue
        repeats = weighed.repeats.get(model)
        summary = {} if repeats is None else summarise_draws(repeats)
        rows[candidate] = JointCandidate(
            OK if repeats else NOT_JOINED,
            weighed.log_evidence[model],
            summary,
            specimen.units(candidate, list(summary)),
            weighed.probability[model],
        )
        if repeats is None:
            continue
        arrays[f"{candidate}/spread"] = repeats.spreads
        priors = priors_of(model[0], weighed.reference, specimen.priors)
        coefficients = weighed.runs[model][0].coefficients
        for i, name in enumerate(repeats.names):
            if coefficients[i]:
                draws = repeats.draws[:, i]
                arrays[f"{candidate}/{name}"] = draws
                arrays[f"{candidate}/{name}/log_prior"] = np.asarray(priors[name].log_density(draws))
    return rows, arrays


def coefficients_of(arrays: Mapping[str, np.ndarray], candidate: str) -> dict[str, np.ndarray]:
    """Return the draws of a candidate's coefficients, by name."""
    start, end = f"{candidate}/", "/log_prior"
    names = [
        n.removeprefix(start).removesuffix(end) for n in arrays if n.startswith(start) and n.endswith(end)
    ]
    return {n: arrays[f"{candidate}/{n}"] for n in names}


def find_likeliest(probabilities: Mapping[str, float]) -> str:
    """Return the likeliest candidate of the likeliest damping, whose probability is summed over restoring laws."""
    dampings = summed(probabilities)
    first = max(dampings, key=lambda d: dampings[d])
    return max((c for c in probabilities if candidate_parts(c)[0] == first), key=lambda c: probabilities[c])


def compute_population(study: Study, store: Store) -> Product:
    """Return the population over all specimens (`population/specimens`), under one candidate for all.

    Raises Refusal where there is none.
    """
    specimens = [Specimen(study, label, specs, store) for label, specs in study.specimens.items()]
    assumed = sorted({s.deviation for s in specimens})
    if len(assumed) > 1:
        raise Refusal("no population: laws hold exactly for some specimens, approximately for others")
    bases = sorted({UNITS[s.specs[0].source.unit].base for s in specimens})
    if len(bases) > 1:
        raise Refusal(f"no population: some specimens are measured in {', others in '.join(bases)}")
    rows: dict[str, Mapping[str, JointCandidate]] = {}
    draws: dict[str, Arrays] = {}
    for s in specimens:
        rows[s.name], draws[s.name] = candidates_of(s)
    logs = {
        label: {c: r.log_evidence for c, r in own.items() if r.log_evidence is not None}
        for label, own in rows.items()
    }
    common = set.intersection(*map(set, logs.values()))
    sums = {c: sum(own[c] for own in logs.values()) for c in specimens[0].candidates if c in common}
    candidates = [c for c in sums if all(own[c].summary for own in rows.values())]
    if not candidates:
        raise Refusal("no population: no model was weighed on every specimen")
    best = max(candidates, key=lambda c: sums[c])
    names = list(coefficients_of(draws[specimens[0].name], best))
    damping = "+".join(parse_model(candidate_parts(best)[0]))
    populations: dict[str, PopulationFound] = {}
    for name in names:
        samples = []
        for label, arrays in draws.items():
            values, log_prior = arrays[f"{best}/{name}"], arrays[f"{best}/{name}/log_prior"]
            samples.append(Sample(label, values, np.zeros(values.size), log_prior))
        priors = [priors_of(damping, s.reference, s.priors)[name] for s in specimens]
        scale = location_scale(priors, [float(np.mean(s.values)) for s in samples])
        populations[name] = PopulationFound(scale, **vars(population(samples, scale)))
    content = PopulationContent(
        deviation=assumed[0],
        best=best,
        log_evidence=sums,
        behind={label: max(own.values()) - own[best] for label, own in logs.items()},
        specimens={label: own[best] for label, own in rows.items()},
        units=specimens[0].units(best, names),
        populations=populations,
    )
    warnings = dict.fromkeys(p.outcome for p in populations.values() if p.outcome != OK)
    return Product(content, outcome="; ".join(warnings) or OK)


def location_scale(priors: Sequence[Prior], means: Sequence[float]) -> float:
    """Return the scale of the half-normal prior of a population's location.

    Parameters
    ----------
    priors
        Of the coefficient, one for each specimen. A stated one has a scale; of several the geometric mean is taken. The
        default one has none: then the scale is `WIDE` times the largest mean.
    means
        Posterior means of the coefficient, one for each specimen.
    """
    if any(isinstance(p, SharedHalfNormal) for p in priors):
        return WIDE * max(means)
    return float(np.exp(np.mean(np.log([float(p.value(1.0)) for p in priors]))))


def candidates_of(specimen: Specimen) -> tuple[Mapping[str, JointCandidate], Arrays]:
    """Return each candidate on a specimen and its draws: from the joint fit, or from its only record.

    Both are empty where it has no fit.
    """
    if len(specimen.records) > 1:
        cell = specimen.store.read(f"joint/{specimen.name}")
        content = JointContent.maybe(cell)
        return (content.candidates, dict(cell.arrays)) if content else ({}, {})
    try:
        return weigh_candidates(specimen)
    except Refusal:
        return {}, {}
