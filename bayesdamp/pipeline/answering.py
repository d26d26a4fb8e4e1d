"""Compute the answer on one record: the evidence of every damping model, and the verdict with its numbers."""

from collections.abc import Mapping

from bayesdamp.config import Recording, SignalSpec, Study
from bayesdamp.inference.deviation.model_comparison import FAR_BEHIND, ModelComparison
from bayesdamp.inference.deviation.sample_noise import noises_of
from bayesdamp.inference.deviation.single import ESCAPED, FitState
from bayesdamp.inference.noise import NOISES
from bayesdamp.interface.answer import Answer, answer, compare_models, law_prefix
from bayesdamp.physics.damping import TERMS, DampingTerm, others, parse_model
from bayesdamp.physics.restoring import LAWS
from bayesdamp.pipeline.records import NOT_APPLICABLE, StudyRecord
from bayesdamp.pipeline.tasks import Product, task_key, task_seed
from bayesdamp.priors import Prior
from bayesdamp.serial import join, split
from bayesdamp.store.results import AnswerContent
from bayesdamp.types import OK, Refusal, Status, following
from bayesdamp.verdict.parts import Grade
from bayesdamp.verdict.types import Verdict

ANSWER, SAMPLED_ANSWER = "answer", "sampled"
"""Names of two kinds of tasks. Both compute the answer on a record, which is the comparison of damping models with its
verdict: `ANSWER` from linear approximations of every model; `SAMPLED_ANSWER`, after it, also from draws of the
posteriors of the most probable models."""
_COMPARISONS: dict[str, ModelComparison | Verdict] = {}
"""Cache of the last result of `interface.answer.compare_models` in this process, by the key of the task `ANSWER` on the
record. The task `SAMPLED_ANSWER` on the same record starts from it instead of computing it again."""


def _terms_of(study: Study, spec: SignalSpec) -> tuple[str, ...]:
    """Return the names of all damping terms in the sums that the study compares on a signal, each once."""
    return tuple(dict.fromkeys(t for model in study.dampings(spec) for t in parse_model(model)))


def answer_key(record: StudyRecord, kind: str = ANSWER) -> str:
    """Return the key (hash of all inputs) of the task `answer/SIGNAL/REPEAT` or `sampled/SIGNAL/REPEAT`.

    It depends on the record, on the settings of the model comparison, and on the source code of the comparison, the
    damping terms, the restoring laws and the noise models. kind: `ANSWER` or `SAMPLED_ANSWER`.
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
    """Compute the answer on a record: compare its damping models, and form the verdict.

    The content of the result is an `AnswerContent`; its arrays are `Answer.arrays` (for the figure) and
    `Answer.further` (draws and fits) of `interface.answer`. If no model can be fitted, the outcome is the verdict's
    sentence, which gives the reason; otherwise it is OK.

    kind: `ANSWER`, by linear approximations; or `SAMPLED_ANSWER`, which starts from the comparison of `ANSWER` if this
    process has computed it just before, and computes it first otherwise.

    Raises Refusal in three cases: the outcome of the record is not OK (for example, it shows no oscillation), the
    record has no noise, or a damping term has no kernel (its force as a function that can be compiled for the ODE
    solver).
    """
    study, spec, result = record.study, record.spec, record.result
    if result.outcome != OK:
        raise Refusal(following(result.name, result.outcome))
    if not record.content.noisy:
        raise Refusal(NOT_APPLICABLE)
    missing = [t for t in _terms_of(study, spec) if TERMS.get(t).kernel is DampingTerm.kernel]
    if missing:
        what = f"damping {', '.join(missing)} has no `kernel` (a force function that can be compiled)"
        raise Refusal(
            f"the damping models are not compared, because {what}; add one to the plug-in of the term"
        )

    def known(law: str) -> Mapping[str, float]:
        system = record.system(law)
        is_given = "epsilon" in spec.under(law).known
        return {k: v for k, v in system.known.items() if is_given or k != "epsilon"}

    priors: dict[str, Prior] = study.priors
    for law in spec.restoring:
        priors |= {k: p for k, p in record.system(law).free.items() if p is not None}  # type: ignore[misc]
    first = answer_key(record)
    if first not in _COMPARISONS:
        _COMPARISONS.clear()
        _COMPARISONS[first] = compare_models(
            record.signal,
            deviation=study.deviation_of(spec),
            damping=study.dampings(spec),
            restoring=spec.restoring,
            known=known,
            priors=priors,
            reference=record.content.scales,
            noise=study.posterior.noise,
        )
    computed = answer(
        record.signal,
        _COMPARISONS[first],
        sensor=study.posterior.sensor,
        measured=isinstance(spec.source, Recording),
        seed=task_seed(study, f"{kind}/{record.name}"),
        notes=record.content.anomalies,
        sample=kind == SAMPLED_ANSWER,
        repeated=bool(spec.specimen),
    )
    outcome = computed.verdict.sentence if computed.verdict.grade is Grade.NOT_WEIGHED else OK
    return Product(computed.content, {**computed.arrays, **computed.further}, outcome)


def stored_answer(record: StudyRecord) -> Answer | None:
    """Return the stored answer on a record: from sampling, or if there is none, from linear approximations.

    None if neither of the two is stored with the outcome OK.
    """
    for kind in (SAMPLED_ANSWER, ANSWER):
        result = record.find(kind)
        if result is not None and result.outcome == OK:
            return Answer(AnswerContent.of(result), result.arrays)
    return None


def stored_fit(record: StudyRecord, damping: str, restoring: str) -> FitState:
    """Return the fit of one model, allowing deviations from its laws, that the task `ANSWER` on a record has stored.

    damping, restoring: the sum of damping terms and the restoring law of the model. Raises Refusal if the task stored
    no values, or not this fit, and KeyError if the task has no stored result.
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
    raise Refusal(Status.PRUNED.because(why) if why == FAR_BEHIND else why)


def rank_candidates(record: StudyRecord, nats: float | None) -> list[tuple[str, str]]:
    """Rank the candidates (models) that the task `ANSWER` compared on a record by log evidence, the largest first.

    Returns pairs (damping sum, restoring law). The list is empty if there is no answer, or if no candidate could be
    fitted.

    - The log evidence allows deviations from the laws if the study's samplers allow them and any candidate has such an
      evidence. Otherwise it assumes exact laws. Candidates without this evidence are left out.
    - Candidates whose log evidence is at least `nats` below the largest one are left out, unless `nats` is None.
    - The candidate with the largest log evidence that allows deviations is always in the list, if necessary at its end.
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
