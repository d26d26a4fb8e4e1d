"""The tables of a run, its verdicts and its run.json, from its cells."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np

from bayesdamp.config import Recording, SignalSpec, Simulation, Study
from bayesdamp.config.load import record_question
from bayesdamp.config.signals import damping_order
from bayesdamp.numerics.weights import summarise
from bayesdamp.outcomes import Status, status_of
from bayesdamp.physics.damping import TERMS
from bayesdamp.physics.oscillator import Oscillator
from bayesdamp.physics.restoring import LAWS
from bayesdamp.physics.symbols import parameter_unit
from bayesdamp.pipeline.answering import (
    ANSWERED,
    SAMPLED,
    answer_cell,
    answer_of,
    answered_of,
    is_approximate,
    likelihood_of,
    stated_priors,
)
from bayesdamp.pipeline.candidates.weighing import evidence_by_method, probabilities
from bayesdamp.pipeline.specimens import Specimen, coefficients_of
from bayesdamp.pipeline.tasks import cell_seed
from bayesdamp.store import (
    DAMPING_CURVES,
    SPECIMEN_TABLES,
    TABLES,
    CellResult,
    Store,
    provenance,
    write_json,
    write_table,
)
from bayesdamp.store.contents import (
    AnswerContent,
    EstimateContent,
    JointContent,
    ModeContent,
    PopulationContent,
    PosteriorContent,
    RecordContent,
    SampledPosterior,
    Summary,
    WeighingContent,
)
from bayesdamp.store.files import SCHEMA
from bayesdamp.types import OK, Evidence, candidate_name, candidate_parts
from bayesdamp.units import UNITS, Unit, quantity_unit, unit_named
from bayesdamp.verdict.specimen import specimen
from bayesdamp.verdict.types import Verdict, save_verdicts
from bayesdamp.verdict.units import in_unit, picture_in_unit

Row = dict[str, Any]

SMC = "smc"
"""The sampler and the evidence of sampled motions, under laws that hold approximately where they may."""
SUMMARY = ("mean", "sd", "median", "q2.5", "q97.5")


def write_tables(study: Study, store: Store) -> None:
    """Write all tables of a run and its run.json; rows in the order of signals, repeats and models.

    store: in which only the cells of this study are visible.
    """
    makers = (_estimates, _posteriors, _evidence, _fits)
    for (name, columns), rows_of in zip(TABLES.items(), makers, strict=True):
        write_table(store.folder / name, columns, rows_of(study, store))
    if study.specimens:
        for (name, columns), rows_of in zip(SPECIMEN_TABLES.items(), (_specimens, _populations), strict=True):
            write_table(store.folder / name, columns, rows_of(study, store))
    write_json(store.folder / "run.json", run_info(study, store))


def write_verdicts(study: Study, store: Store) -> None:
    """Write verdict.json, verdicts.csv and damping_curves.csv, where a record has a verdict.

    They have an object, a line and a curve for each record with a verdict. verdict.json is in rad, m or the sensor's
    unit; lines have the unit of the record's file, which they state.
    """
    verdicts: list[tuple[Verdict, Unit]] = []
    curves: list[Row] = []  # without a law, a row for each amplitude
    for spec, repeat in study.records:
        answer, unit = answer_of(store, spec.name, repeat), unit_named(spec.source.unit)
        if answer is None:
            continue
        verdicts.append((answer.verdict, unit))
        if "free/amplitude" in answer.arrays:
            arrays = picture_in_unit(answer.arrays, unit)
            head = {"record": answer.verdict.record, "unit": unit.displacement.name}
            rows = zip(*(arrays[f"free/{name}"].tolist() for name in DAMPING_CURVES), strict=True)
            curves += [{**head, **dict(zip(DAMPING_CURVES, row, strict=True))} for row in rows]
    for name, specs in study.every_specimen.items():
        together = _specimen_verdict(study, store, name, specs)
        if together is not None:
            units = {unit_named(spec.source.unit) for spec in specs}
            base = unit_named(unit_named(specs[0].source.unit).base)
            verdicts.append((together, units.pop() if len(units) == 1 else base))
    if not verdicts:
        return
    save_verdicts(store.folder, [v for v, _ in verdicts], [in_unit(v, unit) for v, unit in verdicts])
    write_table(store.folder / "damping_curves.csv", ("record", "unit", *DAMPING_CURVES), curves)


def _specimen_verdict(study: Study, store: Store, name: str, specs: Sequence[SignalSpec]) -> Verdict | None:
    """Return the verdict on a specimen; None where fewer than two of its records have an answer."""
    if sum(spec.repeats for spec in specs) < 2:
        return None
    if specs[0].is_envelope:
        from bayesdamp.interface.envelopes import specimen_of_envelopes  # imports slowly

        envelopes = (answer_of(store, spec.name, 0) for spec in specs)
        return specimen_of_envelopes(name, [a for a in envelopes if a is not None])
    every = (answered_of(store, spec.name, repeat) for spec in specs for repeat in range(spec.repeats))
    answered = [a for a in every if a is not None]
    if len(answered) < 2:
        return None
    seed = cell_seed(study, f"specimen/{name}")
    return specimen(name, answered, stated_priors(study), study.posterior.sensor, seed)


def _branches(study: Study, store: Store) -> Iterator[tuple[SignalSpec, str, Row, SampledPosterior | None]]:
    """Iterate over signal, `SIGNAL/REPEAT/CANDIDATE`, the columns that name it, and the candidate's sampled motions."""
    for spec, repeat in study.records:
        sampled = _sampled(store, spec, repeat)
        for name in study.compare(spec):
            yield spec, f"{spec.name}/{repeat}/{name}", _head(spec, repeat, name), sampled.get(name)


