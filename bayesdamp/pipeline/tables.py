"""Write the tables, the verdicts and the run.json of a run from its stored results."""

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
    ANSWER,
    SAMPLED_ANSWER,
    answer_of,
    answer_result,
    is_approximate,
    likelihood_of,
    specimen_input,
    stated_priors,
)
from bayesdamp.pipeline.candidates.evidence import evidence_by_method, probabilities
from bayesdamp.pipeline.specimens import Specimen, coefficients_of
from bayesdamp.pipeline.tasks import task_seed
from bayesdamp.store import (
    DAMPING_CURVES,
    SPECIMEN_TABLES,
    TABLES,
    Store,
    TaskResult,
    provenance,
    write_json,
    write_table,
)
from bayesdamp.store.contents import (
    AnswerContent,
    EstimateContent,
    JointContent,
    JointEvidence,
    ModeContent,
    PopulationContent,
    PosteriorContent,
    RecordContent,
    SampledPosterior,
    Summary,
)
from bayesdamp.store.files import SCHEMA
from bayesdamp.types import OK, Evidence, candidate_name, candidate_parts
from bayesdamp.units import UNITS, Unit, quantity_unit, unit_named
from bayesdamp.verdict.specimen import specimen
from bayesdamp.verdict.types import Verdict, save_verdicts
from bayesdamp.verdict.units import in_unit, picture_in_unit

Row = dict[str, Any]

SMC = "smc"
"""Name in the tables for sequential Monte Carlo, by which the sampled answer computes posteriors (column `sampler`) and
evidence (column `method`)."""
SUMMARY = ("mean", "sd", "median", "q2.5", "q97.5")


def write_tables(study: Study, store: Store) -> None:
    """Write all tables of a run and its run.json, with rows in the order of signals, repeats and models.

    store: a store that shows only the results of this study.
    """
    makers = (_estimates, _posteriors, _evidence, _fits)
    for (name, columns), rows_of in zip(TABLES.items(), makers, strict=True):
        write_table(store.folder / name, columns, rows_of(study, store))
    if study.specimens:
        for (name, columns), rows_of in zip(SPECIMEN_TABLES.items(), (_specimens, _populations), strict=True):
            write_table(store.folder / name, columns, rows_of(study, store))
    write_json(store.folder / "run.json", run_info(study, store))


def write_verdicts(study: Study, store: Store) -> None:
    """Write verdict.json, verdicts.csv and damping_curves.csv, if any record has a verdict.

    verdict.json has an object for each verdict, in rad, m or the sensor's unit. verdicts.csv has a row for each
    verdict, and damping_curves.csv the law-free damping curve of each record, both in the unit of the record's file.
    """
    verdicts: list[tuple[Verdict, Unit]] = []
    curves: list[Row] = []  # the law-free damping, a row for each amplitude
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
    """Return the verdict on a specimen; None if fewer than two of its records have an answer."""
    if sum(spec.repeats for spec in specs) < 2:
        return None
    if specs[0].is_envelope:
        from bayesdamp.interface.envelopes import specimen_of_envelopes  # imports slowly

        envelopes = (answer_of(store, spec.name, 0) for spec in specs)
        return specimen_of_envelopes(name, [a for a in envelopes if a is not None])
    every = (specimen_input(store, spec.name, repeat) for spec in specs for repeat in range(spec.repeats))
    answered = [a for a in every if a is not None]
    if len(answered) < 2:
        return None
    seed = task_seed(study, f"specimen/{name}")
    return specimen(name, answered, stated_priors(study), study.posterior.sensor, seed)


def _candidates(study: Study, store: Store) -> Iterator[tuple[SignalSpec, str, Row, SampledPosterior | None]]:
    """Iterate over all candidates on all records.

    Yields the signal, the path `SIGNAL/REPEAT/CANDIDATE`, the columns that name the candidate, and its posterior from
    the sampled answer (None without one).
    """
    for spec, repeat in study.records:
        sampled = _sampled_posteriors(store, spec, repeat)
        for name in study.compare(spec):
            yield spec, f"{spec.name}/{repeat}/{name}", _head(spec, repeat, name), sampled.get(name)


def _head(spec: SignalSpec, repeat: int, name: str) -> Row:
    """Return the columns that name a candidate on a record: signal, repeat, damping sum and restoring law."""
    damping, law = candidate_parts(name)
    law = law or spec.restoring[0]
    return {"signal": spec.name, "repeat": repeat, "model": damping, "restoring": law}


