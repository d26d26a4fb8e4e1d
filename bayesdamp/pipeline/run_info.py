"""The content of run.json: the study, its records, and results that no table has."""

from __future__ import annotations

from typing import Any

from bayesdamp.config import Recording, SignalSpec, Simulation, Study
from bayesdamp.config.load import record_question
from bayesdamp.config.signals import damping_order
from bayesdamp.physics.damping import TERMS
from bayesdamp.physics.oscillator import Oscillator
from bayesdamp.physics.restoring import LAWS
from bayesdamp.pipeline.answering import ANSWERED, answer_cell
from bayesdamp.store import CellResult, Store, provenance
from bayesdamp.store.contents import AnswerContent, ModeContent, RecordContent
from bayesdamp.store.files import SCHEMA
from bayesdamp.types import OK, candidate_name

Row = dict[str, Any]


def run_info(study: Study, store: Store) -> Row:
    """Return the content of a run's run.json, from its cells."""
    files = {s.source.file: s.source.path for s in study.signals if isinstance(s.source, Recording)}
    about, priors, budget = {}, {}, {}
    assumed: dict[str, None] = {}
    for spec in study.signals:
        if spec.is_envelope:
            answered = store.find(f"{ANSWERED}/{spec.name}/0")
            content = AnswerContent.maybe(answered)
            if answered and content and content.envelope:
                unit, outcome = content.envelope.unit, answered.outcome
                about[spec.name] = {"quantity": "envelope", "unit": unit, "outcome": outcome}
                assumed |= dict.fromkeys(content.envelope.assumed)
            continue
        cell = store.find(f"signal/{spec.name}/0")
        if cell is None:
            continue
        about[spec.name] = _about_record(spec, store, cell)
        cells = {m: store.find(f"mode/{spec.name}/0/{m}") for m in study.compare(spec)}
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
        "seconds": {name: cell.seconds for name in store.names() if (cell := store.find(name))},
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


def _about_record(spec: SignalSpec, store: Store, cell: CellResult) -> Row:
    # Where the first repeat shows no oscillation, another one may.
    oscillating = _first_oscillating(store, spec) or cell
    answer = AnswerContent.maybe(store.find(f"{ANSWERED}/{spec.name}/0"))
    content = RecordContent.of(cell)
    about: Row = {
        **content.provenance,
        "unit": spec.source.unit,
        "quantity": spec.source.quantity,
        "simulated": isinstance(spec.source, Simulation),
        "restoring": list(spec.restoring),
        "outcome": oscillating.outcome,
        "bound": dict(content.bound),
    }
    if answer and len(answer.noises) > 1:
        about["noise"] = answer.noise
    if oscillating.outcome == OK:
        known = RecordContent.of(oscillating)
        about["epsilon_note"] = known.epsilon_note
        about["reference"] = known.scales
        about["features"] = known.features
    return about


def _first_oscillating(store: Store, spec: SignalSpec) -> CellResult | None:
    """Return the first repeat of a signal that shows an oscillation."""
    cells = (store.find(f"signal/{spec.name}/{repeat}") for repeat in range(spec.repeats))
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