def _head(spec: SignalSpec, repeat: int, name: str) -> Row:
    damping, law = candidate_parts(name)
    law = law or spec.restoring[0]
    return {"signal": spec.name, "repeat": repeat, "model": damping, "restoring": law}


def _unit(spec: SignalSpec, name: str, restoring: str) -> str:
    return parameter_unit(name, restoring, UNITS[spec.source.unit].base, spec.source.quantity)


def _truth(spec: SignalSpec, name: str, restoring: str) -> float:
    """Return the true value of a simulated record's parameter; that of a damping term which it lacks is 0.

    The parameters of another restoring law have none.
    """
    if not isinstance(spec.source, Simulation):
        return math.nan
    if restoring != spec.system.restoring and name in LAWS.get(restoring).parameters:
        return math.nan
    truth = {**spec.system.known, **spec.source.truth}
    damps = any(TERMS.get(term).parameter == name for term in TERMS.present())
    return float(truth.get(name, 0.0 if damps else math.nan))


def _sampled(store: Store, spec: SignalSpec, repeat: int) -> dict[str, SampledPosterior]:
    """Return the sampled motions of a record's candidates, by their names."""
    cell = store.find(f"{SAMPLED}/{spec.name}/{repeat}", arrays=False)
    if cell is None or cell.outcome != OK:
        return {}
    many = len(spec.restoring) > 1
    return {
        candidate_name(p.damping, p.restoring) if many else p.damping: p
        for p in AnswerContent.of(cell).posteriors
    }


def _deviation(study: Study, spec: SignalSpec) -> str:
    """Return the likelihood of a record's answer: "law" or "none"."""
    return "law" if is_approximate(study, spec) else "none"


def _estimates(study: Study, store: Store) -> Iterator[Row]:
    for spec, path, head, _ in _branches(study, store):
        for method in study.estimators.use:
            cell = store.find(f"estimate/{path}/{method}", arrays=False)
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
                    yield {
                        **common,
                        "parameter": name,
                        "unit": _unit(spec, name, head["restoring"]),
                        "value": value,
                        "stderr": stage.stderr.get(name, math.nan),
                        "truth": truth,
                        "error_pct": 100 * abs(value - truth) / abs(truth) if truth else math.nan,
                    }


