"""The noise of a record, chosen once for all candidates on it."""

from __future__ import annotations

import time
from dataclasses import asdict, replace
from functools import cached_property
from typing import Any

import numpy as np
from scipy.special import logsumexp

from bayesdamp.config import SignalSpec, Study
from bayesdamp.config.checks import plain
from bayesdamp.config.signals import damping_order
from bayesdamp.estimators import run as run_estimator
from bayesdamp.inference.defaults import Reference
from bayesdamp.inference.noise_choice import Weighed, chosen_noise, weigh_noises
from bayesdamp.physics.damping import parse_model
from bayesdamp.signals.features import features
from bayesdamp.store import CellResult, Store
from bayesdamp.study.records import NOT_APPLICABLE, SignalCell, cell_seed, digest, signal_of
from bayesdamp.types import OK, Problem, Refusal

SEED_FROM = "least_squares"
"""What starts the search under each law."""


class NoiseCell:
    """The evidence of each noise model in play on one record, under all damping terms in play."""

    def __init__(self, study: Study, spec: SignalSpec, repeat: int, store: Store) -> None:
        self.study, self.spec, self.store = study, spec, store
        self.parent = SignalCell(study, spec, repeat, store)
        self.name = f"noise/{spec.name}/{repeat}"
        terms = {t for model in study.dampings(spec) for t in parse_model(model)}
        self.terms = tuple(t for t in damping_order() if t in terms)

    @cached_property
    def key(self) -> str:
        priors = {t: str(self.study.models.prior.get(t)) for t in self.terms}
        laws = [plain(self.spec.under(law)) for law in self.spec.restoring]
        return digest("noise", self.parent.key, self.study.noises, self.terms, priors, laws)

    def compute(self) -> None:
        began = time.perf_counter()
        record = self.store.read(self.parent.name)
        outcome, meta = record.outcome, {}
        if outcome == OK and not record.meta["noisy"]:
            outcome = NOT_APPLICABLE
        if outcome == OK:
            try:
                meta = self._weigh(record)
            except Refusal as refusal:
                outcome = str(refusal)
        self.store.write(CellResult(self.name, self.key, meta, {}, outcome, time.perf_counter() - began))

    def _weigh(self, record: CellResult) -> dict[str, Any]:
        signal = signal_of(record)
        found: dict[str, list[Weighed]] = {name: [] for name in self.study.noises}
        for law in self.spec.restoring:
            epsilon = {k: v for k, v in record.meta["known"].items() if k == "epsilon"}
            system = self.spec.under(law)
            system = replace(system, known={**system.known, **epsilon})
            started = run_estimator(SEED_FROM, signal, Problem(self.terms, system), seed=0)
            seeds = {f"{SEED_FROM}, {e.stage}": e.values for e in started if e.values}
            if not seeds:
                continue
            weighed = weigh_noises(
                signal,
                self.terms,
                system,
                features(signal),
                Reference(**record.meta["reference"]),
                names=self.study.noises,
                seeds=seeds,
                term_priors={t: p for t, p in self.study.models.prior.items() if t in self.terms},
                seed=cell_seed(self.study, self.name),
            )
            for w in weighed:
                found[w.noise].append(w)
        over_laws = [_over_laws(name, each) for name, each in found.items() if each]
        return {
            "chosen": chosen_noise(over_laws),
            "damping": list(self.terms),
            "weighed": [asdict(w) for w in over_laws],
        }


def noise_cell(study: Study, spec: SignalSpec, repeat: int, store: Store) -> NoiseCell | None:
    """The cell that chooses a record's noise; None where the study has chosen, or nothing needs it."""
    needed = study.posterior.samplers or study.evidence.methods
    return NoiseCell(study, spec, repeat, store) if needed and len(study.noises) > 1 else None


def _over_laws(name: str, weighed: list[Weighed]) -> Weighed:
    """One noise model under laws that are equally probable: the mean of their evidence, the rest from the best."""
    usable = [w for w in weighed if w.outcome == OK and np.isfinite(w.log_evidence)]
    if not usable:
        return weighed[0]
    best = max(usable, key=lambda w: w.log_evidence)
    mean = float(logsumexp([w.log_evidence for w in usable]) - np.log(len(weighed)))
    return replace(best, log_evidence=mean, noise=name)
