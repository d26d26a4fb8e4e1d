"""One candidate on one record: what its tasks read, from the study and from the store."""

from __future__ import annotations

from functools import cached_property

from bayesdamp.config import SignalSpec, Study
from bayesdamp.inference.deviation.single import Single, put_together
from bayesdamp.inference.fit.mode import Mode, StoredMode, restore_mode
from bayesdamp.inference.model.target import Target
from bayesdamp.interface.case import Case
from bayesdamp.outcomes import following
from bayesdamp.physics.damping import TERMS, parse_model
from bayesdamp.physics.restoring import LAWS
from bayesdamp.pipeline.records.answering import ANSWERED, law_of, likelihood_of
from bayesdamp.pipeline.records.records import SignalCell
from bayesdamp.pipeline.records.targets import Record
from bayesdamp.serial import join, split
from bayesdamp.store import Store
from bayesdamp.store.contents import AnswerContent, ModeContent
from bayesdamp.types import OK, Refusal, candidate_parts


class Branch:
    """One candidate on one record: its estimates, mode, posteriors and evidence, each a cell.

    model: the candidate's name, of which terms and restoring are the two parts.
    """

    def __init__(self, study: Study, spec: SignalSpec, repeat: int, model: str, store: Store) -> None:
        self.study, self.spec, self.repeat, self.model, self.store = study, spec, repeat, model, store
        damping, law = candidate_parts(model)
        self.terms, self.restoring = parse_model(damping), law or spec.restoring[0]
        self.parent = SignalCell(study, spec, repeat, store)
        self.path = f"{spec.name}/{repeat}/{model}"
        system = spec.under(self.restoring)
        self.other = () if system is spec.system else (split(system),)

    @property
    def methods(self) -> tuple[str, ...]:
        """The estimators that are run for it."""
        on = self.study.estimators.on(self.repeat)
        return on if self.model in self.study.estimate(self.spec) else ()

    @property
    def forces(self) -> list[str]:
        """The source of the damping terms and of the law, which are found by name."""
        return [*map(TERMS.source, self.terms), LAWS.source(self.restoring)]

    @cached_property
    def record(self) -> Record:
        """The record as its cell holds it."""
        return Record(self.study, self.spec, self.store.read(self.parent.name))

    @cached_property
    def case(self) -> Case:
        """The candidate on the record."""
        return self.record.case(self.terms, self.restoring)

    @cached_property
    def answer(self) -> AnswerContent | None:
        """The answer on the record; None where nothing was weighed."""
        found = AnswerContent.maybe(self.store.find(f"{ANSWERED}/{self.spec.name}/{self.repeat}"))
        return found if found is not None and found.candidates else None

    @property
    def noise(self) -> str:
        """The noise model: of those that the study allows, the likeliest in the answer."""
        every = self.answer.noises if self.answer else ()
        found = {one.name: one.log_evidence for one in every if one.name in self.study.noises}
        return max(found, key=lambda name: found[name], default=self.study.noises[0])

    @property
    def epsilon(self) -> float | None:
        """The width of friction (rad/s) that the answer is under, where it is not known and not inferred."""
        inferred = "epsilon" in self.spec.under(self.restoring).free
        return self.answer.epsilon if self.answer and not inferred else None

    @cached_property
    def target(self) -> Target:
        """The target of this candidate."""
        return self.case.target(self.noise, self.epsilon)

    @cached_property
    def law(self) -> Single | None:
        """The candidate as the answer's search left it, where laws may hold approximately. Raises Refusal where there
        is none."""
        if likelihood_of(self.study) == "none":
            return None
        found = law_of(self.store, self.spec.name, self.repeat, "+".join(self.terms), self.restoring)
        return put_together(self.record.signal, self.restoring, found)

    @cached_property
    def density(self) -> Mode:
        """The density that is sampled and integrated, about its mode. Raises Refusal where there is none."""
        if self.law is not None:
            return self.law.mode
        found = self.store.read(f"mode/{self.path}")
        if found.outcome != OK:
            raise Refusal(following(found.name, found.outcome))
        return restore_mode(
            self.target, join(StoredMode, ModeContent.of(found).stored, found.arrays, "stored")
        )

    @property
    def many(self) -> bool:
        """Whether there are so many candidates that one good start of each has to do."""
        return self.study.models.prune is not None
