"""Fit the records of one specimen jointly from their answers, and infer the population of all specimens."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import cached_property

import numpy as np

from bayesdamp.config import Study
from bayesdamp.inference.deviation.repeats import Repeats
from bayesdamp.inference.deviation.specimen import (
    RunComparison,
    SpecimenComparison,
    common_reference,
    compare_runs,
    priors_of,
)
from bayesdamp.inference.population import Sample, infer_population
from bayesdamp.numerics.weights import summarise
from bayesdamp.outcomes import Status
from bayesdamp.pipeline.answering import (
    ANSWER,
    SAMPLED_ANSWER,
    answer_key,
    stored_answer,
)
from bayesdamp.pipeline.records import StudyRecord
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
from bayesdamp.types import OK, Refusal, candidate_parts, sum_probabilities
from bayesdamp.units import UNITS
from bayesdamp.verdict.specimen import RecordAnswer

NOT_JOINED = Status.PRUNED.because(
    "much less probable than the best model, so its coefficients were not inferred from all records"
)
NOT_COMPARED = Status.PRUNED.because("not compared in the answer on any record")
LOCATION_SCALE = 3.0
"""Scale of the half-normal prior of a population's location, as a multiple of the largest posterior mean of a
specimen's coefficient. The population of a coefficient is a normal distribution about this location, truncated at 0.
The value is used if the study states no prior of the coefficient. A convention: much wider than the intervals of single
specimens."""
Arrays = dict[str, np.ndarray]


class Specimen:
    """One specimen of a study: its records, its candidates, and the joint fit of its records.

    specs: its signals. records: by label, which is the signal's name, and for repeats "NAME, 1", "NAME, 2" and so on.
    candidates: names of the candidates. seed: of the draws of its joint fit and of its verdict.
    """

    def __init__(self, study: Study, name: str, store: Store) -> None:
        self.study, self.name, self.specs, self.store = study, name, study.specimens[name], store
        self.records = {
            f"{spec.name}, {repeat + 1}" if spec.repeats > 1 else spec.name: StudyRecord(
                study, spec, repeat, store
            )
            for spec in self.specs
            for repeat in range(spec.repeats)
        }
        self.candidates, self.seed = study.compare(self.specs[0]), task_seed(study, f"specimen/{name}")

    @property
    def deviation(self) -> str:
        """Return "law" if the answers on all its records allow deviations from the laws, else "none"."""
        return "law" if all(self.study.deviation_of(spec) == "law" for spec in self.specs) else "none"

    @property
    def key(self) -> str:
        """The key of its task `joint/SPECIMEN`.

        It depends on the candidates, the priors, and the keys of both answers (linear and sampled) on each record.
        """
        kinds = ANSWER, SAMPLED_ANSWER
        keys = [answer_key(record, kind) for record in self.records.values() for kind in kinds]
        priors = {n: str(p) for n, p in self.study.priors.items()}
        return task_key("joint", self.name, self.candidates, priors, keys)

    @cached_property
    def answered(self) -> dict[str, RecordAnswer]:
        """The answers on its records by label, in the study's order; only those that compared candidates."""
        answers = {label: stored_answer(record) for label, record in self.records.items()}
        return {label: a.of_specimen() for label, a in answers.items() if a and a.content.candidates}

    @property
    def runs(self) -> list[RunComparison]:
        """The evidence of every damping model on each record of `answered`, in the same order."""
        return [answer.comparison for answer in self.answered.values()]

    @cached_property
    def comparison(self) -> SpecimenComparison:
        """The joint fit of all candidates to the records with an answer. Raises Refusal if no record has an answer."""
        if not self.answered:
            raise Refusal("no record has an answer")
        return compare_runs(self.runs, self.study.priors, seed=self.seed)

    def units(self, candidate: str, names: Sequence[str]) -> dict[str, str]:
        """Return the units, such as "1/s", of parameters under a candidate's restoring law, by parameter."""
        first = self.specs[0]
        return {n: first.unit_of(n, first.parts(candidate)[1]) for n in names}


def summarise_draws(draws: Repeats) -> dict[str, Summary]:
    """Return the summary of each damping parameter of a specimen, by name, from draws of equal weight.

    A summary has mean, sd, median, q2.5 and q97.5, in the unit of the parameter.
    """
    weights = np.full(len(draws.draws), 1.0 / len(draws.draws))
    return {n: summarise(draws.draws[:, i], weights) for i, n in enumerate(draws.names)}