def _unit(spec: SignalSpec, name: str, restoring: str) -> str:
    """Return the unit of a parameter under a restoring law, for the base unit of the signal."""
    return parameter_unit(name, restoring, UNITS[spec.source.unit].base, spec.source.quantity)


def _truth(spec: SignalSpec, name: str, restoring: str) -> float:
    """Return the true value of a parameter of a simulated record.

    The true coefficient of a damping term that was not simulated is 0. NaN for a measured record, and for the
    parameters of a restoring law that was not simulated.
    """
    if not isinstance(spec.source, Simulation):
        return math.nan
    if restoring != spec.system.restoring and name in LAWS.get(restoring).parameters:
        return math.nan
    truth = {**spec.system.known, **spec.source.truth}
    damps = any(TERMS.get(term).parameter == name for term in TERMS.present())
    return float(truth.get(name, 0.0 if damps else math.nan))


def _sampled_posteriors(store: Store, spec: SignalSpec, repeat: int) -> dict[str, SampledPosterior]:
    """Return the posteriors in a record's sampled answer, by the name of the candidate."""
    result = store.find(f"{SAMPLED_ANSWER}/{spec.name}/{repeat}", arrays=False)
    if result is None or result.outcome != OK:
        return {}
    many = len(spec.restoring) > 1
    return {
        candidate_name(p.damping, p.restoring) if many else p.damping: p
        for p in AnswerContent.of(result).posteriors
    }


def _deviation(study: Study, spec: SignalSpec) -> str:
    """Return "law" if the answer on a record allows deviations from the laws, else "none"."""
    return "law" if is_approximate(study, spec) else "none"


def _estimates(study: Study, store: Store) -> Iterator[Row]:
    """Yield the rows of estimates.csv, which has a row without a parameter for a stage without values."""
    for spec, path, head, _ in _candidates(study, store):
        for method in study.estimators.use:
            result = store.find(f"estimate/{path}/{method}", arrays=False)
            if result is None:
                continue
            if result.outcome != OK:
                yield {**head, "estimator": method, "outcome": result.outcome}
            for stage in EstimateContent.of(result).stages:
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
    """Yield the rows of posteriors.csv: of each sampler of the study, then of the sampled answer (`SMC`)."""
    for spec, path, head, smc in _candidates(study, store):
        for sampler in study.posterior.samplers:
            result = store.find(f"posterior/{path}/{sampler}", arrays=False)
            if result is None:
                continue
            common = {**head, "sampler": sampler, "seconds": result.seconds, "outcome": result.outcome}
            common["deviation"] = likelihood_of(study)
            content = PosteriorContent.of(result)
            if not content.summary:
                yield common
            common["divergences"] = content.posterior.divergences
            for name, s in content.summary.items():
                yield {**common, "parameter": name, "unit": content.units[name], **s}
        common = {**head, "sampler": SMC, "deviation": _deviation(study, spec), "outcome": OK}
        for name, s in (smc.parameters if smc else {}).items():
            yield {**common, "parameter": name, "unit": _unit(spec, name, head["restoring"]), **s}


def _evidence(study: Study, store: Store) -> Iterator[Row]:
    """Yield the rows of evidence.csv: for each record, of each method in `evidence_by_method`, then of `SMC`."""
    for spec, repeat in study.records:
        models = study.compare(spec)
        by_method = evidence_by_method(study, store, f"{spec.name}/{repeat}", models)
        every = [(m, e) for by_model in by_method.values() for m, e in by_model.items()]
        with_evidence = {
            m for m, e in every if np.isfinite(e.log_evidence) or status_of(e.outcome) is Status.PRUNED
        }
        for method, by_model in by_method.items():
            lost = [m for m, e in by_model.items() if m not in with_evidence and e.outcome != OK]
            pruned = [m for m, e in by_model.items() if status_of(e.outcome) is Status.PRUNED]
            finite = [e.log_evidence for e in by_model.values() if np.isfinite(e.log_evidence)]
            best = max(finite, default=math.nan)
            # Probabilities need the evidence of every compared model, except those that were left out because they are
            # far behind, and those without evidence by any method: the latter get no probability.
            is_complete = len(finite) + len(pruned) + len(lost) == len(models)
            shares = {**probabilities(by_model), **dict.fromkeys(pruned, 0.0)} if is_complete else {}
            for model, evidence in by_model.items():
                row = _evidence_row(evidence, likelihood_of(study), best, shares.get(model, math.nan))
                yield {**_head(spec, repeat, model), "method": method, **row}
        sampled = _sampled_posteriors(store, spec, repeat)
        best = max((smc.log_evidence for smc in sampled.values()), default=math.nan)
        for model, smc in sampled.items():
            diagnostic = f"temperatures: {smc.temperatures}, acceptance {smc.acceptance:.2f}"
            evidence = Evidence(model, SMC, smc.log_evidence, smc.stderr, diagnostic)
            row = _evidence_row(evidence, _deviation(study, spec), best, math.nan)
            yield {**_head(spec, repeat, model), "method": SMC, **row}


