"""Whether the records of a specimen agree with one damping: evidence with and without it, and each record alone."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.special import chdtrc

from bayesdamp.inference.many.hierarchy import Sample, population
from bayesdamp.inference.many.joint import Apart, JointMode
from bayesdamp.inference.many.joint_evidence import Weighed, weigh
from bayesdamp.pipeline.many.specimens import (
    BOTH,
    DAMPING,
    LAW,
    NOTHING,
    Problem,
    Specimen,
    draws_of,
    summaries,
    weighing,
)
from bayesdamp.store.contents.many import (
    CLEAR,
    UNLIKELY,
    BayesFactor,
    JointCandidate,
    PopulationFound,
    SharedEvidence,
    Weighing,
)
from bayesdamp.types import OK, Refusal

WITHOUT = {BOTH: LAW, DAMPING: NOTHING}
"""What is shared once each record has a damping of its own."""
ASIDE_DRAWS = 1000
"""For a sharing of which nothing but the evidence is asked."""
FAR_APART = 30.0
"""Nats by which another sharing is so far off that Laplace's evidence of it will do: it is a few off at most."""
OTHER_LAW = {BOTH: DAMPING, DAMPING: BOTH}


@dataclass(frozen=True)
class Agreement:
    """What a joint fit says of its best candidate, as `JointContent` explains it."""

    sharings: Mapping[str, SharedEvidence]
    agreement: Mapping[str, BayesFactor]
    said: Mapping[str, str]
    alone: Mapping[str, Weighing]
    repeats: Mapping[str, PopulationFound]


def agreement(
    specimen: Specimen, candidate: str, problem: Problem, sharing: str, row: JointCandidate, joint: JointMode
) -> Agreement:
    """What a joint fit says of its best candidate.

    row, joint: of this candidate under the sharing that was chosen. Raises Refusal where a record has no fit of its
    own.
    """
    modes = [problem.alone(j) for j in range(len(problem.records))]
    alone = [
        weigh(mode, specimen.seed(candidate, label))
        for mode, label in zip(modes, specimen.labels, strict=True)
    ]
    stderr = float("nan") if row.stderr is None else row.stderr
    found = {sharing: SharedEvidence(row.log_evidence, stderr, row.outcome), NOTHING: _summed(alone)}

    def seed(what: str) -> int:
        return specimen.seed(candidate, what)

    free = {NOTHING: modes}
    for other in (BOTH, DAMPING, LAW) if problem.names(LAW) else (DAMPING,):
        if other != sharing:
            try:
                free[other] = [problem.mode(problem.names(other))]
                found[other] = _weighed(free[other][0], row.look, seed(other))
            except Apart as apart:
                found[other] = SharedEvidence(sum(one.log_evidence for one in alone) - apart.nats)
            except Refusal as refusal:
                found[other] = SharedEvidence(outcome=str(refusal))
    chance = chance_of(joint, free.get(WITHOUT[sharing], ()), len(problem.names(DAMPING)))
    factors = {"damping": replace(_factor(found, sharing, WITHOUT[sharing]), chance=chance)}
    if problem.names(LAW):
        law = _factor(found, sharing, OTHER_LAW[sharing])
        factors["law"] = law if sharing == BOTH else replace(law, log_bayes_factor=-law.log_bayes_factor)
    return Agreement(
        sharings=found,
        agreement=factors,
        said=_said(factors, row.outcome),
        alone={
            label: weighing(one, summaries(mode, one))
            for label, mode, one in zip(specimen.labels, modes, alone, strict=True)
        },
        repeats=populations(specimen.labels, modes, alone),
    )


def _weighed(mode: JointMode, chosen: float, seed: int) -> SharedEvidence:
    """The evidence of another sharing: by Laplace where that leaves no doubt.

    chosen: Laplace's log evidence of the one that was chosen.
    """
    look = mode.look()
    if abs(look - chosen) > FAR_APART:
        return SharedEvidence(look)
    found = weigh(mode, seed, ASIDE_DRAWS)
    return SharedEvidence(found.log_evidence, found.stderr, found.outcome)


def _summed(alone: Sequence[Weighed]) -> SharedEvidence:
    poor = [one.outcome for one in alone if one.outcome != OK]
    return SharedEvidence(
        float(sum(one.log_evidence for one in alone)),
        float(np.sqrt(sum(one.stderr**2 for one in alone))),
        poor[0] if poor else OK,
    )