def compute_joint(specimen: Specimen) -> Product:
    """Return the joint fit of a specimen's records, with its draws (`joint/SPECIMEN`).

    The content is a `JointContent`, which describes the arrays. Raises Refusal if fewer than two have an answer, or if
    no model was fitted to all of them.
    """
    if len(specimen.answered) < 2:
        raise Refusal("fewer than two records of the specimen have an answer")
    rows, arrays = compare_candidates(specimen)
    comparison = specimen.comparison
    if not comparison.repeats:
        raise Refusal("no damping model was fitted to all records")
    best = likeliest_candidate({c: row.probability for c, row in rows.items()})
    model = specimen.specs[0].parts(best)
    alone: dict[str, JointEvidence] = {}
    no_spread = float("nan")
    if model in comparison.repeats:
        priors, seed = specimen.study.priors, specimen.seed
        runs, units = comparison.under(model), rows[best].units
        for label, run in zip(specimen.answered, runs, strict=True):
            single = compare_runs([run], priors, seed=seed)
            summary = summarise_draws(single.repeats[model])
            alone[label] = JointEvidence(OK, single.log_evidence[model], summary, units)
        without_spread = compare_runs(runs, priors, spread=0.0, seed=seed)
        no_spread = without_spread.log_evidence[model] - comparison.log_evidence[model]
    records = {label: specimen.records[label] for label in specimen.answered}
    content = JointContent(
        records=tuple(records),
        members=tuple((record.spec.name, record.repeat) for record in records.values()),
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
    """Return the evidence and summaries of each candidate on a specimen, and arrays of draws, (n,), by name.

    The arrays are `CANDIDATE/NAME`, the draws of each coefficient; `CANDIDATE/NAME/log_prior`, their log prior density;
    and `CANDIDATE/spread`, the draws of the spread between records. A candidate that no answer compared, or whose
    coefficients were not inferred, has an outcome and no draws.
    """
    rows: dict[str, JointCandidate] = {}
    arrays: Arrays = {}
    comparison = specimen.comparison
    for candidate in specimen.candidates:
        model = specimen.specs[0].parts(candidate)
        if model not in comparison.log_evidence:
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
        priors = priors_of(model[0], comparison.reference, specimen.study.priors)
        coefficients = comparison.runs[model][0].coefficients
        for i, name in enumerate(repeats.names):
            if coefficients[i]:
                draws = repeats.draws[:, i]
                arrays[f"{candidate}/{name}"] = draws
                arrays[f"{candidate}/{name}/log_prior"] = np.asarray(priors[name].log_density(draws))
    return rows, arrays


def coefficients_of(arrays: Mapping[str, np.ndarray], candidate: str) -> dict[str, np.ndarray]:
    """Return the draws, (n,), of a candidate's coefficients by name, from the arrays of a joint fit.

    The arrays are `CANDIDATE/NAME` and `CANDIDATE/NAME/log_prior`. The result is empty if they contain no draws of the
    candidate.
    """
    start, end = f"{candidate}/", "/log_prior"
    names = [
        n.removeprefix(start).removesuffix(end) for n in arrays if n.startswith(start) and n.endswith(end)
    ]
    return {n: arrays[f"{candidate}/{n}"] for n in names}


def likeliest_candidate(probabilities: Mapping[str, float]) -> str:
    """Return the most probable candidate of the most probable damping.

    `probabilities` are by the names of candidates. The probability of a damping is summed over restoring laws.
    """
    dampings = sum_probabilities(probabilities)
    first = max(dampings, key=lambda d: dampings[d])
    return max((c for c in probabilities if candidate_parts(c)[0] == first), key=lambda c: probabilities[c])


def compute_population(study: Study, store: Store) -> Product:
    """Infer the population of each coefficient over all specimens (`population/specimens`).

    The content is a `PopulationContent`, without arrays. All specimens have the same candidate: of those that were
    fitted to every specimen, the one with the largest sum of log evidences. Raises Refusal if there is none, if the
    specimens have different base units, or if laws hold exactly for some specimens only.
    """
    specimens = [Specimen(study, name, store) for name in study.specimens]
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
    damping = candidate_parts(best)[0]
    populations: dict[str, CoefficientPopulation] = {}
    for name in names:
        samples = []
        for label, arrays in draws.items():
            values, log_prior = arrays[f"{best}/{name}"], arrays[f"{best}/{name}/log_prior"]
            samples.append(Sample(label, values, np.zeros(values.size), log_prior))
        priors = [priors_of(damping, common_reference(s.runs), study.priors)[name] for s in specimens]
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
        of their values at the score 1 (the scale, for a half-normal prior). The default prior has no fixed scale; then
        the result is `LOCATION_SCALE` times the largest mean.
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
