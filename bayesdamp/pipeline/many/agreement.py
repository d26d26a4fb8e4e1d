"""Whether the records of a specimen agree with one damping: evidence with and without it, and each record alone."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from bayesdamp.inference.many.hierarchy import Population, Sample, population
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
    weighed_meta,
)
from bayesdamp.types import OK, Refusal

CLEAR = 3.0
"""Nats of a log Bayes factor from which something is said to be so: odds of twenty."""
WITHOUT = {BOTH: LAW, DAMPING: NOTHING}
"""What is shared once each record has a damping of its own."""
ASIDE_DRAWS = 1000
"""For a sharing of which nothing but the evidence is asked."""
FAR_APART = 30.0
"""Nats by which another sharing is so far off that Laplace's evidence of it will do: it is a few off at most."""
OTHER_LAW = {BOTH: DAMPING, DAMPING: BOTH}


def agreement(
    specimen: Specimen, candidate: str, problem: Problem, sharing: str, row: Mapping[str, Any]
) -> dict[str, Any]:
    """What a joint cell says of its best candidate: evidence by what is shared, in words, and each record alone.

    row: of this candidate under the sharing that was chosen. Raises Refusal where a record has no fit of its own.
    """
    modes = [problem.alone(j) for j in range(len(problem.targets))]
    alone = [
        weigh(mode, specimen.seed(candidate, label))
        for mode, label in zip(modes, specimen.labels, strict=True)
    ]
    found = {sharing: dict(row), NOTHING: _summed(alone)}

    def seed(what: str) -> int:
        return specimen.seed(candidate, what)

    for other in (BOTH, DAMPING, LAW) if problem.names(LAW) else (DAMPING,):
        if other != sharing:
            try:
                found[other] = _weighed(problem.mode(problem.names(other)), row["look"], seed(other))
            except Apart as apart:
                cost = found[NOTHING]["log_evidence"] - apart.nats
                found[other] = {"log_evidence": cost, "stderr": float("nan"), "outcome": OK}
            except Refusal as refusal:
                found[other] = {"outcome": str(refusal)}
    factors = {"damping": _factor(found, sharing, WITHOUT[sharing])}
    if problem.names(LAW):
        law = _factor(found, sharing, OTHER_LAW[sharing])
        factors["law"] = law if sharing == BOTH else {**law, "log_bayes_factor": -law["log_bayes_factor"]}
    kept = ("log_evidence", "stderr", "outcome")
    return {
        "sharings": {s: {k: v for k, v in one.items() if k in kept} for s, one in found.items()},
        "agreement": factors,
        "said": _said(factors, row["outcome"]),
        "alone": {
            label: {**weighed_meta(one), "summary": summaries(mode, one)}
            for label, mode, one in zip(specimen.labels, modes, alone, strict=True)
        },
        "repeats": populations(specimen.labels, modes, alone),
    }


def _weighed(mode: JointMode, chosen: float, seed: int) -> dict[str, Any]:
    """The evidence of another sharing: by Laplace where that leaves no doubt.

    chosen: Laplace's log evidence of the one that was chosen.
    """
    look = mode.look()
    if abs(look - chosen) > FAR_APART:
        return {"log_evidence": look, "stderr": float("nan"), "outcome": OK}
    return weighed_meta(weigh(mode, seed, ASIDE_DRAWS))


def _summed(alone: Sequence[Weighed]) -> dict[str, Any]:
    poor = [one.outcome for one in alone if one.outcome != OK]
    return {
        "log_evidence": float(sum(one.log_evidence for one in alone)),
        "stderr": float(np.sqrt(sum(one.stderr**2 for one in alone))),
        "outcome": poor[0] if poor else OK,
    }


def _factor(found: Mapping[str, Mapping[str, Any]], one: str, other: str) -> dict[str, Any]:
    """Log Bayes factor of one sharing against another, its standard error, and whether it may be trusted."""
    pair = [found[one], found[other]]
    if any("log_evidence" not in e for e in pair):
        return {"log_bayes_factor": float("nan"), "stderr": float("nan"), "outcome": pair[1]["outcome"]}
    poor = [e["outcome"] for e in pair if e["outcome"] != OK]
    return {
        "log_bayes_factor": pair[0]["log_evidence"] - pair[1]["log_evidence"],
        "stderr": float(np.hypot(pair[0]["stderr"], pair[1]["stderr"])),
        "outcome": poor[0] if poor else OK,
    }


def _said(factors: Mapping[str, Mapping[str, Any]], trust: str) -> dict[str, str]:
    """The same in words, and what stands as the outcome of the joint fit."""
    said = {name: verdict(name, f["log_bayes_factor"]) for name, f in factors.items()}
    for name, factor in factors.items():
        if factor["outcome"] != OK:
            said[name] += f" ({factor['outcome']})"
    disagree = factors["damping"]["log_bayes_factor"] < -CLEAR
    return {**said, "outcome": said["damping"] if disagree and trust == OK else trust}


def verdict(what: str, log_bayes_factor: float) -> str:
    """What a log Bayes factor of a shared damping (or law) against one for each record says."""
    name = {"damping": "damping", "law": "restoring law"}[what]
    shown = f"log Bayes factor {log_bayes_factor:+.1f}".replace("-", "−")
    if not np.isfinite(log_bayes_factor):
        return f"whether the records have one {name} was not decided"
    if log_bayes_factor >= CLEAR:
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
) -> dict[str, dict[str, Any]]:
    """The population of each damping coefficient over what the labels name, from draws of each."""
    arrays = [draws_of("", mode, one) for mode, one in zip(modes, found, strict=True)]
    targets = [mode.joint.targets[0] for mode in modes]
    coefficients = [n for n in targets[0].oscillator.coefficients if f"/{n}" in arrays[0]]
    rows = {}
    for name in coefficients:
        scale = common_scale([float(t.priors[name].value(1.0)) for t in targets])
        samples = [
            Sample(label, a[f"/{name}"], a["/log_weights"], a[f"/{name}/log_prior"])
            for label, a in zip(labels, arrays, strict=True)
        ]
        rows[name] = population_meta(population(samples, scale), scale)
    return rows


def common_scale(scales: Sequence[float]) -> float:
    """The geometric mean of the scales of a coefficient's priors."""
    return float(np.exp(np.mean(np.log(scales))))


def population_meta(found: Population, scale: float) -> dict[str, Any]:
    """What a cell holds of a population."""
    return {
        "scale": scale,
        "mean": dict(found.mean),
        "spread": dict(found.spread),
        "shrunk": {n: dict(s) for n, s in found.shrunk.items()},
        "effective": dict(found.effective),
        "outcome": found.outcome,
    }
