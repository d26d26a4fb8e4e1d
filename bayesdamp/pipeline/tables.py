"""Write the tables, the verdicts and the run.json of a run from its stored results."""

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np

from bayesdamp.config import Recording, SignalSpec, Simulation, Study
from bayesdamp.config.load import record_question
from bayesdamp.config.signals import damping_order
from bayesdamp.physics.damping import TERMS
from bayesdamp.physics.oscillator import Oscillator
from bayesdamp.physics.restoring import LAWS
from bayesdamp.pipeline.answering import ANSWER, SAMPLED_ANSWER, stored_answer
from bayesdamp.pipeline.candidates.candidate import StudyCandidate
from bayesdamp.pipeline.candidates.evidence import evidence_by_method, probabilities
from bayesdamp.pipeline.records import StudyRecord
from bayesdamp.pipeline.tasks import task_seed
from bayesdamp.store.files import DAMPING_CURVES, POPULATION, SCHEMA, TABLES, write_json, write_table
from bayesdamp.store.results import (
    AnswerContent,
    EstimateContent,
    ModeContent,
    PosteriorContent,
    RecordContent,
    SampledPosterior,
    Store,
    provenance,
    remove_listed,
)
from bayesdamp.types import NORMAL_95, OK, UNITS, Evidence, Status, Unit, quantity_unit, status_of, unit_named
from bayesdamp.verdict.specimen import pool_coefficients, specimen
from bayesdamp.verdict.types import VERDICT_JSON, VERDICT_TABLE, Verdict, save_verdicts
from bayesdamp.verdict.units import in_unit, picture_in_unit

Row = dict[str, Any]

SMC = "smc"
"""Name of sequential Monte Carlo in the tables, in the columns `sampler` and `method`. With it the task
`SAMPLED_ANSWER` computes posteriors and evidence of the most probable models."""


def write_tables(study: Study, store: Store) -> None:
    """Write the tables estimates.csv, posteriors.csv, evidence.csv and fits.csv, and the run.json of a run.

    Rows are in the order of signals, repeats and models (evidence.csv: signals, repeats, methods and models). The files
    are written to the folder of `store`, which must show only the results of the current study.
    """
    makers = [_estimates, _posteriors, _evidence, _fits]
    for (name, columns), rows_of in zip(TABLES.items(), makers, strict=True):
        write_table(store.folder / name, columns, rows_of(study, store))
    write_json(store.folder / "run.json", run_info(study, store))


def write_verdicts(study: Study, store: Store) -> None:
    """Write verdict.json, verdicts.csv and damping_curves.csv; if no record has a verdict, remove files of these names.

    A verdict is on a record, or on a specimen (a tested object with several records).

    - verdict.json has an object for each verdict, with amplitudes in rad, m or the sensor's unit.
    - verdicts.csv has a row for each verdict, with amplitudes in the unit of the record's file (in a base unit, such as
    rad, if the records of a specimen have different units).
    - damping_curves.csv has the damping curve of each record that is measured without assuming a damping law, in the
      unit of the record's file.
    - population.csv, with damping coefficients over all specimens, is written if the study has several specimens.
      Otherwise a file of this name is removed.
    """
    (store.folder / "population.csv").unlink(missing_ok=True)
    verdicts: list[tuple[Verdict, Unit]] = []
    curves: list[Row] = []  # damping measured without a law, a row for each amplitude
    for spec, repeat in study.records:
        answer = stored_answer(StudyRecord(study, spec, repeat, store))
        unit = unit_named(spec.source.unit)
        if answer is None:
            continue
        verdicts.append((answer.verdict, unit))
        if "free/amplitude" in answer.arrays:
            arrays = picture_in_unit(answer.arrays, unit)
            head = {"record": answer.verdict.record, "unit": unit.displacement.name}
            rows = zip(*(arrays[f"free/{name}"].tolist() for name in DAMPING_CURVES), strict=True)
            curves += [{**head, **dict(zip(DAMPING_CURVES, row, strict=True))} for row in rows]
    by_record = {v.record: v for v, _ in verdicts}
    specimens: list[Verdict | None] = []
    for name, specs in study.specimens.items():
        together = _specimen_verdict(study, store, name, specs)
        alone = [v for v in (by_record.get(spec.name) for spec in specs) if v is not None and v.damping]
        specimens.append(together or next(iter(alone), None))
        if together is not None:
            units = {unit_named(spec.source.unit) for spec in specs}
            base = unit_named(unit_named(specs[0].source.unit).base)
            verdicts.append((together, units.pop() if len(units) == 1 else base))
    if not verdicts:
        remove_listed(store.folder, (VERDICT_JSON, VERDICT_TABLE, "damping_curves.csv"))
        return
    save_verdicts(store.folder, [v for v, _ in verdicts], [in_unit(v, unit) for v, unit in verdicts])
    write_table(store.folder / "damping_curves.csv", ("record", "unit", *DAMPING_CURVES), curves)
    if len(study.specimens) > 1:
        write_table(store.folder / "population.csv", POPULATION, _population(specimens))


