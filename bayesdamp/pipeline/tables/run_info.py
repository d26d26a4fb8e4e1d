"""run.json: what ran, on what, and what followed from it beside the tables."""

from __future__ import annotations

from typing import Any

from bayesdamp.config import Recording, SignalSpec, Simulation, Study
from bayesdamp.config.load import record_question
from bayesdamp.config.signals import damping_order
from bayesdamp.physics.damping import TERMS
from bayesdamp.physics.oscillator import Oscillator
from bayesdamp.physics.restoring import LAWS
from bayesdamp.pipeline.records.answering import ANSWERED, answer_cell
from bayesdamp.store import CellResult, Store, provenance
from bayesdamp.store.contents import AnswerContent, ModeContent, RecordContent
from bayesdamp.store.files import SCHEMA
from bayesdamp.types import OK, candidate_name

Row = dict[str, Any]


def run_info(study: Study, store: Store) -> Row:
    """The content of a run's run.json, from its cells."""
    files = {s.source.file: s.source.path for s in study.signals if isinstance(s.source, Recording)}
    about, priors, budget = {}, {}, {}
    assumed: dict[str, None] = {}
    for spec in study.signals:
        if spec.is_envelope:
            answered = store.find(f"{ANSWERED}/{spec.name}/0")
            envelope = answered and AnswerContent.of(answered).envelope
            if answered and envelope:
                about[spec.name] = {
                    "quantity": "envelope",
                    "unit": envelope.unit,
                    "outcome": answered.outcome,
                }
                assumed |= dict.fromkeys(envelope.assumed)
            continue
        cell = store.find(f"signal/{spec.name}/0")
        if cell is None:
            continue
        # Where the first repeat shows no oscillation, another one may.
        seen = _first_seen(store, spec) or cell
        content = RecordContent.of(cell)
        answer = AnswerContent.maybe(store.find(f"{ANSWERED}/{spec.name}/0"))
        oscillation: Row = {}
        if seen.outcome == OK:
            known = RecordContent.of(seen)
            oscillation = {
                "epsilon_note": known.epsilon_note,
                "reference": known.scales,
                "features": known.features,
            }
        about[spec.name] = {
            **content.provenance,
            "unit": spec.source.unit,
            "quantity": spec.source.quantity,
            "simulated": isinstance(spec.source, Simulation),
            "restoring": list(spec.restoring),
            "outcome": seen.outcome,
            "bound": dict(content.bound),
            **({"noise": answer.noise} if answer and len(answer.noises) > 1 else {}),
            **oscillation,
        }
        cells = {m: store.find(f"mode/{spec.name}/0/{m}") for m in study.compare(spec)}
        modes = {m: ModeContent.of(c) if c.outcome == OK else None for m, c in cells.items() if c}
        stored = {m: dict(mode.priors) if mode else {} for m, mode in modes.items()}
        priors[spec.name] = stored or _answered_priors(store, spec)
        budget[spec.name] = {m: dict(mode.error_budget) if mode else {} for m, mode in modes.items()}
    return {
        "name": study.name,
        "description": study.description,
        "seed": study.seed,
        "study": study.resolved(),
        "asked": record_question(study, store.folder),
        "schema": SCHEMA,
        **provenance(files),
        "seconds": {name: cell.seconds for name in store.names() if (cell := store.find(name))},
        **({"cells": dict(store.only)} if store.only is not None else {}),
        "signals": about,
        "priors": priors,
        **({"assumed": list(assumed)} if assumed else {}),
        "models": list(
            dict.fromkeys([*study.models.compare, *(m for s in study.signals for m in study.compare(s))])
        ),
        "damping": _terms(study),
        "restoring": {
            law: LAWS.get(law).formula for law in dict.fromkeys(n for s in study.signals for n in s.restoring)
        },
        "error_budget": budget,
        "equilibrium": {s.name: _equilibrium(s, store) for s in study.signals if not s.is_envelope},
    }


def _answered_priors(store: Store, spec: SignalSpec) -> Row:
    """Of what was weighed for an answer."""
    cell = answer_cell(store, spec.name, 0)
    many = len(spec.restoring) > 1
    return {
        candidate_name(one.damping, one.restoring) if many else one.damping: dict(one.priors)
        for one in (AnswerContent.of(cell).priors if cell else ())
    }


def _terms(study: Study) -> Row:
    """Coefficient, unit for an angle in rad, and force of each damping term that the study compares or simulates."""
    names = {t for s in study.signals for m in study.dampings(s) for t in m.split("+")}
    names |= {t for s in study.signals if isinstance(s.source, Simulation) for t in s.source.damping}
    found = {name: TERMS.get(name) for name in damping_order() if name in names}
    return {n: {"parameter": t.parameter, "unit": t.unit, "force": t.formula} for n, t in found.items()}


def _first_seen(store: Store, spec: SignalSpec) -> CellResult | None:
    """The first repeat of a signal that shows an oscillation."""
    found = (store.find(f"signal/{spec.name}/{repeat}") for repeat in range(spec.repeats))
    return next((cell for cell in found if cell and cell.outcome == OK), None)


def _equilibrium(spec: SignalSpec, store: Store) -> Row:
    """The derived equilibrium and natural frequency, where the whole restoring law is known."""
    cell = _first_seen(store, spec)
    law = Oscillator(("viscous",), spec.system.restoring)
    seen = RecordContent.of(cell).features if cell is not None else None
    if seen is None or not all(n in spec.system.known for n in law.law.parameters):
        return {}
    near = seen.rest
    return {
        "equilibrium": law.equilibrium(spec.system.known, near),
        "natural_frequency": law.natural_frequency(spec.system.known, near),
    }
