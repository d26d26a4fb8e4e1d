"""Specimens beside each other: the mean and the spread of the damping over them, under one candidate for all."""

from __future__ import annotations

import math
import time
from collections.abc import Mapping

import numpy as np

from bayesdamp.config import Study
from bayesdamp.inference.many.hierarchy import Sample, population
from bayesdamp.inference.many.joint_evidence import weigh
from bayesdamp.pipeline.candidates.weighing import evidence_by_method
from bayesdamp.pipeline.many.agreement import common_scale, disagrees
from bayesdamp.pipeline.many.specimens import Specimen, draws_of, summaries, weighing
from bayesdamp.pipeline.records.records import plain_seconds
from bayesdamp.store import CellResult, Store
from bayesdamp.store.contents.many import JointContent, PopulationContent, PopulationFound, Weighing
from bayesdamp.types import OK, Refusal
from bayesdamp.units import UNITS


def populate(study: Study, store: Store, name: str, key: str) -> None:
    """Store the population over all specimens (`population/specimens`), or why there is none."""
    began = time.perf_counter()
    found = [Specimen(study, label, specs, store) for label, specs in study.specimens.items()]
    try:
        content = _populated(found)
    except Refusal as refusal:
        store.write(CellResult(name, key, outcome=str(refusal), seconds=plain_seconds(began)))
        return
    said = [p.outcome for p in content.populations.values() if p.outcome != OK]
    said += [
        f"the records of {label} disagree, so that its own interval is too narrow" for label in content.torn
    ]
    outcome = "; ".join(dict.fromkeys(said)) or OK
    store.write(CellResult(name, key, content.meta(), {}, outcome, plain_seconds(began)))


def _populated(specimens: list[Specimen]) -> PopulationContent:
    assumed = sorted({s.deviation for s in specimens})
    if len(assumed) > 1:
        raise Refusal("no population: laws hold exactly for some specimens, approximately for others")
    bases = sorted({UNITS[s.specs[0].source.unit].base for s in specimens})
    if len(bases) > 1:
        raise Refusal(f"no population: some specimens are measured in {', others in '.join(bases)}")
    logs = {s.name: log_evidences(s) for s in specimens}
    common = set.intersection(*(set(found) for found in logs.values()))
    if not common:
        raise Refusal("no population: no model was weighed on every specimen")
    sums = {c: sum(found[c] for found in logs.values()) for c in specimens[0].candidates if c in common}
    best = max(sums, key=lambda c: sums[c])
    arrays, scales, rows = {}, {}, {}
    for specimen in specimens:
        arrays[specimen.name], rows[specimen.name], scales[specimen.name] = _draws(specimen, best)
    coefficients = list(scales[specimens[0].name])
    found = {}
    for name in coefficients:
        scale = common_scale([one[name] for one in scales.values()])
        samples = [
            Sample(label, a[f"{best}/{name}"], a[f"{best}/log_weights"], a[f"{best}/{name}/log_prior"])
            for label, a in arrays.items()
        ]
        found[name] = PopulationFound(scale, **vars(population(samples, scale)))
    return PopulationContent(
        deviation=assumed[0],
        best=best,
        log_evidence=sums,
        behind={label: max(one.values()) - one[best] for label, one in logs.items()},
        specimens=rows,
        torn=tuple(s.name for s in specimens if len(s.records) > 1 and _torn(s)),
        units=specimens[0].units(best, coefficients),
        populations=found,
    )


def log_evidences(specimen: Specimen) -> dict[str, float]:
    """Log evidence of the candidates that have one: of the joint fit, or of the record where there is one alone."""
    if len(specimen.records) > 1:
        content = JointContent.maybe(_joint(specimen))
        rows = content.candidates if content else {}
        return {c: r.log_evidence for c, r in rows.items() if r.log_evidence is not None}
    if specimen.approximate:
        return specimen.alone(specimen.candidates)[0]
    spec, repeat = specimen.records[0]
    record = f"{spec.name}/{repeat}"
    by_method = evidence_by_method(specimen.study, specimen.store, record, specimen.candidates)
    if not by_method:
        return {}
    last = by_method[list(by_method)[-1]]
    return {c: e.log_evidence for c, e in last.items() if math.isfinite(e.log_evidence)}


def _joint(specimen: Specimen) -> CellResult:
    return specimen.store.read(f"joint/{specimen.name}")


def _torn(specimen: Specimen) -> bool:
    """Whether a specimen's records disagree with one damping."""
    return disagrees(JointContent.of(_joint(specimen)).agreement["damping"])


def _draws(specimen: Specimen, candidate: str) -> tuple[Mapping[str, np.ndarray], Weighing, dict[str, float]]:
    """Weighted draws of a candidate's coefficients, what is told of them, and the scales of their priors."""
    problem = specimen.problem(candidate)
    priors = problem.records[0].priors
    if len(specimen.records) > 1:
        cell = _joint(specimen)
        arrays, row = cell.arrays, JointContent.of(cell).candidates[candidate]
    else:
        mode = problem.alone(0)
        found = weigh(mode, specimen.seed(candidate))
        arrays = draws_of(candidate, mode, found)
        summary = summaries(mode, found)
        row = weighing(found, summary, specimen.units(candidate, list(summary)))
    names = [n for n in problem.records[0].oscillator.coefficients if f"{candidate}/{n}" in arrays]
    return arrays, row, {n: float(priors[n].value(1.0)) for n in names}
