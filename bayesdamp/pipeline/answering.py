"""Compute the answer on one record: the evidence of every damping model, the verdict and its numbers."""

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
from bayesdamp.pipeline.tasks import Product, task_key, task_seed
from bayesdamp.priors import Prior
from bayesdamp.serial import join, split
from bayesdamp.store import Store, TaskResult
from bayesdamp.store.contents import AnswerContent
from bayesdamp.types import OK, Refusal
from bayesdamp.verdict.parts import Grade
from bayesdamp.verdict.specimen import RecordAnswer
from bayesdamp.verdict.types import Verdict

ANSWER, SAMPLED_ANSWER = "answer", "sampled"
"""Kinds of the two tasks that answer a record: by linear approximations of every model; and after that, with the
posteriors of the most probable models sampled."""
_COMPARISONS: dict[str, dict[str, ModelComparison]] = {}
"""Cache of the model comparison in the last answer of this process, by the key of that answer. The sampled answer on
the same record starts from this comparison instead of computing it again."""


def asks_for_answers(study: Study) -> bool:
    """Return whether a study compares damping models, that is, names samplers or evidence methods."""
    return bool(study.posterior.samplers or study.evidence.methods)


def is_approximate(study: Study, spec: SignalSpec) -> bool:
    """Return whether the answer on a record allows deviations from the laws.

    If the study's setting `deviation` is "auto" (the default), it does so only for a measured record.
    """
    deviation = study.posterior.deviation
    return deviation == "law" or (deviation == "auto" and isinstance(spec.source, Recording))


def likelihood_of(study: Study) -> str:
    """Return "law" if the study's samplers and evidence methods allow deviations from the laws, else "none".

    If the study's setting `deviation` is "auto", this is "none": only the answer then allows deviations.
    """
    return "law" if study.posterior.deviation == "law" else "none"


def stated_priors(study: Study) -> dict[str, Prior]:
    """Return the priors that a study states for damping terms, by parameter."""
    return {
        TERMS.get(t).parameter if t in TERMS.names() else t: p
        for t, p in study.models.prior.items()
        if p is not None
    }


def _terms_of(study: Study, spec: SignalSpec) -> tuple[str, ...]:
    """Return the damping terms of all sums that the study compares on a signal."""
    return tuple(dict.fromkeys(t for model in study.dampings(spec) for t in parse_model(model)))


def answer_key(study: Study, spec: SignalSpec, repeat: int, store: Store, kind: str = ANSWER) -> str:
    """Return the key of the task `answer/SIGNAL/REPEAT` or `sampled/SIGNAL/REPEAT`.

    It depends on the record, the settings of the comparison, and the source of damping terms, laws and noise models.
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


def compute_answer(study: Study, spec: SignalSpec, repeat: int, store: Store, kind: str = ANSWER) -> Product:
    """Compute the answer on a record. If no candidate can be fitted, its outcome is the verdict's sentence.

    kind: `ANSWER`, by linear approximations, or `SAMPLED_ANSWER`, which starts from the comparison of the first answer
    if this process has computed it. Raises Refusal if the outcome of the record is not OK (it shows no oscillation, for
    example), if it has no noise, or if a damping term has no kernel.
    """
    result = store.read(f"signal/{spec.name}/{repeat}")
    if result.outcome != OK:
        raise Refusal(following(result.name, result.outcome))
    record = StudyRecord(study, spec, result)
    if not record.content.noisy:
        raise Refusal(NOT_APPLICABLE)
    missing = [t for t in _terms_of(study, spec) if TERMS.get(t).kernel is DampingTerm.kernel]
    if missing:
        names = ", ".join(missing)
        raise Refusal(f"not compared: {names} cannot be compiled; give the term a `kernel`")

    def known(law: str) -> Mapping[str, float]:
        system = record.system(law)
        is_given = "epsilon" in spec.under(law).known
        return {k: v for k, v in system.known.items() if is_given or k != "epsilon"}

    # The sampled answer starts from the fits of the first answer.
    first = answer_key(study, spec, repeat, store)
    if first not in _COMPARISONS:
        _COMPARISONS.clear()
    priors: dict[str, Prior] = stated_priors(study)
    for law in spec.restoring:
        priors |= {k: p for k, p in record.system(law).free.items() if p is not None}  # type: ignore[misc]
    computed = answer(
        record.signal,
        deviation="law" if is_approximate(study, spec) else "none",
        damping=study.dampings(spec),
        restoring=spec.restoring,
        known=known,
        priors=priors,
        reference=record.content.scales,
        sensor=study.posterior.sensor,
        measured=isinstance(spec.source, Recording),
        seed=task_seed(study, f"{kind}/{spec.name}/{repeat}"),
        notes=record.content.anomalies,
        sample=kind == SAMPLED_ANSWER,
        comparisons=_COMPARISONS.setdefault(first, {}),
        repeated=bool(spec.specimen),
        noise=study.posterior.noise,
    )
    outcome = computed.verdict.sentence if computed.verdict.grade is Grade.NOT_WEIGHED else OK
    return Product(computed.content, {**computed.arrays, **computed.further}, outcome)


def answer_result(store: Store, signal: str, repeat: int) -> TaskResult | None:
    """Return the result of a record's sampled answer, else of its first answer; None if neither has the outcome OK."""
    for kind in (SAMPLED_ANSWER, ANSWER):
        result = store.find(f"{kind}/{signal}/{repeat}")
        if result is not None and result.outcome == OK:
            return result
    return None