def _evidence_row(evidence: Evidence, deviation: str, best: float, probability: float) -> Row:
    """Return the columns of a row of evidence.csv.

    Parameters
    ----------
    evidence
        The evidence of one candidate by one method.
    deviation
        "law" if it allows deviations from the laws, else "none".
    best
        Largest log evidence by the same method on the record.
    probability
        Posterior probability of the candidate by this method.
    """
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
    """Yield the rows of fits.csv, for candidates with a mode or a posterior in the sampled answer."""
    for spec, path, head, smc in _candidates(study, store):
        result = store.find(f"mode/{path}", arrays=False)
        if result is None and smc is None:
            continue
        row = dict(head)
        if smc is not None:
            names = ("deviation_low", "deviation", "deviation_high")
            row |= dict(zip(names, smc.deviation, strict=True))
            row["unexplained_pct"] = 100 * smc.unexplained
        if result is not None and result.outcome == OK:
            factor = 1.0 / UNITS[spec.source.unit].factor
            mode = ModeContent.of(result)
            row["rms"] = mode.rms * factor
            row["rms_unit"] = quantity_unit(spec.source.unit, spec.source.quantity)
            for name in ("residual_autocorrelation", "window_spread", "predictive_p", "verdict"):
                row[name] = getattr(mode, name)
        elif result is not None:
            row["verdict"] = result.outcome
        yield row


def _specimen_model(own: Specimen, candidate: str) -> Row:
    damping, law = candidate_parts(candidate)
    return {"model": damping, "restoring": law or own.specs[0].restoring[0]}


def _specimens(study: Study, store: Store) -> Iterator[Row]:
    """Yield the rows of specimens.csv.

    A specimen with several records has rows for each candidate of its joint fit, and for each single record under the
    best candidate. A specimen with one record has rows only if a population of specimens was inferred.
    """
    population = PopulationContent.maybe(store.find("population/specimens"))
    for label, specs in study.specimens.items():
        own = Specimen(study, label, specs, store)
        head = {"specimen": label, "records": len(own.records)}
        result = store.find(f"joint/{label}")
        joint = JointContent.maybe(result)
        if joint is not None:
            for candidate, row in joint.candidates.items():
                common = {**head, **_specimen_model(own, candidate)}
                yield from _parameter_rows(
                    {**common, "shared": "damping", "probability": row.probability}, row
                )
                if candidate == joint.best:
                    for record, alone in joint.alone.items():
                        yield from _parameter_rows({**common, "record": record}, alone)
        elif result is not None:
            yield {**head, "outcome": result.outcome}
        elif population is not None and label in population.specimens:
            row = population.specimens[label]
            common = {**head, **_specimen_model(own, population.best), "record": own.labels[0]}
            yield from _parameter_rows({**common, "probability": row.probability}, row)


