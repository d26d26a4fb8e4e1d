"""One candidate on one record: the values that its tasks read from the study and from the store."""

from __future__ import annotations

from functools import cached_property

from bayesdamp.config import SignalSpec, Study
from bayesdamp.inference.deviation.single import Single, put_together
from bayesdamp.inference.fit.mode import Mode, StoredMode, restore_mode
from bayesdamp.inference.model.target import Target
from bayesdamp.interface.case import Case
from bayesdamp.outcomes import following
from bayesdamp.physics.damping import parse_model
from bayesdamp.pipeline.answering import ANSWERED, law_of, likelihood_of
from bayesdamp.pipeline.targets import StudyRecord
from bayesdamp.serial import join
from bayesdamp.store import Store
from bayesdamp.store.contents import AnswerContent, ModeContent
from bayesdamp.types import OK, Refusal, candidate_parts


class Branch:
    """One candidate on one record: its estimates, mode, posteriors and evidence, each a cell.

    model: the candidate's name, of which `terms` and `restoring` are the two parts.
    """

    def __init__(self, study: Study, spec: SignalSpec, repeat: int, model: str, store: Store) -> None:
        self.study, self.spec, self.repeat, self.model, self.store = study, spec, repeat, model, store
        damping, law = candidate_parts(model)
        self.terms, self.restoring = parse_model(damping), law or spec.restoring[0]
        self.path = f"{spec.name}/{repeat}/{model}"

    @property
    def methods(self) -> tuple[str, ...]:
        """The estimators that run on it."""
        on = self.study.estimators.on(self.repeat)
        return on if self.model in self.study.estimate(self.spec) else ()

    @cached_property
    def record(self) -> StudyRecord:
        """The stored record."""
        return StudyRecord(self.study, self.spec, self.store.read(f"signal/{self.spec.name}/{self.repeat}"))

    @cached_property
    def case(self) -> Case:
        """The candidate on the record."""
        return self.record.case(self.terms, self.restoring)

    @cached_property
    def answer(self) -> AnswerContent | None:
        """The answer on the record; None where nothing was weighed."""
        answer = AnswerContent.maybe(self.store.find(f"{ANSWERED}/{self.spec.name}/{self.repeat}"))
        return answer if answer is not None and answer.candidates else None

    @property
    def noise(self) -> str:
        """The noise model: of those that the study allows, the likeliest in the answer."""
        weighed = self.answer.noises if self.answer else ()
        allowed = [noise for noise in weighed if noise.name in self.study.noises]
        return max(allowed, key=lambda n: n.log_evidence).name if allowed else self.study.noises[0]

    @property
    def epsilon(self) -> float | None:
        """The width of friction (rad/s) that the answer assumes, where it is neither known nor inferred."""
        inferred = "epsilon" in self.spec.under(self.restoring).free
        return self.answer.epsilon if self.answer and not inferred else None

    @cached_property
    def target(self) -> Target:
        """The posterior density of this candidate under exact laws."""
        return self.case.target(self.noise, self.epsilon)

    @cached_property
    def law(self) -> Single | None:
        """The candidate with deviations, from the answer's search; None where laws hold exactly. Raises Refusal."""
        if likelihood_of(self.study) == "none":
            return None
        end = law_of(self.store, self.spec.name, self.repeat, "+".join(self.terms), self.restoring)
        return put_together(self.record.signal, self.restoring, end)

    @cached_property
    def density(self) -> Mode:
        """The density that is sampled and integrated, about its mode. Raises Refusal where it has none."""
        if self.law is not None:
            return self.law.mode
        cell = self.store.read(f"mode/{self.path}")
        if cell.outcome != OK:
            raise Refusal(following(cell.name, cell.outcome))
        stored = join(StoredMode, ModeContent.of(cell).stored, cell.arrays, "stored")
        return restore_mode(self.target, stored)

    @property
    def many(self) -> bool:
        """Whether there are so many candidates that one good start of each must do."""
        return self.study.models.prune is not None