def _specimen_verdict(study: Study, store: Store, name: str, specs: Sequence[SignalSpec]) -> Verdict | None:
    """Return the verdict on a specimen: a tested object with several records.

    specs: the signals of the specimen. The result is None if fewer than two of its records have an answer with compared
    models (for envelopes: with a decay).
    """
    records = (StudyRecord(study, spec, repeat, store) for spec in specs for repeat in range(spec.repeats))
    answers = [a for a in map(stored_answer, records) if a is not None]
    if specs[0].is_envelope:
        from bayesdamp.interface.envelopes import specimen_of_envelopes  # imports slowly

        return specimen_of_envelopes(name, answers)
    own = [a.of_specimen() for a in answers if a.content.candidates]
    if len(own) < 2:
        return None
    return specimen(name, own, study.priors, study.posterior.sensor, task_seed(study, f"specimen/{name}"))


def _population(specimens: Sequence[Verdict | None]) -> Iterator[Row]:
    """Yield the rows of population.csv: mean and spread of each damping coefficient over the specimens.

    specimens: the verdict on each specimen (tested object); None if it names no damping. There are no rows if one of
    them is None, or if the specimens do not have a common model (see `pool_coefficients`). Lower ends of intervals are
    at least 0.
    """
    verdicts = [v for v in specimens if v is not None]
    if len(verdicts) < len(specimens):
        return
    for coefficient, p in pool_coefficients(verdicts):
        yield {
            "model": verdicts[0].damping,
            "restoring": verdicts[0].restoring,
            "parameter": coefficient.name,
            "unit": coefficient.unit,
            "specimens": len(specimens),
            "mean": p.mean,
            "mean_low": max(p.mean - NORMAL_95 * p.sd, 0.0),
            "mean_high": p.mean + NORMAL_95 * p.sd,
            "spread": p.spread,
            "spread_low": p.spread_low,
            "spread_high": p.spread_high,
            "next_low": max(p.low, 0.0),
            "next_high": p.high,
        }


def _candidates(study: Study, store: Store) -> Iterator[tuple[StudyCandidate, Row, SampledPosterior | None]]:
    """Iterate over all candidates (models) on all records.

    Yields the candidate, the values of the columns that name it (signal, repeat, model, restoring), and its posterior
    from the task `SAMPLED_ANSWER` (None if there is none).
    """
    for spec, repeat in study.records:
        record = StudyRecord(study, spec, repeat, store)
        sampled = _sampled_posteriors(record)
        for name in study.compare(spec):
            candidate = StudyCandidate(study, spec, repeat, name, store)
            yield candidate, _head(record, name), sampled.get(name)


def _head(record: StudyRecord, candidate: str) -> Row:
    """Return the values of the columns signal, repeat, model and restoring, which name a model on a record.

    candidate: name of the model.
    """
    model, restoring = record.spec.parts(candidate)
    return {"signal": record.spec.name, "repeat": record.repeat, "model": model, "restoring": restoring}


def _truth(spec: SignalSpec, name: str, restoring: str) -> float:
    """Return the true value of a parameter of a simulated record, in the parameter's unit.

    The true coefficient of a damping term that was not simulated is 0. The result is NaN for a measured record, for a
    parameter of a restoring law other than the simulated one, and for other unknown values.
    """
    if not isinstance(spec.source, Simulation):
        return np.nan
    if restoring != spec.system.restoring and name in LAWS.get(restoring).parameters:
        return np.nan
    truth = {**spec.system.known, **spec.source.truth}
    damps = any(TERMS.get(term).parameter == name for term in TERMS.present())
    return float(truth.get(name, 0.0 if damps else np.nan))


def _sampled_posteriors(record: StudyRecord) -> dict[str, SampledPosterior]:
    """Return the posteriors that the task `SAMPLED_ANSWER` on a record has stored, by name of the model; {} if none."""
    result = record.find(SAMPLED_ANSWER, arrays=False)
    if result is None or result.outcome != OK:
        return {}
    return {record.spec.candidate(p.damping, p.restoring): p for p in AnswerContent.of(result).posteriors}