def _parameter_rows(head: Row, row: JointEvidence) -> Iterator[Row]:
    """Yield rows of specimens.csv: one for each parameter with a summary, or one without a parameter if there is none.

    Each has the cells of `head`, and the outcome and log evidence of `row`.
    """
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
    """Yield the rows of population.csv, with mean, spread and single values of each damping coefficient.

    First come the rows on the records of each specimen, then those on all specimens.
    """
    for label, specs in study.specimens.items():
        result = store.find(f"joint/{label}")
        joint = JointContent.maybe(result)
        if result is not None and joint is not None:
            own, row = Specimen(study, label, specs, store), joint.candidates[joint.best]
            head = {**_specimen_model(own, joint.best), "over": f"repeats of {label}", "outcome": OK}
            for name, draws in coefficients_of(result.arrays, joint.best).items():
                between = draws * result.arrays[f"{joint.best}/spread"]
                spread = summarise(between, np.full(draws.size, 1 / draws.size))
                common = {**head, "parameter": name, "unit": row.units[name]}
                yield {**common, "what": "mean", **_numbers(row.summary[name])}
                yield {**common, "what": "spread", **_numbers(spread)}
                for record, alone in joint.alone.items():
                    yield {**common, "what": "own value", "of": record, **_numbers(alone.summary[name])}
    result = store.find("population/specimens")
    if result is None:
        return
    content = PopulationContent.maybe(result)
    if content is None:
        yield {"over": "specimens", "outcome": result.outcome}
        return
    first, specs = next(iter(study.specimens.items()))
    head = {**_specimen_model(Specimen(study, first, specs, store), content.best), "over": "specimens"}
    head["outcome"] = result.outcome
    for name, coefficient in content.populations.items():
        common = {**head, "parameter": name, "unit": content.units[name], "prior_scale": coefficient.scale}
        yield {**common, "what": "mean", **_numbers(coefficient.mean)}
        yield {**common, "what": "spread", **_numbers(coefficient.spread)}
        for label, summary in coefficient.shrunk.items():
            own = {**_numbers(summary), "effective": coefficient.effective[label]}
            yield {**common, "what": "own value", "of": label, **own}


def run_info(study: Study, store: Store) -> Row:
    """Return the content of the run.json of a run.

    It has the settings and tables of the study, the versions and hashes of `provenance`, the duration and key of each
    task, formulas of the laws, and, by signal, how the record was read, its features, priors of the candidates and the
    error budget of their fits.
    """
    files = {s.source.file: s.source.path for s in study.signals if isinstance(s.source, Recording)}
    about: dict[str, Row] = {}
    priors, budget = {}, {}
    assumed: dict[str, None] = {}
    for spec in study.signals:
        if spec.is_envelope:
            answered = store.find(f"{ANSWER}/{spec.name}/0", arrays=False)
            content = AnswerContent.maybe(answered)
            if answered and content and content.envelope:
                unit, outcome = content.envelope.unit, answered.outcome
                about[spec.name] = {"quantity": "envelope", "unit": unit, "outcome": outcome}
                assumed |= dict.fromkeys(content.envelope.assumed)
            continue
        result = store.find(f"signal/{spec.name}/0", arrays=False)
        if result is None:
            continue
        # If the first repeat shows no oscillation, another one may.
        oscillating = _first_oscillating(store, spec) or result
        answer = AnswerContent.maybe(store.find(f"{ANSWER}/{spec.name}/0", arrays=False))
        content = RecordContent.of(result)
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
        results = {m: store.find(f"mode/{spec.name}/0/{m}", arrays=False) for m in study.compare(spec)}
        modes = {m: ModeContent.of(c) if c.outcome == OK else None for m, c in results.items() if c}
        priors[spec.name] = {m: dict(mode.priors) if mode else {} for m, mode in modes.items()}
        budget[spec.name] = {m: dict(mode.error_budget) if mode else {} for m, mode in modes.items()}
        if not modes:  # only the answer fitted candidates
            answered = answer_result(store, spec.name, 0)
            many = len(spec.restoring) > 1
            priors[spec.name] = {
                candidate_name(c.damping, c.restoring) if many else c.damping: dict(c.priors)
                for c in (AnswerContent.of(answered).priors if answered else ())
            }
    # Damping terms that the study compares or simulates.
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


def _first_oscillating(store: Store, spec: SignalSpec) -> TaskResult | None:
    """Return the result of the first repeat of a signal that shows an oscillation; None if no repeat does."""
    results = (store.find(f"signal/{spec.name}/{repeat}", arrays=False) for repeat in range(spec.repeats))
    return next((result for result in results if result and result.outcome == OK), None)


def _equilibrium(spec: SignalSpec, store: Store) -> Row:
    """Return a signal's `equilibrium` (rad or m) and `natural_frequency` (rad/s) from its known restoring law.

    Return {} if a parameter of the law is not known, or if the record does not oscillate.
    """
    result = _first_oscillating(store, spec)
    oscillator = Oscillator(("viscous",), spec.system.restoring)
    shape = RecordContent.of(result).features if result is not None else None
    if shape is None or not all(n in spec.system.known for n in oscillator.law.parameters):
        return {}
    return {
        "equilibrium": oscillator.equilibrium(spec.system.known, shape.rest),
        "natural_frequency": oscillator.natural_frequency(spec.system.known, shape.rest),
    }
