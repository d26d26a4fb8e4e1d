"""The noise of a record, chosen once for all candidates on it."""

from __future__ import annotations

import time
from dataclasses import asdict, replace
from functools import cached_property
from typing import Any

from bayesdamp.config import SignalSpec, Study
from bayesdamp.config.checks import plain
from bayesdamp.config.signals import damping_order
from bayesdamp.estimators import run as run_estimator
from bayesdamp.inference.build import build_target
from bayesdamp.inference.defaults import Reference
from bayesdamp.inference.noise_choice import Fitted, chosen_noise, first_noise, fit_with, weigh_noises
from bayesdamp.inference.target import Target
from bayesdamp.physics.damping import parse_model
from bayesdamp.signals.features import features
from bayesdamp.store import CellResult, Store
from bayesdamp.study.records import NOT_APPLICABLE, SignalCell, digest, signal_of
from bayesdamp.types import OK, Problem, Refusal, System

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
        """Under the restoring law that fits best with all damping terms, so that no noise makes up for a term that is
        missing or for a wrong law."""
        signal, names = signal_of(record), self.study.noises
        seen, first = features(signal), first_noise(names, signal)
        fits: dict[str, Fitted] = {}
        refused: list[str] = []
        for law in self.spec.restoring:
            try:
                fits[law] = self._fit(record, law, first)
            except Refusal as refusal:
                refused.append(f"{law}: {refusal}")
        if not fits:
            raise Refusal("; ".join(refused))
        best = max(fits, key=lambda law: fits[law].log_evidence)
        weighed = weigh_noises(lambda name: self._target(record, best, name), fits[best], seen, names)
        return {
            "chosen": chosen_noise(weighed),
            "damping": list(self.terms),
            "restoring": best,
            "weighed": [asdict(w) for w in weighed],
        }

    def _fit(self, record: CellResult, law: str, noise: str) -> Fitted:
        signal, system = signal_of(record), self._system(record, law)
        # The climb is a refinement of its own.
        started = run_estimator(SEED_FROM, signal, Problem(self.terms, system), stages=("initial",), seed=0)
        seeds = {f"{SEED_FROM}, {e.stage}": e.values for e in started if e.values}
        if not seeds:
            raise Refusal(started[0].outcome)
        return fit_with(self._target(record, law, noise), seeds, features(signal))

    def _target(self, record: CellResult, law: str, noise: str) -> Target:
        signal = signal_of(record)
        return build_target(
            signal,
            self.terms,
            self._system(record, law),
            features(signal),
            Reference(**record.meta["reference"]),
            noise=noise,
            term_priors={t: p for t, p in self.study.models.prior.items() if t in self.terms},
        )

    def _system(self, record: CellResult, law: str) -> System:
        system = self.spec.under(law)
        epsilon = {k: v for k, v in record.meta["known"].items() if k == "epsilon"}
        return replace(system, known={**system.known, **epsilon})


def noise_cell(study: Study, spec: SignalSpec, repeat: int, store: Store) -> NoiseCell | None:
    """The cell that chooses a record's noise; None where the study has chosen, or nothing needs it."""
    needed = study.posterior.samplers or study.evidence.methods
    return NoiseCell(study, spec, repeat, store) if needed and len(study.noises) > 1 else None