def _estimates(study: Study, store: Store) -> Iterator[Row]:
    """Yield the rows of estimates.csv. A stage of an estimator that gave no values has one row, without a parameter.

    An estimator that was refused or failed as a whole has one row, without stage and parameter.
    """
    for candidate, head, _ in _candidates(study, store):
        spec, restoring = candidate.spec, candidate.restoring
        for method in study.estimators.use:
            result = store.find(f"estimate/{candidate.path}/{method}", arrays=False)
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
                    truth = _truth(spec, name, restoring)
                    yield {
                        **common,
                        "parameter": name,
                        "unit": spec.unit_of(name, restoring),
                        "value": value,
                        "stderr": stage.stderr.get(name, np.nan),
                        "truth": truth,
                        "error_pct": 100 * abs(value - truth) / abs(truth) if truth else np.nan,
                    }


def _posteriors(study: Study, store: Store) -> Iterator[Row]:
    """Yield the rows of posteriors.csv for each model: first those of the study's samplers, then those of `SMC`.

    A sampler of the study that gave no draws has one row, without a parameter.
    """
    for candidate, head, smc in _candidates(study, store):
        spec, restoring = candidate.spec, candidate.restoring
        for sampler in study.posterior.samplers:
            result = store.find(f"posterior/{candidate.path}/{sampler}", arrays=False)
            if result is None:
                continue
            common = {**head, "sampler": sampler, "seconds": result.seconds, "outcome": result.outcome}
            common["deviation"] = study.likelihood
            content = PosteriorContent.of(result)
            if not content.summary:
                yield common
            common["divergences"] = content.posterior.divergences
            for name, s in content.summary.items():
                yield {**common, "parameter": name, "unit": content.units[name], **s}
        common = {**head, "sampler": SMC, "deviation": study.deviation_of(spec), "outcome": OK}
        for name, s in (smc.parameters if smc else {}).items():
            yield {**common, "parameter": name, "unit": spec.unit_of(name, restoring), **s}


def _evidence(study: Study, store: Store) -> Iterator[Row]:
    """Yield the rows of evidence.csv for each record: first each method in `evidence_by_method`, then `SMC`.

    `SMC` is the sequential Monte Carlo of the task `SAMPLED_ANSWER`; its rows have no probabilities. The probabilities
    by another method are nan if it has no evidence of a model, but a different method has.
    """
    for spec, repeat in study.records:
        record = StudyRecord(study, spec, repeat, store)
        models, by_method = study.compare(spec), evidence_by_method(record)
        every = [(m, e) for by_model in by_method.values() for m, e in by_model.items()]
        with_evidence = {
            m for m, e in every if np.isfinite(e.log_evidence) or status_of(e.outcome) is Status.PRUNED
        }
        for method, by_model in by_method.items():
            lost = [m for m, e in by_model.items() if m not in with_evidence and e.outcome != OK]
            pruned = [m for m, e in by_model.items() if status_of(e.outcome) is Status.PRUNED]
            finite = [m for m, e in by_model.items() if np.isfinite(e.log_evidence)]
            # Probabilities need the evidence of every compared model, with two exceptions: models that were pruned,
            # whose probability is 0, and models without evidence by any method, which get no probability.
            is_complete = len(finite) + len(pruned) + len(lost) == len(models)
            shares = {**probabilities(by_model), **dict.fromkeys(pruned, 0.0)} if is_complete else {}
            yield from _evidence_rows(record, method, study.likelihood, by_model, shares)
        sampled = {}
        for model, smc in _sampled_posteriors(record).items():
            diagnostic = f"temperatures: {smc.temperatures}, acceptance rate {smc.acceptance:.2f}"
            sampled[model] = Evidence(model, SMC, smc.log_evidence, smc.stderr, diagnostic)
        yield from _evidence_rows(record, SMC, study.deviation_of(spec), sampled, {})


def _evidence_rows(
    record: StudyRecord,
    method: str,
    deviation: str,
    by_model: Mapping[str, Evidence],
    shares: Mapping[str, float],
) -> Iterator[Row]:
    """Yield the rows of evidence.csv for one record and method.

    Parameters
    ----------
    record, method
        The record and the method.
    deviation
        "law" if the evidence allows deviations from the laws, else "none".
    by_model
        The evidence of each candidate (model), by name.
    shares
        Posterior probabilities of the candidates. A candidate that is missing here has nan in the table.

    Yields
    ------
    Row
        A row for each candidate. Its log Bayes factor is relative to the candidate with the largest log evidence by
        this method.
    """
    best = max((e.log_evidence for e in by_model.values() if np.isfinite(e.log_evidence)), default=np.nan)
    for model, evidence in by_model.items():
        yield {
            **_head(record, model),
            "method": method,
            "deviation": deviation,
            "log_evidence": evidence.log_evidence,
            "stderr": evidence.stderr,
            "log_bayes_factor": evidence.log_evidence - best,
            "probability": shares.get(model, np.nan),
            "diagnostic": evidence.diagnostic,
            "outcome": evidence.outcome,
        }


