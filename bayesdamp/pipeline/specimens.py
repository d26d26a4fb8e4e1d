"""Fit the records of one specimen jointly from their answers, and infer the population of all specimens."""

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
from bayesdamp.inference.population import Sample, infer_population
from bayesdamp.numerics.weights import summarise
from bayesdamp.outcomes import Status
from bayesdamp.physics.damping import parse_model
from bayesdamp.physics.symbols import parameter_unit
from bayesdamp.pipeline.answering import (
    ANSWER,
    SAMPLED_ANSWER,
    answer_key,
    is_approximate,
    specimen_input,
    stated_priors,
)
from bayesdamp.pipeline.tasks import Product, task_key, task_seed
from bayesdamp.priors import Prior, SharedHalfNormal
from bayesdamp.store import Store
from bayesdamp.store.contents import (
    CoefficientPopulation,
    JointCandidate,
    JointContent,
    JointEvidence,
    PopulationContent,
    Summary,
)
from bayesdamp.types import OK, Reference, Refusal, candidate_parts, sum_probabilities
from bayesdamp.units import UNITS

NOT_JOINED = Status.PRUNED.because(
    "much less probable than the best model, so its coefficients were not inferred from all records"
)
NOT_COMPARED = Status.PRUNED.because("not compared in the answer on any record")
LOCATION_SCALE = 3.0
"""Scale of the half-normal prior of a population's location, as a multiple of the largest coefficient of a specimen.
The population of a coefficient is a normal distribution about this location, truncated at 0. The value is used if the
study states no prior of the coefficient. A convention: much wider than the intervals of single specimens."""
Arrays = dict[str, np.ndarray]


@dataclass(frozen=True)
class AnsweredRecord:
    """A record with an answer: its label, signal and number of the repeat (from 0), and its part in the joint fit.

    comparison: the evidence of every damping model on this record.
    """

    label: str
    signal: str
    repeat: int
    comparison: RunComparison


class Specimen:
    """One specimen of a study: its records, its candidates, and the joint fit of its records."""

    def __init__(self, study: Study, name: str, specs: Sequence[SignalSpec], store: Store) -> None:
        self.study, self.name, self.specs, self.store = study, name, tuple(specs), store
        self.records = [(spec, repeat) for spec in self.specs for repeat in range(spec.repeats)]
        self.labels = [f"{s.name}, {r + 1}" if s.repeats > 1 else s.name for s, r in self.records]
        self.candidates = study.compare(self.specs[0])

    @property
    def deviation(self) -> str:
        """Return "law" if the answers on all its records allow deviations from the laws, else "none"."""
        return "law" if all(is_approximate(self.study, spec) for spec in self.specs) else "none"

    @property
    def key(self) -> str:
        """The key of its task `joint/SPECIMEN`.

        It depends on the candidates, the priors, and the keys of both answers (linear and sampled) on each record.
        """
        keys = [
            answer_key(self.study, spec, repeat, self.store, kind)
            for spec, repeat in self.records
            for kind in (ANSWER, SAMPLED_ANSWER)
        ]
        return task_key(
            "joint", self.name, self.candidates, {n: str(p) for n, p in self.priors.items()}, keys
        )

    @property
    def priors(self) -> dict[str, Prior]:
        """The priors that the study states for damping terms, by parameter."""
        return stated_priors(self.study)

    @property
    def seed(self) -> int:
        """The seed of its draws; the verdict on the specimen uses the same one."""
        return task_seed(self.study, f"specimen/{self.name}")

    @cached_property
    def answered(self) -> list[AnsweredRecord]:
        """The records that have an answer, in the study's order."""
        records = []
        for label, (spec, repeat) in zip(self.labels, self.records, strict=True):
            answer = specimen_input(self.store, spec.name, repeat)
            if answer is not None:
                records.append(AnsweredRecord(label, spec.name, repeat, answer.comparison))
        return records

    @property
    def reference(self) -> Reference:
        """Amplitude and frequency to which its default priors are scaled: the geometric means over its records."""
        return common_reference([r.comparison for r in self.answered])

    @cached_property
    def comparison(self) -> SpecimenComparison:
        """The joint fit of all candidates to the records with an answer. Raises Refusal if no record has an answer."""
        if not self.answered:
            raise Refusal("no record has an answer")
        return compare_runs([r.comparison for r in self.answered], self.priors, seed=self.seed)

    def model_of(self, candidate: str) -> Model | None:
        """Return (damping sum, restoring law), as answers name them, for a candidate such as `viscous+coulomb@linear`.

        The order of terms does not matter. Without `@` the restoring law is the first one of the specimen's first
        signal. Return None if no answer compared this candidate.
        """
        damping, law = candidate_parts(candidate)
        terms, law = set(parse_model(damping)), law or self.specs[0].restoring[0]
        models = self.comparison.log_evidence
        return next((m for m in models if set(m[0].split("+")) == terms and m[1] == law), None)

    def units(self, candidate: str, names: Sequence[str]) -> dict[str, str]:
        """Return the units of parameters under a candidate's restoring law, as in the tables."""
        law = candidate_parts(candidate)[1] or self.specs[0].restoring[0]
        source = self.specs[0].source
        return {n: parameter_unit(n, law, UNITS[source.unit].base, source.quantity) for n in names}


