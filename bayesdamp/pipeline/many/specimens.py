"""The records of one specimen, as a run's answers describe them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from bayesdamp.config import SignalSpec, Study
from bayesdamp.inference.curves.weighted import summarise
from bayesdamp.inference.deviation.gaussian.repeats import Repeats
from bayesdamp.inference.deviation.specimen import (
    Model,
    WeighedRun,
    WeighedSpecimen,
    common_reference,
    weigh_specimen,
)
from bayesdamp.physics.damping import parse_model
from bayesdamp.physics.units import parameter_unit
from bayesdamp.pipeline.keys import task_key
from bayesdamp.pipeline.records.answering import AnswerCell, answered_of, approximately, stated_priors
from bayesdamp.pipeline.records.records import cell_seed
from bayesdamp.priors import Prior
from bayesdamp.store import Store
from bayesdamp.store.contents import Summary
from bayesdamp.types import Reference, Refusal, candidate_parts
from bayesdamp.units import UNITS


@dataclass(frozen=True)
class AnsweredRecord:
    """A record that has an answer: its label, signal and repeat, and what the answer says of every damping."""

    label: str
    signal: str
    repeat: int
    weighed: WeighedRun


class Specimen:
    """One specimen of a study: its records, its candidates and what was weighed of them."""

    def __init__(self, study: Study, name: str, specs: Sequence[SignalSpec], store: Store) -> None:
        self.study, self.name, self.specs, self.store = study, name, tuple(specs), store
        self.records = [(spec, repeat) for spec in self.specs for repeat in range(spec.repeats)]
        self.labels = [f"{s.name}, {r + 1}" if s.repeats > 1 else s.name for s, r in self.records]
        self.candidates = study.compare(self.specs[0])

    @property
    def deviation(self) -> str:
        """ "law" where laws may hold approximately in every record's answer, else "none"."""
        return "law" if all(approximately(self.study, spec) for spec in self.specs) else "none"

    @property
    def key(self) -> str:
        """Of its joint fit, which depends on the answers on its records, sampled or not."""
        answers = [
            AnswerCell(self.study, spec, repeat, self.store, sample).key
            for spec, repeat in self.records
            for sample in (False, True)
        ]
        priors = {n: str(p) for n, p in self.priors.items()}
        return task_key("joint", self.name, self.candidates, priors, answers)

    @property
    def priors(self) -> dict[str, Prior]:
        """The priors of damping terms that the study states, by parameter."""
        return stated_priors(self.study)

    @property
    def seed(self) -> int:
        """Of what is drawn for this specimen: the same as for the verdict on it."""
        return cell_seed(self.study, f"specimen/{self.name}")

    @cached_property
    def answered(self) -> list[AnsweredRecord]:
        """The records that have an answer, in the study's order."""
        found = []
        for label, (spec, repeat) in zip(self.labels, self.records, strict=True):
            one = answered_of(self.store, spec.name, repeat)
            if one is not None:
                found.append(AnsweredRecord(label, spec.name, repeat, one.weighed))
        return found

    @property
    def reference(self) -> Reference:
        """Of its priors: the geometric mean over its records."""
        return common_reference([r.weighed for r in self.answered])

    @cached_property
    def weighed(self) -> WeighedSpecimen:
        """Every damping and law on all records that have an answer. Raises Refusal where none has one."""
        if not self.answered:
            raise Refusal("no record has an answer")
        return weigh_specimen([r.weighed for r in self.answered], self.priors, seed=self.seed)

    def model_of(self, candidate: str) -> Model | None:
        """A candidate as the answers name it; None where no record weighed it."""
        damping, law = candidate_parts(candidate)
        terms, law = set(parse_model(damping)), law or self.specs[0].restoring[0]
        every = self.weighed.log_evidence
        return next((m for m in every if set(m[0].split("+")) == terms and m[1] == law), None)

    def units(self, candidate: str, names: Sequence[str]) -> dict[str, str]:
        """Units of parameters, as tables have them."""
        law = candidate_parts(candidate)[1] or self.specs[0].restoring[0]
        source = self.specs[0].source
        return {n: parameter_unit(n, law, UNITS[source.unit].base, source.quantity) for n in names}


def summaries(found: Repeats) -> dict[str, Summary]:
    """Summary of each damping parameter of the specimen, from draws of equal weight."""
    weights = np.full(len(found.draws), 1.0 / len(found.draws))
    return {n: summarise(found.draws[:, i], weights) for i, n in enumerate(found.names)}