def _fits(study: Study, store: Store) -> Iterator[Row]:
    """Yield the rows of fits.csv: one for each model with a result of its task `mode`, or a posterior by `SMC`."""
    for candidate, head, smc in _candidates(study, store):
        source = candidate.spec.source
        result = store.find(f"mode/{candidate.path}", arrays=False)
        if result is None and smc is None:
            continue
        row = dict(head)
        if smc is not None:
            row["deviation_low"], row["deviation"], row["deviation_high"] = smc.deviation
            row["unexplained_pct"] = 100 * smc.unexplained
        if result is not None and result.outcome == OK:
            mode = ModeContent.of(result)
            row["rms"] = mode.rms / UNITS[source.unit].factor
            row["rms_unit"] = quantity_unit(source.unit, source.quantity)
            for name in ("residual_autocorrelation", "window_spread", "predictive_p", "verdict"):
                row[name] = getattr(mode, name)
        elif result is not None:
            row["verdict"] = result.outcome
        yield row


def run_info(study: Study, store: Store) -> Row:
    """Return the content of the run.json of a run.

    It contains the settings of the study, the versions and hashes of `provenance`, the duration and the key of each
    task, the formulas of the damping terms and restoring laws, and for each signal how its record was read, its
    features and the priors of the models.
    """
    files = {s.source.file: s.source.path for s in study.signals if isinstance(s.source, Recording)}
    about: dict[str, Row] = {}
    priors, equilibrium = {}, {}
    assumed: dict[str, None] = {}
    for spec in study.signals:
        first = StudyRecord(study, spec, 0, store)
        result, answer = first.find("signal", arrays=False), first.find(ANSWER, arrays=False)
        content = AnswerContent.maybe(answer)
        if spec.is_envelope and answer and content and content.envelope:
            unit = content.envelope.unit
            about[spec.name] = {"quantity": "envelope", "unit": unit, "outcome": answer.outcome}
            assumed |= dict.fromkeys(content.envelope.assumed)
        if spec.is_envelope:
            continue
        equilibrium[spec.name] = {}
        if result is None:
            continue
        record = RecordContent.of(result)
        about[spec.name] = {
            **record.provenance,
            "unit": spec.source.unit,
            "quantity": spec.source.quantity,
            "simulated": isinstance(spec.source, Simulation),
            "restoring": list(spec.restoring),
            "outcome": result.outcome,
            "bound": dict(record.bound),
        }
        if content and len(content.noises) > 1:
            about[spec.name]["noise"] = content.noise
        # If the first repeat shows no oscillation, another one may.
        repeats = (store.find(f"signal/{spec.name}/{r}", arrays=False) for r in range(spec.repeats))
        oscillating = next((r for r in repeats if r and r.outcome == OK), None)
        if oscillating is not None:
            known = RecordContent.of(oscillating)
            about[spec.name] |= {"outcome": OK, "epsilon_note": known.epsilon_note}
            about[spec.name] |= {"reference": known.scales, "features": known.features}
            equilibrium[spec.name] = _equilibrium(spec, known)
        results = {m: store.find(f"mode/{first.name}/{m}", arrays=False) for m in study.compare(spec)}
        modes = {m: ModeContent.maybe(c) for m, c in results.items() if c}
        priors[spec.name] = {m: dict(mode.priors) if mode else {} for m, mode in modes.items()}
        if not modes and content:  # only the answer fitted candidates
            own = content.priors
            priors[spec.name] = {spec.candidate(c.damping, c.restoring): dict(c.priors) for c in own}
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
        "equilibrium": equilibrium,
    }


def _equilibrium(spec: SignalSpec, record: RecordContent) -> Row:
    """Return the `equilibrium` (rad or m) and the `natural_frequency` (rad/s) of a signal's restoring law.

    The equilibrium is the one nearest to the rest position of the record; the frequency is that of small oscillations
    about it. Return {} if a parameter of the law is unknown, or if the record does not oscillate.
    """
    oscillator = Oscillator(("viscous",), spec.system.restoring)
    shape, known = record.features, spec.system.known
    if shape is None or not all(n in known for n in oscillator.law.parameters):
        return {}
    return {
        "equilibrium": oscillator.equilibrium(known, shape.rest),
        "natural_frequency": oscillator.natural_frequency(known, shape.rest),
    }
