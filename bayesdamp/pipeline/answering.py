"""The tasks that answer for one record: candidates weighed under laws that hold approximately, and the verdict."""

from __future__ import annotations

from collections.abc import Mapping

from bayesdamp.config import Recording, SignalSpec, Study
from bayesdamp.inference.deviation.model_comparison import ModelComparison
from bayesdamp.inference.deviation.sample_noise import noises_of
from bayesdamp.inference.deviation.single import ESCAPED, FitState
from bayesdamp.inference.noise import NOISES
from bayesdamp.interface.answer import Answer, answer, law_prefix
from bayesdamp.outcomes import following
from bayesdamp.physics.damping import TERMS, DampingTerm, others, parse_model
from bayesdamp.physics.restoring import LAWS
from bayesdamp.pipeline.records import NOT_APPLICABLE, StudyRecord, signal_key
from bayesdamp.pipeline.tasks import Product, cell_seed, task_key
from bayesdamp.priors import Prior
from bayesdamp.serial import join, split
from bayesdamp.store import CellResult, Store
from bayesdamp.store.contents import AnswerContent
from bayesdamp.types import OK, Refusal
from bayesdamp.verdict.parts import Grade
from bayesdamp.verdict.specimen import RecordAnswer
from bayesdamp.verdict.types import Verdict

ANSWERED, SAMPLED = "answer", "sampled"
"""Kinds of the two tasks: the answer, and the same with the likeliest candidates' motions sampled."""
_WEIGHINGS: dict[str, dict[str, ModelComparison]] = {}
"""The weighing behind an answer, by the answer's key: that of the last record alone."""


def asks_for_answers(study: Study) -> bool:
    """Return whether a study asks which damping its records have."""
    return bool(study.posterior.samplers or study.evidence.methods)


def is_approximate(study: Study, spec: SignalSpec) -> bool:
    """Return whether laws hold approximately in a record's answer: by default in that of a measured one."""
    deviation = study.posterior.deviation
    return deviation == "law" or (deviation == "auto" and isinstance(spec.source, Recording))


def likelihood_of(study: Study) -> str:
    """Return the deviation of what a study samples, "law" or "none". Under "auto" its answer alone may deviate."""
    return "law" if study.posterior.deviation == "law" else "none"


def stated_priors(study: Study) -> dict[str, Prior]:
    """Return the priors of damping terms that a study states, by parameter."""
    return {
        TERMS.get(t).parameter if t in TERMS.names() else t: p
        for t, p in study.models.prior.items()
        if p is not None
    }


def _terms_of(study: Study, spec: SignalSpec) -> tuple[str, ...]:
    return tuple(dict.fromkeys(t for model in study.dampings(spec) for t in parse_model(model)))


def answer_key(study: Study, spec: SignalSpec, repeat: int, store: Store, kind: str = ANSWERED) -> str:
    """Return the key of the verdict on a record, `answer/SIGNAL/REPEAT` or `sampled/SIGNAL/REPEAT`.

    It depends on the record, the study's question, and the source of terms, laws and noise models.
    """

    def compute() -> str:
        posterior = study.posterior
        parts = (
            study.compare(spec),
            {t: str(p) for t, p in study.models.prior.items()},
            [split(spec.under(law)) for law in spec.restoring],
            is_approximate(study, spec),
            posterior.sensor,
            bool(spec.specimen),
            posterior.noise,
        )
        named = [*map(TERMS.source, _terms_of(study, spec)), *map(LAWS.source, spec.restoring)]
        named += [*map(TERMS.source, others()), *map(NOISES.source, noises_of(posterior.noise))]
        return task_key(kind, signal_key(study, spec, repeat, store), *parts, named)

    return store.key(f"{kind}/{spec.name}/{repeat}", (study, spec), compute)


