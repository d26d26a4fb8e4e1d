"""The four tables, from a run's cells."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any

import numpy as np

from bayesdamp.config import SignalSpec, Simulation, Study
from bayesdamp.outcomes import Status, status_of
from bayesdamp.physics.damping import TERMS
from bayesdamp.physics.restoring import LAWS
from bayesdamp.physics.symbols import parameter_unit
from bayesdamp.pipeline.candidates.averaging import probabilities
from bayesdamp.pipeline.candidates.weighing import evidence_by_method
from bayesdamp.pipeline.records.answering import SAMPLED, approximately, likelihood_of
from bayesdamp.pipeline.tables.run_info import run_info
from bayesdamp.pipeline.tables.specimen_tables import write_specimen_tables
from bayesdamp.pipeline.tables.verdicts import write_verdicts
from bayesdamp.store import TABLES, Store, write_json, write_table
from bayesdamp.store.contents import (
    AnswerContent,
    EstimateContent,
    ModeContent,
    PosteriorContent,
    SampledPosterior,
)
from bayesdamp.types import OK, candidate_name, candidate_parts
from bayesdamp.units import UNITS, quantity_unit

Row = dict[str, Any]

SMC = "smc"
"""The sampler and the evidence of sampled motions, under laws that hold approximately where they may."""


def write_tables(study: Study, store: Store) -> None:
    """All tables of a run and its run.json; rows in the order of signals, repeats and models.

    store: which sees no cells but those of this study.
    """
    makers = (_estimates, _posteriors, _evidence, _fits)
    for (name, columns), rows_of in zip(TABLES.items(), makers, strict=True):
        write_table(store.folder / name, columns, rows_of(study, store))
    write_specimen_tables(study, store)
    write_verdicts(study, store)
    write_json(store.folder / "run.json", run_info(study, store))


def _branches(
    study: Study, store: Store
) -> Iterator[tuple[SignalSpec, int, str, Row, SampledPosterior | None]]:
    """(signal, repeat, candidate's name, the columns that say which, its sampled motions)."""
    for spec, repeat in study.records:
        sampled = _sampled(store, spec, repeat)
        for name in study.compare(spec):
            yield spec, repeat, name, _head(spec, repeat, name), sampled.get(name)


def _head(spec: SignalSpec, repeat: int, name: str) -> Row:
    damping, law = candidate_parts(name)
    return {
        "signal": spec.name,
        "repeat": repeat,
        "model": damping,
        "restoring": law or spec.restoring[0],
    }


def _unit(spec: SignalSpec, name: str, restoring: str) -> str:
    return parameter_unit(name, restoring, UNITS[spec.source.unit].base, spec.source.quantity)


def _truth(spec: SignalSpec, name: str, restoring: str) -> float:
    """The true value of a simulated record's parameter; an absent damping term's is 0. The parameters of another
    restoring law have none."""
    if not isinstance(spec.source, Simulation):
        return math.nan
    if restoring != spec.system.restoring and name in LAWS.get(restoring).parameters:
        return math.nan
    truth = {**spec.system.known, **spec.source.truth}
    damps = any(TERMS.get(term).parameter == name for term in TERMS.present())
    return float(truth.get(name, 0.0 if damps else math.nan))


def _estimates(study: Study, store: Store) -> Iterator[Row]:
    for spec, repeat, model, head, _ in _branches(study, store):
        for method in study.estimators.use:
            cell = store.find(f"estimate/{spec.name}/{repeat}/{model}/{method}")
            if cell is None:
                continue
            if cell.outcome != OK:
                yield {**head, "estimator": method, "outcome": cell.outcome}
            for stage in EstimateContent.of(cell).stages:
                common = {**head, "estimator": method, "stage": stage.stage, "outcome": stage.outcome}
                common |= {"evaluations": stage.evaluations, "seconds": stage.seconds}
                if not stage.values:
                    yield common
                for name, value in stage.values.items():
                    truth = _truth(spec, name, head["restoring"])
                    error = 100 * abs(value - truth) / abs(truth) if truth else math.nan
                    yield {
                        **common,
                        "parameter": name,
                        "unit": _unit(spec, name, head["restoring"]),
                        "value": value,
                        "stderr": stage.stderr.get(name, math.nan),
                        "truth": truth,
                        "error_pct": error,
                    }


def _posteriors(study: Study, store: Store) -> Iterator[Row]:
    for spec, repeat, model, head, one in _branches(study, store):
        for sampler in study.posterior.samplers:
            cell = store.find(f"posterior/{spec.name}/{repeat}/{model}/{sampler}")
            if cell is None:
                continue
            common = {**head, "sampler": sampler, "seconds": cell.seconds, "outcome": cell.outcome}
            common["deviation"] = likelihood_of(study)
            content = PosteriorContent.of(cell)
            if not content.summary:
                yield common
            common["divergences"] = content.posterior.divergences
            for name, s in content.summary.items():
                yield {**common, "parameter": name, "unit": content.units[name], **s}
        for name, s in (one.parameters if one else {}).items():
            unit = _unit(spec, name, head["restoring"])
            said = {"deviation": _answers(study, spec), "parameter": name, "unit": unit}
            yield {**head, "sampler": SMC, **said, **s, "outcome": OK}


def _answers(study: Study, spec: SignalSpec) -> str:
    """Under which likelihood a record was answered: "law" or "none"."""
    return "law" if approximately(study, spec) else "none"


def _sampled(store: Store, spec: SignalSpec, repeat: int) -> dict[str, SampledPosterior]:
    """What sampled motions say of a record's candidates, by their names."""
    cell = store.find(f"{SAMPLED}/{spec.name}/{repeat}")
    if cell is None or cell.outcome != OK:
        return {}
    many = len(spec.restoring) > 1
    return {
        candidate_name(one.damping, one.restoring) if many else one.damping: one
        for one in AnswerContent.of(cell).posteriors
    }


def _evidence(study: Study, store: Store) -> Iterator[Row]:
    for spec, repeat in study.records:
        models = study.compare(spec)
        by_method = evidence_by_method(study, store, f"{spec.name}/{repeat}", models)
        every = [(m, e) for found in by_method.values() for m, e in found.items()]
        weighed = {
            m for m, e in every if np.isfinite(e.log_evidence) or status_of(e.outcome) is Status.PRUNED
        }
        for method, found in by_method.items():
            logs = {m: e.log_evidence for m, e in found.items()}
            lost = [m for m, e in found.items() if m not in weighed and e.outcome != OK]
            aside = [m for m, e in found.items() if status_of(e.outcome) is Status.PRUNED]
            finite = [v for v in logs.values() if np.isfinite(v)]
            best = max(finite, default=math.nan)
            shares = probabilities(found)
            for model, one in found.items():
                share = 0.0 if model in aside else shares.get(model, math.nan)
                yield {
                    **_head(spec, repeat, model),
                    "method": method,
                    "deviation": likelihood_of(study),
                    "log_evidence": one.log_evidence,
                    "stderr": one.stderr,
                    "log_bayes_factor": one.log_evidence - best,
                    # every model of the comparison must have its evidence, or be far behind, before it has a share;
                    # one that no method could weigh has none, and leaves the others theirs
                    "probability": share if len(finite) + len(aside) + len(lost) == len(models) else math.nan,
                    "diagnostic": one.diagnostic,
                    "outcome": one.outcome,
                }
        sampled = _sampled(store, spec, repeat)
        top = max((one.log_evidence for one in sampled.values()), default=math.nan)
        for model, one in sampled.items():
            yield {
                **_head(spec, repeat, model),
                "method": SMC,
                "deviation": _answers(study, spec),
                "log_evidence": one.log_evidence,
                "stderr": one.stderr,
                "log_bayes_factor": one.log_evidence - top,
                "probability": math.nan,
                "diagnostic": f"{one.temperatures} temperatures, acceptance {one.acceptance:.2f}",
                "outcome": OK,
            }


def _fits(study: Study, store: Store) -> Iterator[Row]:
    for spec, repeat, model, head, one in _branches(study, store):
        cell = store.find(f"mode/{spec.name}/{repeat}/{model}")
        row = dict(head)
        if one is not None:
            names = ("deviation_low", "deviation", "deviation_high")
            row |= dict(zip(names, one.deviation, strict=True))
            row["unexplained_pct"] = 100 * one.unexplained
        if cell is not None and cell.outcome == OK:
            factor = 1.0 / UNITS[spec.source.unit].factor
            mode = ModeContent.of(cell)
            row |= {"rms": mode.rms * factor}
            row |= {"rms_unit": quantity_unit(spec.source.unit, spec.source.quantity)}
            kept = ("residual_autocorrelation", "window_spread", "predictive_p", "verdict")
            row |= {k: getattr(mode, k) for k in kept}
        elif cell is not None:
            row["verdict"] = cell.outcome
        if cell is not None or one is not None:
            yield row