def _posteriors(study: Study, store: Store) -> Iterator[Row]:
    for spec, path, head, motions in _branches(study, store):
        for sampler in study.posterior.samplers:
            cell = store.find(f"posterior/{path}/{sampler}", arrays=False)
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
        common = {**head, "sampler": SMC, "deviation": _deviation(study, spec), "outcome": OK}
        for name, s in (motions.parameters if motions else {}).items():
            yield {**common, "parameter": name, "unit": _unit(spec, name, head["restoring"]), **s}


def _evidence(study: Study, store: Store) -> Iterator[Row]:
    for spec, repeat in study.records:
        models = study.compare(spec)
        by_method = evidence_by_method(study, store, f"{spec.name}/{repeat}", models)
        every = [(m, e) for by_model in by_method.values() for m, e in by_model.items()]
        weighed = {
            m for m, e in every if np.isfinite(e.log_evidence) or status_of(e.outcome) is Status.PRUNED
        }
        for method, by_model in by_method.items():
            lost = [m for m, e in by_model.items() if m not in weighed and e.outcome != OK]
            pruned = [m for m, e in by_model.items() if status_of(e.outcome) is Status.PRUNED]
            finite = [e.log_evidence for e in by_model.values() if np.isfinite(e.log_evidence)]
            best = max(finite, default=math.nan)
            # Models have a share once every model of the comparison has its evidence or is far behind. A model that no
            # method could weigh has none, and the others keep theirs.
            is_complete = len(finite) + len(pruned) + len(lost) == len(models)
            shares = {**probabilities(by_model), **dict.fromkeys(pruned, 0.0)} if is_complete else {}
            for model, evidence in by_model.items():
                row = _evidence_row(evidence, likelihood_of(study), best, shares.get(model, math.nan))
                yield {**_head(spec, repeat, model), "method": method, **row}
        sampled = _sampled(store, spec, repeat)
        best = max((motions.log_evidence for motions in sampled.values()), default=math.nan)
        for model, motions in sampled.items():
            diagnostic = f"temperatures: {motions.temperatures}, acceptance {motions.acceptance:.2f}"
            evidence = Evidence(model, SMC, motions.log_evidence, motions.stderr, diagnostic)
            row = _evidence_row(evidence, _deviation(study, spec), best, math.nan)
            yield {**_head(spec, repeat, model), "method": SMC, **row}


def _evidence_row(evidence: Evidence, deviation: str, best: float, probability: float) -> Row:
    return {
        "deviation": deviation,
        "log_evidence": evidence.log_evidence,
        "stderr": evidence.stderr,
        "log_bayes_factor": evidence.log_evidence - best,
        "probability": probability,
        "diagnostic": evidence.diagnostic,
        "outcome": evidence.outcome,
    }


def _fits(study: Study, store: Store) -> Iterator[Row]:
    for spec, path, head, motions in _branches(study, store):
        cell = store.find(f"mode/{path}", arrays=False)
        if cell is None and motions is None:
            continue
        row = dict(head)
        if motions is not None:
            names = ("deviation_low", "deviation", "deviation_high")
            row |= dict(zip(names, motions.deviation, strict=True))
            row["unexplained_pct"] = 100 * motions.unexplained
        if cell is not None and cell.outcome == OK:
            factor = 1.0 / UNITS[spec.source.unit].factor
            mode = ModeContent.of(cell)
            row["rms"] = mode.rms * factor
            row["rms_unit"] = quantity_unit(spec.source.unit, spec.source.quantity)
            for name in ("residual_autocorrelation", "window_spread", "predictive_p", "verdict"):
                row[name] = getattr(mode, name)
        elif cell is not None:
            row["verdict"] = cell.outcome
        yield row


def _specimen_model(own: Specimen, candidate: str) -> Row:
    damping, law = candidate_parts(candidate)
    return {"model": damping, "restoring": law or own.specs[0].restoring[0]}