def summarise_draws(draws: Repeats) -> dict[str, Summary]:
    """Return the summary of each damping parameter of a specimen, by name, from draws of equal weight."""
    weights = np.full(len(draws.draws), 1.0 / len(draws.draws))
    return {n: summarise(draws.draws[:, i], weights) for i, n in enumerate(draws.names)}


def compute_joint(specimen: Specimen) -> Product:
    """Return the joint fit of a specimen's records, with its draws (`joint/SPECIMEN`).

    Raises Refusal if fewer than two have an answer, or if no model was fitted to all of them.
    """
    if len(specimen.answered) < 2:
        raise Refusal("fewer than two records of the specimen have an answer")
    rows, arrays = compare_candidates(specimen)
    comparison = specimen.comparison
    if not comparison.repeats:
        raise Refusal("no damping model was fitted to all records")
    best = likeliest_candidate({c: row.probability for c, row in rows.items()})
    model = specimen.model_of(best)
    alone: dict[str, JointEvidence] = {}
    no_spread = float("nan")
    if model is not None and model in comparison.repeats:
        runs, units = comparison.under(model), rows[best].units
        for record, run in zip(specimen.answered, runs, strict=True):
            single = compare_runs([run], specimen.priors, seed=specimen.seed)
            summary = summarise_draws(single.repeats[model])
            alone[record.label] = JointEvidence(OK, single.log_evidence[model], summary, units)
        without_spread = compare_runs(runs, specimen.priors, spread=0.0, seed=specimen.seed)
        no_spread = without_spread.log_evidence[model] - comparison.log_evidence[model]
    content = JointContent(
        records=tuple(r.label for r in specimen.answered),
        members=tuple((r.signal, r.repeat) for r in specimen.answered),
        deviation=specimen.deviation,
        reference=comparison.reference,
        best=best,
        candidates=rows,
        others=comparison.others(),
        spread=comparison.spread(),
        no_spread=no_spread,
        alone=alone,
    )
    return Product(content, arrays)


def compare_candidates(specimen: Specimen) -> tuple[dict[str, JointCandidate], Arrays]:
    """Return the evidence and summaries of each candidate on a specimen, and the draws, named as in `JointContent`.

    A candidate that no answer compared, or whose coefficients were not inferred, has an outcome and no draws.
    """
    rows: dict[str, JointCandidate] = {}
    arrays: Arrays = {}
    comparison = specimen.comparison
    for candidate in specimen.candidates:
        model = specimen.model_of(candidate)
        if model is None:
            rows[candidate] = JointCandidate(NOT_COMPARED)
            continue
        repeats = comparison.repeats.get(model)
        summary = {} if repeats is None else summarise_draws(repeats)
        rows[candidate] = JointCandidate(
            OK if repeats else NOT_JOINED,
            comparison.log_evidence[model],
            summary,
            specimen.units(candidate, list(summary)),
            comparison.probability[model],
        )
        if repeats is None:
            continue
        arrays[f"{candidate}/spread"] = repeats.spreads
        priors = priors_of(model[0], comparison.reference, specimen.priors)
        coefficients = comparison.runs[model][0].coefficients
        for i, name in enumerate(repeats.names):
            if coefficients[i]:
                draws = repeats.draws[:, i]
                arrays[f"{candidate}/{name}"] = draws
                arrays[f"{candidate}/{name}/log_prior"] = np.asarray(priors[name].log_density(draws))
    return rows, arrays


