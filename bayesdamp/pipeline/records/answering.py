"""The task that answers for one record: candidates weighed under laws that hold approximately, and the verdict."""

from __future__ import annotations

from collections.abc import Mapping

from bayesdamp.config import Recording, SignalSpec, Study
from bayesdamp.inference.deviation.sample_noise import noises_of
from bayesdamp.inference.deviation.single import ESCAPED, Found
from bayesdamp.inference.deviation.weighing import Weighing
from bayesdamp.inference.noise import NOISES
from bayesdamp.interface.answer import Answer, answer, found_name
from bayesdamp.outcomes import following
from bayesdamp.physics.damping import TERMS, DampingTerm, others, parse_model
from bayesdamp.physics.restoring import LAWS
from bayesdamp.pipeline.keys import task_key
from bayesdamp.pipeline.records.records import NOT_APPLICABLE, RecordCell, SignalCell, cell_seed
from bayesdamp.pipeline.records.targets import Record
from bayesdamp.pipeline.tasks import Product
from bayesdamp.priors import Prior
from bayesdamp.serial import join, split
from bayesdamp.store import CellResult, Store
from bayesdamp.store.contents import AnswerContent
from bayesdamp.types import OK, Refusal
from bayesdamp.verdict.parts import Grade
from bayesdamp.verdict.specimen import Answered
from bayesdamp.verdict.types import Verdict

ANSWERED, SAMPLED = "answer", "sampled"
"""Kinds of the two cells."""
_MADE: dict[str, dict[str, Weighing]] = {}
"""By the key of an answer, the weighing that it was made of: that of the last record alone."""
NO_KERNEL = "not weighed at once: {names} cannot be compiled; give the term a `kernel`"


def answers(study: Study) -> bool:
    """Whether a study asks which damping its records have."""
    return bool(study.posterior.samplers or study.evidence.methods)


def approximately(study: Study, spec: SignalSpec) -> bool:
    """Whether a record's answer has laws hold approximately: of measured ones, where the study does not say."""
    asked = study.posterior.deviation
    return asked == "law" or (asked == "auto" and isinstance(spec.source, Recording))


def likelihood_of(study: Study) -> str:
    """The deviation of what a study samples, "law" or "none". Under "auto" its answer alone may deviate."""
    return "law" if study.posterior.deviation == "law" else "none"


class AnswerCell(RecordCell):
    """The verdict on one record, as `answer/SIGNAL/REPEAT`; with the likeliest candidates' motions sampled, as
    `sampled/SIGNAL/REPEAT`. Its key is of the record, the question, and the source of terms and laws."""

    def __init__(
        self, study: Study, spec: SignalSpec, repeat: int, store: Store, sample: bool = False
    ) -> None:
        super().__init__(SAMPLED if sample else ANSWERED, study, spec, repeat, store)
        self.sample, self.parent = sample, SignalCell(study, spec, repeat, store)

    @property
    def approximate(self) -> bool:
        """Whether laws may hold approximately."""
        return approximately(self.study, self.spec)

    def _key(self) -> str:
        priors = {t: str(p) for t, p in self.study.models.prior.items()}
        systems = [split(self.spec.under(law)) for law in self.spec.restoring]
        parts = (
            self.study.compare(self.spec),
            priors,
            systems,
            self.approximate,
            self.study.posterior.sensor,
            bool(self.spec.specimen),
            self.study.posterior.noise,
        )
        named = [*map(TERMS.source, self._terms), *map(LAWS.source, self.spec.restoring)]
        named += [*map(TERMS.source, others())]
        named += [*map(NOISES.source, noises_of(self.study.posterior.noise))]
        return task_key(self.kind, self.parent.key, *parts, named)

    def product(self) -> Product:
        """The verdict with what it rests on. Raises Refusal where nothing was weighed."""
        cell = self.store.read(self.parent.name)
        if cell.outcome != OK:
            raise Refusal(following(cell.name, cell.outcome))
        record = Record(self.study, self.spec, cell)
        if not record.content.noisy:
            raise Refusal(NOT_APPLICABLE)
        missing = [t for t in self._terms if TERMS.get(t).kernel is DampingTerm.kernel]
        if missing:
            raise Refusal(NO_KERNEL.format(names=", ".join(missing)))
        found = self._answer(record)
        outcome = found.verdict.sentence if found.verdict.grade is Grade.NOT_WEIGHED else OK
        return Product(found.content, {**found.arrays, **found.further}, outcome)

    @property
    def _terms(self) -> tuple[str, ...]:
        every = (parse_model(m) for m in self.study.dampings(self.spec))
        return tuple(dict.fromkeys(t for terms in every for t in terms))

    def _answer(self, record: Record) -> Answer:
        def known(law: str) -> Mapping[str, float]:
            system = record.system(law)
            chosen = "epsilon" in self.spec.under(law).known
            return {k: v for k, v in system.known.items() if chosen or k != "epsilon"}

        first = AnswerCell(self.study, self.spec, self.repeat, self.store).key
        if first not in _MADE:
            _MADE.clear()
        priors: dict[str, Prior] = stated_priors(self.study)
        for law in self.spec.restoring:
            priors |= {k: p for k, p in record.system(law).free.items() if p is not None}  # type: ignore[misc]
        return answer(
            record.signal,
            deviation="law" if self.approximate else "none",
            damping=self.study.dampings(self.spec),
            restoring=self.spec.restoring,
            known=known,
            priors=priors,
            reference=record.reference,
            sensor=self.study.posterior.sensor,
            measured=isinstance(self.spec.source, Recording),
            seed=cell_seed(self.study, self.name),
            notes=record.content.anomalies,
            sample=self.sample,
            made=_MADE.setdefault(first, {}),
            repeated=bool(self.spec.specimen),
            noise=self.study.posterior.noise,
        )