def _factor(found: Mapping[str, SharedEvidence], one: str, other: str) -> BayesFactor:
    """Log Bayes factor of one sharing against another, its standard error, and whether it may be trusted."""
    first, second = found[one], found[other]
    if first.log_evidence is None or second.log_evidence is None:
        return BayesFactor(float("nan"), outcome=second.outcome)
    poor = [e.outcome for e in (first, second) if e.outcome != OK]
    return BayesFactor(
        first.log_evidence - second.log_evidence,
        float(np.hypot(first.stderr, second.stderr)),
        poor[0] if poor else OK,
    )


def chance_of(joint: JointMode, free: Sequence[JointMode], parameters: int) -> float:
    """The probability that records of one damping are fitted so much better by one for each (likelihood ratio, χ²).

    It needs no prior. Evidence alone calls records alike that are not: one damping for each has a prior that leaves
    each any size, and what that costs outweighs a common value that lies outside of all their intervals. joint, free:
    modes with a common damping and with one for each record. NaN where the latter were not found.
    """
    if not free:
        return float("nan")
    better = sum(map(_height, free)) - _height(joint)
    return float(chdtrc((len(joint.joint.records) - 1) * parameters, 2 * max(better, 0.0)))


def _height(mode: JointMode) -> float:
    """The records' log likelihood at a mode."""
    each = zip(mode.local, mode.joint.split(mode.x), strict=True)
    return sum(float(local.log_likelihood(z[None])[0]) for local, z in each)


def _said(factors: Mapping[str, BayesFactor], trust: str) -> dict[str, str]:
    """The same in words, and what stands as the outcome of the joint fit."""
    said = {name: verdict(name, f) for name, f in factors.items()}
    for name, factor in factors.items():
        if factor.outcome != OK:
            said[name] += f" ({factor.outcome})"
    disagree = disagrees(factors["damping"])
    return {**said, "outcome": said["damping"] if disagree and trust == OK else trust}


def disagrees(one_for_all: BayesFactor) -> bool:
    """Whether records disagree with one damping."""
    return one_for_all.log_bayes_factor < -CLEAR or one_for_all.chance < UNLIKELY


def verdict(what: str, factor: BayesFactor) -> str:
    """What the evidence of a shared damping (or law) against one for each record says, and their fit."""
    log_bayes_factor = factor.log_bayes_factor
    name = {"damping": "damping", "law": "restoring law"}[what]
    shown = f"log Bayes factor {log_bayes_factor:+.1f}".replace("-", "−")
    if not np.isfinite(log_bayes_factor):
        return f"whether the records have one {name} was not decided"
    if log_bayes_factor >= -CLEAR and factor.chance < UNLIKELY:
        return (
            f"the records differ in their {name}: had they one, chance would set them so far apart with a probability "
            f"of {factor.chance:.1g}, and the joint interval is too narrow"
        )
    if factor.clear:
        return f"the records agree with one {name} ({shown} against one for each)"
    if log_bayes_factor > -CLEAR:
        return f"the records leave open whether they have one {name} ({shown} against one for each)"
    if what == "law":
        return f"the records differ in their restoring law ({shown}): each has its own"
    return (
        f"the records disagree: one damping is far less probable than one for each ({shown}), "
        "and the joint interval is too narrow"
    )


def populations(
    labels: Sequence[str], modes: Sequence[JointMode], found: Sequence[Weighed]
) -> dict[str, PopulationFound]:
    """The population of each damping coefficient over what the labels name, from draws of each."""
    arrays = [draws_of("", mode, one) for mode, one in zip(modes, found, strict=True)]
    records = [mode.joint.records[0] for mode in modes]
    coefficients = [n for n in records[0].oscillator.coefficients if f"/{n}" in arrays[0]]
    rows = {}
    for name in coefficients:
        scale = common_scale([float(r.priors[name].value(1.0)) for r in records])
        samples = [
            Sample(label, a[f"/{name}"], a["/log_weights"], a[f"/{name}/log_prior"])
            for label, a in zip(labels, arrays, strict=True)
        ]
        rows[name] = PopulationFound(scale, **vars(population(samples, scale)))
    return rows


def common_scale(scales: Sequence[float]) -> float:
    """The geometric mean of the scales of a coefficient's priors."""
    return float(np.exp(np.mean(np.log(scales))))
