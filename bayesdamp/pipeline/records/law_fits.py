"""A record under each restoring law with all damping terms in play: the fits from which its noise is chosen. Each is a
cell, as none waits for another."""

from __future__ import annotations

import time
from collections.abc import Mapping
from dataclasses import replace
from functools import cached_property

from bayesdamp.config import SignalSpec, Study
from bayesdamp.config.checks import plain
from bayesdamp.config.signals import damping_order
from bayesdamp.estimators import ESTIMATORS
from bayesdamp.inference.fit.noise_choice import Fitted, first_noise, fit_with
from bayesdamp.inference.model.target import Target
from bayesdamp.inference.noise import NOISES
from bayesdamp.outcomes import following
from bayesdamp.physics.damping import TERMS, parse_model
from bayesdamp.physics.restoring import LAWS
from bayesdamp.pipeline.keys import task_key
from bayesdamp.pipeline.records.answering import AnswerCell, fits_of
from bayesdamp.pipeline.records.records import NOT_APPLICABLE, SignalCell, plain_seconds
from bayesdamp.pipeline.records.starts import REGRESSION, observed, regression
from bayesdamp.pipeline.records.stored_modes import packed, unpacked
from bayesdamp.pipeline.records.targets import Record
from bayesdamp.store import CellResult, Store
from bayesdamp.store.contents.candidates import ModeContent
from bayesdamp.types import OK, Problem, Refusal, Seed


def all_terms(study: Study, spec: SignalSpec) -> tuple[str, ...]:
    """Every damping term in play on a record, in order."""
    terms = {t for model in study.dampings(spec) for t in parse_model(model)}
    return tuple(t for t in damping_order() if t in terms)


class LawFit:
    """The fit of one record under one restoring law."""

    def __init__(self, study: Study, spec: SignalSpec, repeat: int, law: str, store: Store) -> None:
        self.study, self.spec, self.repeat, self.law, self.store = study, spec, repeat, law, store
        self.parent = SignalCell(study, spec, repeat, store)
        self.terms = all_terms(study, spec)
        self.name = f"fitted/{spec.name}/{repeat}/{law}"

    @property
    def key(self) -> str:
        """Of the record, the law, the terms in play and the answer that it starts from."""
        return self.store.key(self.name, (self.study, self.spec), self._key)

    def _key(self) -> str:
        priors = {t: str(self.study.models.prior.get(t)) for t in self.terms}
        law = plain(self.spec.under(self.law))
        answer = AnswerCell(self.study, self.spec, self.repeat, self.store).key
        named = [
            *map(TERMS.source, self.terms),
            LAWS.source(self.law),
            *map(NOISES.source, self.study.noises),
        ]
        named.append(ESTIMATORS.source(REGRESSION))
        parts = (self.study.noises, self.terms, priors, law, answer, named)
        return task_key("fitted", self.parent.key, *parts)

    @cached_property
    def record(self) -> Record:
        """The record as its cell holds it."""
        return Record(self.study, self.spec, self.store.read(self.parent.name))

    def compute(self) -> None:
        """Store the fit, or why there is none."""
        began = time.perf_counter()
        cell, meta, arrays = self.record.cell, {}, {}
        outcome = following(cell.name, cell.outcome)
        if outcome == OK and not self.record.content.noisy:
            outcome = NOT_APPLICABLE
        if outcome == OK:
            try:
                fit = self.fit()
            except Refusal as refusal:
                outcome = str(refusal)
            else:
                content, arrays = packed(fit.mode)
                meta = replace(content, log_evidence=fit.log_evidence).meta()
        self.store.write(CellResult(self.name, self.key, meta, arrays, outcome, plain_seconds(began)))

    def fit(self) -> Fitted:
        """From where the first weighing ended, if there was one; else from regression and the record's decay. Raises
        Refusal, also for a law that the first weighing put out of the question."""
        problem, said = Problem(self.terms, self.record.system(self.law)), ""
        begun = fits_of(self.store, self.spec.name, self.repeat)
        if begun and self.law not in begun:
            raise Refusal("out of the question in the first weighing")
        seeds: dict[Seed, Mapping[str, float]] = {Seed("first weighing"): begun[self.law]} if begun else {}
        if not begun:
            # The climb is a refinement of its own.
            found, said = regression(self.record, problem)
            seeds = observed(self.record, problem) | found
        if not seeds:
            raise Refusal(said)
        return fit_with(self._target(), seeds, self.record.seen)

    def found(self) -> ModeContent:
        """What was stored of the fit, which is made where it was not. Raises Refusal where there is none."""
        if not self.store.has(self.name, self.key):
            self.compute()
        cell = self.store.read(self.name)
        if cell.outcome != OK:
            raise Refusal(cell.outcome)
        return ModeContent.of(cell)

    def restored(self) -> Fitted:
        """The fit as it was stored."""
        cell, target = self.store.read(self.name), self._target()
        return Fitted(target, unpacked(cell, target), ModeContent.of(cell).log_evidence)

    def _target(self) -> Target:
        return self.record.target(self.terms, self.law, first_noise(self.study.noises, self.record.signal))