def stated_priors(study: Study) -> dict[str, Prior]:
    """The priors of damping terms that a study states, by parameter."""
    return {
        TERMS.get(t).parameter if t in TERMS.names() else t: p
        for t, p in study.models.prior.items()
        if p is not None
    }


def answer_cell(store: Store, signal: str, repeat: int) -> CellResult | None:
    """The latest answer on a record: with its motions sampled, else the first one; None where there is none."""
    for kind in (SAMPLED, ANSWERED):
        cell = store.find(f"{kind}/{signal}/{repeat}")
        if cell is not None and cell.outcome == OK:
            return cell
    return None


def law_of(store: Store, signal: str, repeat: int, damping: str, restoring: str) -> Found:
    """Where the search for a candidate with deviations ended. Raises Refusal where the answer has none."""
    cell = store.read(f"{ANSWERED}/{signal}/{repeat}")
    content = AnswerContent.maybe(cell)
    if content is None:
        raise Refusal(following(cell.name, cell.outcome))
    own = set(damping.split("+"))
    for one in content.laws:
        if set(one.damping.split("+")) == own and one.restoring == restoring:
            return join(Found, one.found, cell.arrays, found_name(one.damping, one.restoring))
    refused = (
        r.outcome for r in content.candidates if set(r.damping.split("+")) == own and r.restoring == restoring
    )
    raise Refusal(next(refused, ESCAPED))


def shortlist(store: Store, signal: str, repeat: int, nats: float, law: bool) -> set[tuple[str, str]] | None:
    """The candidates, (damping, restoring), that sampling may confirm or correct: those within so many nats of the best
    where laws hold as sampling takes them to, and the best under approximate ones; None where nothing was weighed at
    once. law: whether they may hold approximately."""
    content = AnswerContent.maybe(store.find(f"{ANSWERED}/{signal}/{repeat}"))
    weighed = [r for r in content.candidates if r.outcome == OK] if content else []
    if not weighed:
        return None
    about = [(r.log_evidence, r) for r in weighed if r.log_evidence is not None]
    heights = about if law and about else [(r.exact, r) for r in weighed]
    top = max(height for height, _ in heights)
    found = {(r.damping, r.restoring) for height, r in heights if top - height < nats}
    if about:
        _, first = max(about, key=lambda pair: pair[0])
        found.add((first.damping, first.restoring))
    return found


def answer_of(store: Store, signal: str, repeat: int) -> Answer | None:
    """The latest answer that is stored of a record; None where there is none."""
    cell = answer_cell(store, signal, repeat)
    return None if cell is None else Answer(AnswerContent.of(cell), cell.arrays)


def verdict_of(store: Store, signal: str, repeat: int) -> Verdict | None:
    """The verdict that is stored of a record; None where there is none."""
    found = answer_of(store, signal, repeat)
    return None if found is None else found.verdict


def answered_of(store: Store, signal: str, repeat: int) -> Answered | None:
    """What a verdict on several records takes of one; None where nothing was weighed."""
    found = answer_of(store, signal, repeat)
    return None if found is None or not found.candidates else found.of_specimen()
