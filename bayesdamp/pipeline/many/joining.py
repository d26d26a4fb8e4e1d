"""The joint fit of a specimen's records, put together from the answers on them."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from bayesdamp.inference.deviation.specimen import priors_of, weigh_specimen
from bayesdamp.outcomes import Status
from bayesdamp.pipeline.many.specimens import Specimen, summaries
from bayesdamp.pipeline.tasks import Product
from bayesdamp.store.contents import JointCandidate, JointContent, Weighing
from bayesdamp.types import OK, Refusal, candidate_parts, summed

NOT_JOINED = Status.PRUNED.because("far behind, so its coefficients were not inferred from all records")
NOT_WEIGHED = Status.PRUNED.because("not weighed in the answer on any record")
Arrays = dict[str, np.ndarray]


def joined(specimen: Specimen) -> Product:
    """Return the joint fit (`joint/SPECIMEN`) and its draws. Raises Refusal where fewer than two records have one."""
    if len(specimen.answered) < 2:
        raise Refusal("fewer than two of its records have an answer")
    rows, arrays = weighed_candidates(specimen)
    weighed = specimen.weighed
    if not weighed.repeats:
        raise Refusal("no damping model was weighed on all records")
    best = likeliest({c: row.probability for c, row in rows.items()})
    model = specimen.model_of(best)
    alone: dict[str, Weighing] = {}
    no_spread = float("nan")
    if model is not None and model in weighed.repeats:
        runs, units = weighed.under(model), rows[best].units
        for record, run in zip(specimen.answered, runs, strict=True):
            one = weigh_specimen([run], specimen.priors, seed=specimen.seed)
            alone[record.label] = Weighing(OK, one.log_evidence[model], summaries(one.repeats[model]), units)
        same = weigh_specimen(runs, specimen.priors, spread=0.0, seed=specimen.seed)
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


def weighed_candidates(specimen: Specimen) -> tuple[dict[str, JointCandidate], Arrays]:
    """Return each candidate of a study on a specimen's records, and draws as `JointContent` explains them."""
    rows: dict[str, JointCandidate] = {}
    arrays: Arrays = {}
    weighed = specimen.weighed
    for candidate in specimen.candidates:
        model = specimen.model_of(candidate)
        if model is None:
            rows[candidate] = JointCandidate(NOT_WEIGHED)
            continue
        found = weighed.repeats.get(model)
        summary = {} if found is None else summaries(found)
        rows[candidate] = JointCandidate(
            OK if found else NOT_JOINED,
            weighed.log_evidence[model],
            summary,
            specimen.units(candidate, list(summary)),
            weighed.probability[model],
        )
        if found is None:
            continue
        arrays[f"{candidate}/spread"] = found.spreads
        priors = priors_of(model[0], weighed.reference, specimen.priors)
        coefficients = weighed.runs[model][0].coefficients
        for i, name in enumerate(found.names):
            if coefficients[i]:
                arrays[f"{candidate}/{name}"] = found.draws[:, i]
                log_prior = np.asarray(priors[name].log_density(found.draws[:, i]))
                arrays[f"{candidate}/{name}/log_prior"] = log_prior
    return rows, arrays


def coefficients_of(arrays: Mapping[str, np.ndarray], candidate: str) -> dict[str, np.ndarray]:
    """Return the draws of a candidate's coefficients, by name."""
    start, end = f"{candidate}/", "/log_prior"
    names = [
        n.removeprefix(start).removesuffix(end) for n in arrays if n.startswith(start) and n.endswith(end)
    ]
    return {n: arrays[f"{candidate}/{n}"] for n in names}


def likeliest(probabilities: Mapping[str, float]) -> str:
    """Return the likeliest candidate of the likeliest damping, whose probability is summed over restoring laws."""
    dampings = summed(probabilities)
    first = max(dampings, key=lambda d: dampings[d])
    return max((c for c in probabilities if candidate_parts(c)[0] == first), key=lambda c: probabilities[c])