def _specimens(study: Study, store: Store) -> Iterator[Row]:
    population = PopulationContent.maybe(store.find("population/specimens"))
    for label, specs in study.specimens.items():
        own = Specimen(study, label, specs, store)
        head = {"specimen": label, "records": len(own.records)}
        cell = store.find(f"joint/{label}")
        joint = JointContent.maybe(cell)
        if joint is not None:
            for candidate, row in joint.candidates.items():
                common = {**head, **_specimen_model(own, candidate)}
                yield from _weighed_rows({**common, "shared": "damping", "probability": row.probability}, row)
                if candidate == joint.best:
                    for record, alone in joint.alone.items():
                        yield from _weighed_rows({**common, "record": record}, alone)
        elif cell is not None:
            yield {**head, "outcome": cell.outcome}
        elif population is not None and label in population.specimens:
            row = population.specimens[label]
            common = {**head, **_specimen_model(own, population.best), "record": own.labels[0]}
            yield from _weighed_rows({**common, "probability": row.probability}, row)


def _weighed_rows(head: Row, row: WeighingContent) -> Iterator[Row]:
    common = {**head, "outcome": row.outcome}
    if row.log_evidence is not None:
        common["log_evidence"] = row.log_evidence
    if not row.summary:
        yield common
    for name, summary in row.summary.items():
        yield {**common, "parameter": name, "unit": row.units[name], **_numbers(summary)}


def _numbers(summary: Summary) -> Row:
    return {k: summary[k] for k in SUMMARY}


def _populations(study: Study, store: Store) -> Iterator[Row]:
    for label, specs in study.specimens.items():
        cell = store.find(f"joint/{label}")
        joint = JointContent.maybe(cell)
        if cell is not None and joint is not None:
            own, row = Specimen(study, label, specs, store), joint.candidates[joint.best]
            head = {**_specimen_model(own, joint.best), "over": f"repeats of {label}", "outcome": OK}
            for name, draws in coefficients_of(cell.arrays, joint.best).items():
                between = draws * cell.arrays[f"{joint.best}/spread"]
                spread = summarise(between, np.full(draws.size, 1 / draws.size))
                common = {**head, "parameter": name, "unit": row.units[name]}
                yield {**common, "what": "mean", **_numbers(row.summary[name])}
                yield {**common, "what": "spread", **_numbers(spread)}
                for record, alone in joint.alone.items():
                    yield {**common, "what": "own value", "of": record, **_numbers(alone.summary[name])}
    cell = store.find("population/specimens")
    if cell is None:
        return
    content = PopulationContent.maybe(cell)
    if content is None:
        yield {"over": "specimens", "outcome": cell.outcome}
        return
    first, specs = next(iter(study.specimens.items()))
    head = {**_specimen_model(Specimen(study, first, specs, store), content.best), "over": "specimens"}
    head["outcome"] = cell.outcome
    for name, coefficient in content.populations.items():
        common = {**head, "parameter": name, "unit": content.units[name], "prior_scale": coefficient.scale}
        yield {**common, "what": "mean", **_numbers(coefficient.mean)}
        yield {**common, "what": "spread", **_numbers(coefficient.spread)}
        for label, summary in coefficient.shrunk.items():
            own = {**_numbers(summary), "effective": coefficient.effective[label]}
            yield {**common, "what": "own value", "of": label, **own}


