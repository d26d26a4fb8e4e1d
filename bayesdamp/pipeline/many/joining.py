"""Repeats of one specimen, fitted jointly: one damping; each record has a start, an angle at rest and a noise of its
own.

Whether the restoring law's parameters are shared too is decided once for a specimen, by Laplace's evidence of the best
candidate.
"""

from __future__ import annotations

import math
import time
from collections.abc import Mapping
from dataclasses import replace

import numpy as np
from scipy.special import logsumexp

from bayesdamp.inference.many.joint import JointMode
from bayesdamp.inference.many.joint_evidence import Weighed, weigh
from bayesdamp.outcomes import Status
from bayesdamp.pipeline.keys import task_key
from bayesdamp.pipeline.many.agreement import agreement
from bayesdamp.pipeline.many.specimens import (
    BOTH,
    DAMPING,
    LAW,
    Problem,
    Specimen,
    draws_of,
    summaries,
    weighed_content,
    weighing,
)
from bayesdamp.pipeline.pruning import LAW_MARGIN
from bayesdamp.pipeline.records.records import plain_seconds
from bayesdamp.store import CellResult
from bayesdamp.store.contents.many import JointCandidate, JointContent, WeighedContent
from bayesdamp.store.contents.records import Scales
from bayesdamp.types import OK, Refusal, candidate_parts, summed


def join(specimen: Specimen, name: str, key: str) -> None:
    """Store the joint fit (`joint/rig`), or why there is none."""
    began = time.perf_counter()
    try:
        content, arrays = _joined(specimen, key)
    except Refusal as refusal:
        specimen.store.write(CellResult(name, key, outcome=str(refusal), seconds=plain_seconds(began)))
        return
    specimen.store.write(
        CellResult(name, key, content.meta(), arrays, content.said["outcome"], plain_seconds(began))
    )


def _joined(specimen: Specimen, key: str) -> tuple[JointContent, dict[str, np.ndarray]]:
    problems, aside = _problems(specimen)
    looks, sharing = _looks(specimen, problems, aside)
    arrays: dict[str, np.ndarray] = {}
    logs: dict[str, float] = {}
    rows = {c: JointCandidate(why) for c, why in aside.items()}
    for candidate, mode in looks.items():
        found = _weighed(specimen, candidate, mode, key)
        rows[candidate] = _row(specimen, candidate, mode, found)
        arrays |= draws_of(candidate, mode, found)
        logs[candidate] = found.log_evidence
    total = float(np.asarray(logsumexp(list(logs.values()))))
    for candidate, log_evidence in logs.items():
        rows[candidate] = replace(rows[candidate], probability=math.exp(log_evidence - total))
    best = likeliest({c: rows[c].probability for c in logs})
    sharing = sharing if problems[best].names(LAW) else DAMPING
    agreed = agreement(specimen, best, problems[best], sharing, rows[best], looks[best])
    content = JointContent(
        records=tuple(specimen.labels),
        members=tuple((spec.name, repeat) for spec, repeat in specimen.records),
        deviation=specimen.deviation,
        reference=Scales(**vars(specimen.reference)),
        sharing=sharing,
        best=best,
        candidates={c: rows[c] for c in specimen.candidates},
        **vars(agreed),
    )
    return content, arrays


def likeliest(probabilities: Mapping[str, float]) -> str:
    """The likeliest candidate of the likeliest damping, whose probability is summed over the restoring laws."""
    dampings = summed(probabilities)
    first = max(dampings, key=lambda d: dampings[d])
    return max((c for c in probabilities if candidate_parts(c)[0] == first), key=lambda c: probabilities[c])


def _weighed(specimen: Specimen, candidate: str, mode: JointMode, key: str) -> Weighed:
    """A candidate's evidence; what a run that was cut off had of it is taken from the store (`weighed/rig/viscous`)."""
    name, seed = f"weighed/{specimen.name}/{candidate}", specimen.seed(candidate)
    own = task_key("weighed", key, mode.joint.shared, seed)
    if specimen.store.has(name, own):
        cell = specimen.store.read(name)
        told = vars(WeighedContent.of(cell))
        return Weighed(**told, scores=cell.arrays["scores"], log_weights=cell.arrays["log_weights"])
    began = time.perf_counter()
    found = weigh(mode, seed)
    content, arrays = weighed_content(found), {"scores": found.scores, "log_weights": found.log_weights}
    specimen.store.write(CellResult(name, own, content.meta(), arrays, OK, plain_seconds(began)))
    return found


def _problems(specimen: Specimen) -> tuple[dict[str, Problem], dict[str, str]]:
    """The candidates that may still win, and why the others may not. Raises Refusal where there are none."""
    found, aside = {}, {}
    for candidate in specimen.candidates:
        try:
            found[candidate] = specimen.problem(candidate)
        except Refusal as refusal:
            aside[candidate] = str(refusal)
    if not found:
        raise Refusal(f"no model was fitted to all records: {next(iter(aside.values()))}")
    if specimen.study.models.prune is not None:
        apart = specimen.alone(tuple(found))
        sums = {c: sum(one.get(c, -math.inf) for one in apart) for c in found}
        limit = max(sums.values()) - specimen.study.models.prune - LAW_MARGIN
        for candidate in [c for c in found if sums[c] < limit]:
            aside[candidate] = Status.PRUNED.because("far behind on the records one by one")
            del found[candidate]
    return found, aside


def _looks(
    specimen: Specimen, problems: Mapping[str, Problem], aside: dict[str, str]
) -> tuple[dict[str, JointMode], str]:
    """The joint modes of the candidates that are weighed, under the sharing that fits the best of them best.

    aside: takes up why the others are not weighed.
    """
    modes: dict[str, dict[str, JointMode]] = {BOTH: {}, DAMPING: {}}
    refused = {}
    for candidate, problem in problems.items():
        for sharing in (BOTH, DAMPING):
            try:
                shared = problem.names(sharing)
                known = modes[BOTH].get(candidate)
                modes[sharing][candidate] = (
                    known if known and known.joint.shared == shared else problem.mode(shared)
                )
            except Refusal as refusal:
                refused[candidate] = str(refusal)
    logs = {s: {c: m.look() for c, m in found.items()} for s, found in modes.items() if found}
    if not logs:
        raise Refusal(f"no model has a joint mode: {next(iter(refused.values()))}")
    sharing = max(logs, key=lambda s: max(logs[s].values()))
    own, prune = logs[sharing], specimen.study.models.prune
    for candidate in problems:
        if candidate not in own:
            aside[candidate] = refused[candidate]
        elif prune is not None and max(own.values()) - own[candidate] > prune:
            aside[candidate] = Status.PRUNED.because(
                f"log Bayes factor to the best below −{prune:g} by Laplace's approximation"
            )
    return {c: m for c, m in modes[sharing].items() if c not in aside}, sharing


def _row(specimen: Specimen, candidate: str, mode: JointMode, found: Weighed) -> JointCandidate:
    units = specimen.units(candidate, mode.joint.shared)
    own = weighing(found, summaries(mode, found), units)
    return JointCandidate(**vars(own), converged=mode.converged, look=mode.look())
