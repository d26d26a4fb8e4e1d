"""Whether sampling confirms what was said at once, and what laws that hold exactly would say."""

from __future__ import annotations

from bayesdamp.outcomes import reason_of
from bayesdamp.report import words
from bayesdamp.report.results.answers import answer_of
from bayesdamp.report.results.reading import damping_of, ranking
from bayesdamp.report.results.run import Run
from bayesdamp.store.contents.answers import AnswerContent
from bayesdamp.types import OK
from bayesdamp.verdict.agreement import Agreement, agreement
from bayesdamp.verdict.types import Grade, Verdict


def sampled_words(found: Agreement) -> str:
    """What sampling the motions made of an answer, in a sentence."""
    if found.confirms:
        return "Sampling the motions themselves confirms it."
    if found.same:
        return f"Sampling the motions themselves moves the damping ratio by {found.moved:.1f} standard deviations:"
    return "Sampling the motions themselves corrects it:"


def sampled(run: Run, signal: str) -> str:
    """The same of a record's stored answers; empty where it was not sampled."""
    repeat = run.repeats(signal)[0]
    cells = [run.cell(kind, signal, repeat) for kind in ("answer", "sampled")]
    verdicts = [
        Verdict.from_dict(AnswerContent.of(c).verdict) for c in cells if c is not None and c.outcome == OK
    ]
    if len(verdicts) < 2 or verdicts[0].grade is Grade.NO_FREE_DECAY:
        return ""
    found = agreement(*verdicts)
    if found.confirms:
        return "Sampling the motions themselves confirms what their linear models said."
    if found.same:
        return (
            "This is from sampled motions; their linear models had the damping ratio up to "
            f"{found.moved:.1f} standard deviations elsewhere."
        )
    return f"This is from sampled motions; their linear models alone had said: {verdicts[0].sentence}"


def confirmation(run: Run, signal: str) -> str:
    """A sentence on what the evidence under exact laws, by sampling, says of a record; empty where none was sampled."""
    repeat = run.repeats(signal)[0]
    answer, found = answer_of(run, signal, repeat), ranking(run, signal, repeat)
    if answer is None or found is None or found.method == "laplace":
        return ""
    own = set(answer.verdict.damping.split("+"))
    lost = next((row for row in found.lost if set(damping_of(row).split("+")) == own), None)
    if lost is not None:
        why = reason_of(lost["outcome"])
        return f"{words.model(answer.verdict.damping)}: sampling has nothing to say of it ({why})."
    first = damping_of(found.best)
    share = words.probability(found.dampings[first])
    if set(first.split("+")) == own:
        return f"Exact laws, sampled, agree: {words.model(first)} has probability {share} under them."
    return (
        f"Exact laws, sampled, put {words.model(first)} first, with probability {share}: the choice hangs on how "
        "well the laws hold."
    )