def coefficients_of(arrays: Mapping[str, np.ndarray], candidate: str) -> dict[str, np.ndarray]:
    """Return the draws of a candidate's coefficients by name, from the arrays of a joint fit."""
    start, end = f"{candidate}/", "/log_prior"
    names = [
        n.removeprefix(start).removesuffix(end) for n in arrays if n.startswith(start) and n.endswith(end)
    ]
    return {n: arrays[f"{candidate}/{n}"] for n in names}


def likeliest_candidate(probabilities: Mapping[str, float]) -> str:
    """Return the most probable candidate of the most probable damping.

    The probability of a damping is summed over restoring laws.
    """
    dampings = sum_probabilities(probabilities)
    first = max(dampings, key=lambda d: dampings[d])
    return max((c for c in probabilities if candidate_parts(c)[0] == first), key=lambda c: probabilities[c])


def compute_population(study: Study, store: Store) -> Product:
    """Infer the population of each coefficient over all specimens (`population/specimens`).

    All specimens have the same candidate: of those that were fitted to every specimen, the one with the largest sum of
    log evidences. Raises Refusal if there is none, if the specimens have different base units, or if laws hold exactly
    for some specimens only.
    """
    specimens = [Specimen(study, label, specs, store) for label, specs in study.specimens.items()]
    assumed = sorted({s.deviation for s in specimens})
    if len(assumed) > 1:
        raise Refusal("no population: laws hold exactly for some specimens, approximately for others")
    bases = sorted({UNITS[s.specs[0].source.unit].base for s in specimens})
    if len(bases) > 1:
        raise Refusal(
            f"no population: some specimens are measured in {', others in '.join(bases)}; record all in one unit"
        )
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
        raise Refusal("no population: no model was fitted to every specimen")
    best = max(candidates, key=lambda c: sums[c])
    names = list(coefficients_of(draws[specimens[0].name], best))
    damping = "+".join(parse_model(candidate_parts(best)[0]))
    populations: dict[str, CoefficientPopulation] = {}
    for name in names:
        samples = []
        for label, arrays in draws.items():
            values, log_prior = arrays[f"{best}/{name}"], arrays[f"{best}/{name}/log_prior"]
            samples.append(Sample(label, values, np.zeros(values.size), log_prior))
        priors = [priors_of(damping, s.reference, s.priors)[name] for s in specimens]
        scale = location_scale(priors, [float(np.mean(s.values)) for s in samples])
        populations[name] = CoefficientPopulation(scale, **vars(infer_population(samples, scale)))
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
    """Return the scale of the half-normal prior of a population's location, in the unit of the coefficient.

    The population is a normal distribution about the location, truncated at 0.

    Parameters
    ----------
    priors
        Priors of the coefficient, one for each specimen. If the study states priors, the result is the geometric mean
        of their scales. The default prior has no fixed scale; then the result is `LOCATION_SCALE` times the largest
        mean.
    means
        Posterior means of the coefficient, one for each specimen.
    """
    if any(isinstance(p, SharedHalfNormal) for p in priors):
        return LOCATION_SCALE * max(means)
    return float(np.exp(np.mean(np.log([float(p.value(1.0)) for p in priors]))))


def candidates_of(specimen: Specimen) -> tuple[Mapping[str, JointCandidate], Arrays]:
    """Return the candidates of a specimen and their draws: from the joint fit, or from its only record.

    Both are empty if the specimen has no fit.
    """
    if len(specimen.records) > 1:
        result = specimen.store.read(f"joint/{specimen.name}")
        content = JointContent.maybe(result)
        return (content.candidates, dict(result.arrays)) if content else ({}, {})
    try:
        return compare_candidates(specimen)
    except Refusal:
        return {}, {}