def run_info(study: Study, store: Store) -> Row:
    """Return the content of a run's run.json, from its cells."""
    files = {s.source.file: s.source.path for s in study.signals if isinstance(s.source, Recording)}
    about: dict[str, Row] = {}
    priors, budget = {}, {}
    assumed: dict[str, None] = {}
    for spec in study.signals:
        if spec.is_envelope:
            answered = store.find(f"{ANSWERED}/{spec.name}/0", arrays=False)
            content = AnswerContent.maybe(answered)
            if answered and content and content.envelope:
                unit, outcome = content.envelope.unit, answered.outcome
                about[spec.name] = {"quantity": "envelope", "unit": unit, "outcome": outcome}
                assumed |= dict.fromkeys(content.envelope.assumed)
            continue
        cell = store.find(f"signal/{spec.name}/0", arrays=False)
        if cell is None:
            continue
        # Where the first repeat shows no oscillation, another one may.
        oscillating = _first_oscillating(store, spec) or cell
        answer = AnswerContent.maybe(store.find(f"{ANSWERED}/{spec.name}/0", arrays=False))
        content = RecordContent.of(cell)
        about[spec.name] = {
            **content.provenance,
            "unit": spec.source.unit,
            "quantity": spec.source.quantity,
            "simulated": isinstance(spec.source, Simulation),
            "restoring": list(spec.restoring),
            "outcome": oscillating.outcome,
            "bound": dict(content.bound),
        }
        if answer and len(answer.noises) > 1:
            about[spec.name]["noise"] = answer.noise
        if oscillating.outcome == OK:
            known = RecordContent.of(oscillating)
            about[spec.name] |= {"epsilon_note": known.epsilon_note, "reference": known.scales}
            about[spec.name]["features"] = known.features
        cells = {m: store.find(f"mode/{spec.name}/0/{m}", arrays=False) for m in study.compare(spec)}
        modes = {m: ModeContent.of(c) if c.outcome == OK else None for m, c in cells.items() if c}
        priors[spec.name] = {m: dict(mode.priors) if mode else {} for m, mode in modes.items()}
        budget[spec.name] = {m: dict(mode.error_budget) if mode else {} for m, mode in modes.items()}
        if not modes:  # only the answer weighed candidates
            answered = answer_cell(store, spec.name, 0)
            many = len(spec.restoring) > 1
            priors[spec.name] = {
                candidate_name(c.damping, c.restoring) if many else c.damping: dict(c.priors)
                for c in (AnswerContent.of(answered).priors if answered else ())
            }
    # The damping terms that the study compares or simulates.
    names = {t for s in study.signals for m in study.dampings(s) for t in m.split("+")}
    names |= {t for s in study.signals if isinstance(s.source, Simulation) for t in s.source.damping}
    terms = {name: TERMS.get(name) for name in damping_order() if name in names}
    models = [*study.models.compare, *(m for s in study.signals for m in study.compare(s))]
    laws = dict.fromkeys(law for s in study.signals for law in s.restoring)
    return {
        "name": study.name,
        "description": study.description,
        "seed": study.seed,
        "study": study.resolved(),
        "asked": record_question(study, store.folder),
        "schema": SCHEMA,
        **provenance(files),
        "seconds": {n: c.seconds for n in store.names() if (c := store.find(n, arrays=False))},
        "cells": dict(store.only or {}),
        "signals": about,
        "priors": priors,
        **({"assumed": list(assumed)} if assumed else {}),
        "models": list(dict.fromkeys(models)),
        "damping": {
            n: {"parameter": t.parameter, "unit": t.unit, "force": t.formula} for n, t in terms.items()
        },
        "restoring": {law: LAWS.get(law).formula for law in laws},
        "error_budget": budget,
        "equilibrium": {s.name: _equilibrium(s, store) for s in study.signals if not s.is_envelope},
    }


def _first_oscillating(store: Store, spec: SignalSpec) -> CellResult | None:
    """Return the first repeat of a signal that shows an oscillation."""
    cells = (store.find(f"signal/{spec.name}/{repeat}", arrays=False) for repeat in range(spec.repeats))
    return next((cell for cell in cells if cell and cell.outcome == OK), None)


def _equilibrium(spec: SignalSpec, store: Store) -> Row:
    """Return the derived equilibrium and natural frequency, where the whole restoring law is known."""
    cell = _first_oscillating(store, spec)
    oscillator = Oscillator(("viscous",), spec.system.restoring)
    shape = RecordContent.of(cell).features if cell is not None else None
    if shape is None or not all(n in spec.system.known for n in oscillator.law.parameters):
        return {}
    return {
        "equilibrium": oscillator.equilibrium(spec.system.known, shape.rest),
        "natural_frequency": oscillator.natural_frequency(spec.system.known, shape.rest),
    }