def answer_of(store: Store, signal: str, repeat: int) -> Answer | None:
    """Return the stored answer on a record as `answer_result` chooses it; None if there is none."""
    result = answer_result(store, signal, repeat)
    return None if result is None else Answer(AnswerContent.of(result), result.arrays)


def verdict_of(store: Store, signal: str, repeat: int) -> Verdict | None:
    """Return the verdict in `answer_of`; None if there is no answer."""
    stored = answer_of(store, signal, repeat)
    return None if stored is None else stored.verdict


def specimen_input(store: Store, signal: str, repeat: int) -> RecordAnswer | None:
    """Return the part of a record's answer that the joint fit of a specimen uses; None if no candidate was compared."""
    stored = answer_of(store, signal, repeat)
    return None if stored is None or not stored.content.candidates else stored.of_specimen()


def stored_fit(store: Store, signal: str, repeat: int, damping: str, restoring: str) -> FitState:
    """Return the fit of a candidate, with deviations from its laws, that the first answer on a record has stored.

    Terms of the sum may be in any order. Raises Refusal if the answer has no content, or no such fit.
    """
    result = store.read(f"{ANSWER}/{signal}/{repeat}")
    content = AnswerContent.maybe(result)
    if content is None:
        raise Refusal(following(result.name, result.outcome))
    terms = set(damping.split("+"))
    for law in content.laws:
        if set(law.damping.split("+")) == terms and law.restoring == restoring:
            return join(FitState, law.found, result.arrays, law_prefix(law.damping, law.restoring))
    refused = (
        r.outcome
        for r in content.candidates
        if set(r.damping.split("+")) == terms and r.restoring == restoring
    )
    raise Refusal(next(refused, ESCAPED))


def shortlist(store: Store, signal: str, repeat: int, nats: float, law: bool) -> set[tuple[str, str]] | None:
    """Return the candidates, (damping, restoring), that are worth sampling.

    These are the candidates whose log evidence is near the largest, and always the one with the largest log evidence
    with deviations, if any has one. Candidates that could not be fitted are left out.

    Parameters
    ----------
    store
        Store of the run.
    signal, repeat
        Name and repeat of the record.
    nats
        A candidate is returned if its log evidence is less than this many nats below the largest one.
    law
        Whether to take the evidence with deviations from the laws instead of that under exact laws; candidates without
        it are then left out. If no candidate has it, that under exact laws is taken.

    Returns
    -------
    set or None
        None if there is no answer, or no candidate could be fitted.
    """
    content = AnswerContent.maybe(store.find(f"{ANSWER}/{signal}/{repeat}"))
    usable = [r for r in content.candidates if r.outcome == OK] if content else []
    if not usable:
        return None
    approximate = [(r.log_evidence, r) for r in usable if r.log_evidence is not None]
    logs = approximate if law and approximate else [(r.exact, r) for r in usable]
    top = max(log for log, _ in logs)
    chosen = {(r.damping, r.restoring) for log, r in logs if top - log < nats}
    if approximate:
        _, first = max(approximate, key=lambda pair: pair[0])
        chosen.add((first.damping, first.restoring))
    return chosen
