"""Compute the answer on one record: the evidence of every damping model, the verdict and its numbers."""

from collections.abc import Mapping

from bayesdamp.config import Recording, SignalSpec, Study
from bayesdamp.inference.deviation.model_comparison import BEHIND, ModelComparison
from bayesdamp.inference.deviation.sample_noise import noises_of
from bayesdamp.inference.deviation.single import ESCAPED, FitState
from bayesdamp.inference.noise import NOISES
from bayesdamp.interface.answer import Answer, answer, law_prefix
from bayesdamp.physics.damping import TERMS, DampingTerm, others, parse_model
from bayesdamp.physics.restoring import LAWS
from bayesdamp.pipeline.records import NOT_APPLICABLE, StudyRecord
from bayesdamp.pipeline.tasks import Product, task_key, task_seed
from bayesdamp.priors import Prior
from bayesdamp.serial import join, split
from bayesdamp.store.results import AnswerContent
from bayesdamp.types import OK, Refusal, Status, following
from bayesdamp.verdict.parts import Grade

ANSWER, SAMPLED_ANSWER = "answer", "sampled"
"""Kinds of the two tasks that answer a record: by linear approximations of every model; and after that, with the
posteriors of the most probable models sampled."""
_COMPARISONS: dict[str, dict[str, ModelComparison]] = {}
"""Cache of the model comparison in the last answer of this process, by the key of that answer. The sampled answer on
the same record starts from this comparison instead of computing it again."""


def _terms_of(study: Study, spec: SignalSpec) -> tuple[str, ...]:
    """Return the damping terms of all sums that the study compares on a signal."""
    return tuple(dict.fromkeys(t for model in study.dampings(spec) for t in parse_model(model)))


def answer_key(record: StudyRecord, kind: str = ANSWER) -> str:
    """Return the key of the task `answer/SIGNAL/REPEAT` or `sampled/SIGNAL/REPEAT`.

    It depends on the record, the settings of the comparison, and the source of damping terms, laws and noise models.
    """
    study, spec = record.study, record.spec

    def compute() -> str:
        posterior = study.posterior
        parts = (
            study.compare(spec),
            {t: str(p) for t, p in study.models.prior.items()},
            [split(spec.under(law)) for law in spec.restoring],
            study.deviation_of(spec),
            posterior.sensor,
            bool(spec.specimen),
            posterior.noise,
        )
        named = [*map(TERMS.source, _terms_of(study, spec)), *map(LAWS.source, spec.restoring)]
        named += [*map(TERMS.source, others()), *map(NOISES.source, noises_of(posterior.noise))]
        return task_key(kind, record.key, *parts, named)

    return record.store.key(f"{kind}/{record.name}", (study, spec), compute)


def compute_answer(record: StudyRecord, kind: str) -> Product:
    """Compute the answer on a record. If no candidate can be fitted, its outcome is the verdict's sentence.

    The content is an `AnswerContent`. kind: `ANSWER`, by linear approximations, or `SAMPLED_ANSWER`, which starts from
    the comparison of the first answer if this process has computed it. Raises Refusal if the outcome of the record is
    not OK (it shows no oscillation, for example), if it has no noise, or if a damping term has no kernel (its force as
    a function that can be compiled for the ODE solver).
    """
    study, spec, result = record.study, record.spec, record.result
    if result.outcome != OK:
        raise Refusal(following(result.name, result.outcome))
    if not record.content.noisy:
        raise Refusal(NOT_APPLICABLE)
    missing = [t for t in _terms_of(study, spec) if TERMS.get(t).kernel is DampingTerm.kernel]
    if missing:
        what = f"the damping {', '.join(missing)} has no `kernel`, the force in a form that can be compiled"
        raise Refusal(f"not compared: {what}; add it to the plug-in of the term")

    def known(law: str) -> Mapping[str, float]:
        system = record.system(law)
        is_given = "epsilon" in spec.under(law).known
        return {k: v for k, v in system.known.items() if is_given or k != "epsilon"}

    # The sampled answer starts from the fits of the first answer.
    first = answer_key(record)
    if first not in _COMPARISONS:
        _COMPARISONS.clear()
    priors: dict[str, Prior] = study.priors
    for law in spec.restoring:
        priors |= {k: p for k, p in record.system(law).free.items() if p is not None}  # type: ignore[misc]
    computed = answer(
        record.signal,
        deviation=study.deviation_of(spec),
        damping=study.dampings(spec),
        restoring=spec.restoring,
        known=known,
        priors=priors,
        reference=record.content.scales,
        sensor=study.posterior.sensor,
        measured=isinstance(spec.source, Recording),
        seed=task_seed(study, f"{kind}/{record.name}"),
        notes=record.content.anomalies,
        sample=kind == SAMPLED_ANSWER,
        comparisons=_COMPARISONS.setdefault(first, {}),
        repeated=bool(spec.specimen),
        noise=study.posterior.noise,
    )
    outcome = computed.verdict.sentence if computed.verdict.grade is Grade.NOT_WEIGHED else OK
    return Product(computed.content, {**computed.arrays, **computed.further}, outcome)


def stored_answer(record: StudyRecord) -> Answer | None:
    """Return the answer on a record that is stored, from sampling or else by linear approximations of each model.

    None if neither of the two is stored with the outcome OK.
    """
    for kind in (SAMPLED_ANSWER, ANSWER):
        result = record.find(kind)
        if result is not None and result.outcome == OK:
            return Answer(AnswerContent.of(result), result.arrays)
    return None


def stored_fit(record: StudyRecord, damping: str, restoring: str) -> FitState:
    """Return the fit of a candidate, with deviations from its laws, that the first answer on a record has stored.

    Raises Refusal if the answer has no content, or no such fit.
    """
    result = record.store.read(f"{ANSWER}/{record.name}")
    content = AnswerContent.maybe(result)
    if content is None:
        raise Refusal(following(result.name, result.outcome))
    for law in content.laws:
        if (law.damping, law.restoring) == (damping, restoring):
            return join(FitState, law.found, result.arrays, law_prefix(damping, restoring))
    outcomes = {(r.damping, r.restoring): r.outcome for r in content.candidates}
    why = outcomes.get((damping, restoring), ESCAPED)
    raise Refusal(Status.PRUNED.because(why) if why == BEHIND else why)


def rank_candidates(record: StudyRecord, nats: float | None) -> list[tuple[str, str]]:
    """Return the candidates, (damping, restoring), of the first answer on a record, by their log evidence, best first.

    Those at least `nats` below the largest one are left out, unless `nats` is None. If the study's samplers allow
    deviations from the laws, and any candidate has an evidence with deviations, these evidences are used, otherwise
    those under exact laws. Candidates without this evidence are left out. The candidate with the largest log evidence
    with deviations is always returned.

    The list is empty if there is no answer, or no candidate could be fitted.
    """
    content = AnswerContent.maybe(record.find(ANSWER))
    usable = [r for r in content.candidates if r.outcome == OK] if content else []
    approximate = {(r.damping, r.restoring): r.log_evidence for r in usable if r.log_evidence is not None}
    exact = {(r.damping, r.restoring): r.exact for r in usable}
    logs = approximate if approximate and record.study.likelihood == "law" else exact
    ranked = sorted(logs, key=logs.__getitem__, reverse=True)
    chosen = [c for c in ranked if nats is None or logs[ranked[0]] - logs[c] < nats]
    named = max(approximate, key=approximate.__getitem__, default=None)
    return chosen if named is None or named in chosen else [*chosen, named]