def compute_answer(
    study: Study, spec: SignalSpec, repeat: int, store: Store, kind: str = ANSWERED
) -> Product:
    """Return the verdict with the numbers behind it. Raises Refusal where nothing was weighed."""
    cell = store.read(f"signal/{spec.name}/{repeat}")
    if cell.outcome != OK:
        raise Refusal(following(cell.name, cell.outcome))
    record = StudyRecord(study, spec, cell)
    if not record.content.noisy:
        raise Refusal(NOT_APPLICABLE)
    missing = [t for t in _terms_of(study, spec) if TERMS.get(t).kernel is DampingTerm.kernel]
    if missing:
        names = ", ".join(missing)
        raise Refusal(f"not weighed: {names} cannot be compiled; give the term a `kernel`")

    def known(law: str) -> Mapping[str, float]:
        system = record.system(law)
        is_given = "epsilon" in spec.under(law).known
        return {k: v for k, v in system.known.items() if is_given or k != "epsilon"}

    # The sampled answer goes on from the weighing of the first one.
    first = answer_key(study, spec, repeat, store)
    if first not in _WEIGHINGS:
        _WEIGHINGS.clear()
    priors: dict[str, Prior] = stated_priors(study)
    for law in spec.restoring:
        priors |= {k: p for k, p in record.system(law).free.items() if p is not None}  # type: ignore[misc]
    result = answer(
        record.signal,
        deviation="law" if is_approximate(study, spec) else "none",
        damping=study.dampings(spec),
        restoring=spec.restoring,
        known=known,
        priors=priors,
        reference=record.content.scales,
        sensor=study.posterior.sensor,
        measured=isinstance(spec.source, Recording),
        seed=cell_seed(study, f"{kind}/{spec.name}/{repeat}"),
        notes=record.content.anomalies,
        sample=kind == SAMPLED,
        comparisons=_WEIGHINGS.setdefault(first, {}),
        repeated=bool(spec.specimen),
        noise=study.posterior.noise,
    )
    outcome = result.verdict.sentence if result.verdict.grade is Grade.NOT_WEIGHED else OK
    return Product(result.content, {**result.arrays, **result.further}, outcome)


def answer_cell(store: Store, signal: str, repeat: int) -> CellResult | None:
    """Return the latest answer on a record: with its motions sampled, else the first one; None where it has none."""
    for kind in (SAMPLED, ANSWERED):
        cell = store.find(f"{kind}/{signal}/{repeat}")
        if cell is not None and cell.outcome == OK:
            return cell
    return None


def answer_of(store: Store, signal: str, repeat: int) -> Answer | None:
    """Return the latest stored answer on a record; None where it has none."""
    cell = answer_cell(store, signal, repeat)
    return None if cell is None else Answer(AnswerContent.of(cell), cell.arrays)


def verdict_of(store: Store, signal: str, repeat: int) -> Verdict | None:
    """Return the stored verdict on a record; None where it has none."""
    stored = answer_of(store, signal, repeat)
    return None if stored is None else stored.verdict


def answered_of(store: Store, signal: str, repeat: int) -> RecordAnswer | None:
    """Return the part of a record's answer that a verdict on several records uses; None where nothing was weighed."""
    stored = answer_of(store, signal, repeat)
    return None if stored is None or not stored.content.candidates else stored.of_specimen()


def law_of(store: Store, signal: str, repeat: int, damping: str, restoring: str) -> FitState:
    """Return the end of the search for a candidate with deviations. Raises Refusal where the answer has none."""
    cell = store.read(f"{ANSWERED}/{signal}/{repeat}")
    content = AnswerContent.maybe(cell)
    if content is None:
        raise Refusal(following(cell.name, cell.outcome))
    own = set(damping.split("+"))
    for law in content.laws:
        if set(law.damping.split("+")) == own and law.restoring == restoring:
            return join(FitState, law.found, cell.arrays, law_prefix(law.damping, law.restoring))
    refused = (
        r.outcome for r in content.candidates if set(r.damping.split("+")) == own and r.restoring == restoring
    )
    raise Refusal(next(refused, ESCAPED))


def shortlist(store: Store, signal: str, repeat: int, nats: float, law: bool) -> set[tuple[str, str]] | None:
    """Return the candidates, (damping, restoring), that sampling may confirm or correct.

    These are the candidates within so many nats of the best where laws hold as sampling takes them to, and the best
    under approximate laws.

    Parameters
    ----------
    store
        The run's.
    signal, repeat
        The record.
    nats
        Greatest distance in log evidence.
    law
        Whether sampling takes laws to hold approximately.

    Returns
    -------
    set or None
        None where the answer weighed nothing.
    """
    content = AnswerContent.maybe(store.find(f"{ANSWERED}/{signal}/{repeat}"))
    weighed = [r for r in content.candidates if r.outcome == OK] if content else []
    if not weighed:
        return None
    approximate = [(r.log_evidence, r) for r in weighed if r.log_evidence is not None]
    heights = approximate if law and approximate else [(r.exact, r) for r in weighed]
    top = max(height for height, _ in heights)
    chosen = {(r.damping, r.restoring) for height, r in heights if top - height < nats}
    if approximate:
        _, first = max(approximate, key=lambda pair: pair[0])
        chosen.add((first.damping, first.restoring))
    return chosen
