"""Whether sampling confirms what was said at once, and what samplers and evidence say of it."""

from __future__ import annotations

import numpy as np

from bayesdamp.outcomes import reason_of
from bayesdamp.report import words
from bayesdamp.report.results.answers import answer_of
from bayesdamp.report.results.reading import damping_of, ranking
from bayesdamp.report.results.run import Run
from bayesdamp.store.contents.answers import AnswerContent
from bayesdamp.store.contents.posteriors import PosteriorContent
from bayesdamp.types import OK
from bayesdamp.verdict.agreement import Agreement, agreement, intervals
from bayesdamp.verdict.parts import Grade
from bayesdamp.verdict.types import Verdict
from bayesdamp.verdict.units import in_unit
from bayesdamp.verdict.words import with_interval


def sampled_words(found: Agreement) -> str:
    """What sampling the motions made of an answer, in a sentence."""
    if found.confirms:
        return "Sampling the motions themselves confirms it."
    if found.same:
        by = f"{found.moved:.1f} of those standard deviations"
        return f"Sampling the motions themselves moves the damping ratio by {by}:"
    return "Sampling the motions themselves corrects it:"


def sampled(run: Run, signal: str) -> str:
    """The same of a record's stored answers; empty where it was not sampled."""
    repeat = run.repeats(signal)[0]
    cells = [run.cell(kind, signal, repeat) for kind in ("answer", "sampled")]
    verdicts = [
        in_unit(Verdict.from_dict(AnswerContent.of(c).verdict), run.unit(signal))
        for c in cells
        if c is not None and c.outcome == OK
    ]
    if len(verdicts) < 2 or verdicts[0].grade is Grade.NO_FREE_DECAY or verdicts[-1].law_free:
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
    """A sentence on what samplers and evidence say of an answer: under exact laws, or where the study has it so with
    the answer's own deviations; empty where none was sampled, or the answer is measured without a law."""
    repeat = run.repeats(signal)[0]
    answer = answer_of(run, signal, repeat)
    if answer is not None and answer.verdict.law_free:
        return ""
    if run.under_law:
        return " ".join(filter(None, (_intervals(run, signal, repeat), _same_sum(run, signal, repeat))))
    found = ranking(run, signal, repeat)
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


def _intervals(run: Run, signal: str, repeat: int) -> str:
    """Whether chains with the deviations integrated out confirm the intervals of the damping ratio, or correct them."""
    answer = answer_of(run, signal, repeat)
    drawn = _ratios(run, signal, repeat, answer.verdict) if answer is not None else None
    if answer is None or drawn is None:
        return ""
    sampler, ratios = drawn
    verdict, whose = answer.verdict, f"{words.method(sampler)}, the deviations integrated out,"
    if verdict.probability < 0.5 and verdict.rivals and verdict.rivals[0].probability > verdict.probability:
        share, rival = words.probability(verdict.probability), verdict.rivals[0]
        return (
            f"{whose} is of {words.model(verdict.damping)} alone, to which the answer gives {share}, and "
            f"{words.probability(rival.probability)} to {words.model(rival.damping)}."
        )
    found = intervals(verdict, ratios)
    if found.confirms:
        return f"{whose} confirms the intervals of the damping ratio."
    i = next(k for k, r in enumerate(answer.verdict.damping_ratio) if r.amplitude == found.amplitude)
    at = answer.verdict.damping_ratio[i]
    said = with_interval(*ratios[i], " %", 100)
    return (
        f"{whose} corrects the intervals: at {at.amplitude:.2g} {at.unit} the damping ratio is {said}, which moves it "
        f"by {found.moved:.1f} of its standard deviations and is {found.wider:.1f} times as wide."
    )


def _ratios(
    run: Run, signal: str, repeat: int, verdict: Verdict
) -> tuple[str, list[tuple[float, float, float]]] | None:
    """The sampler, and (value, low, high) of the damping ratio at the verdict's amplitudes: averaged over the sums by
    their evidence where that was done, else of the verdict's own sum."""
    if not verdict.damping_ratio:
        return None
    scale = run.unit(signal).displacement.scale
    averaged = run.cell("averaged", signal, repeat)
    if averaged is not None and averaged.outcome == OK and averaged.arrays["amplitudes"].size > 1:
        at = np.log([r.amplitude / scale for r in verdict.damping_ratio])
        grid = np.log(averaged.arrays["amplitudes"])
        low, middle, high = (np.interp(at, grid, row) for row in averaged.arrays["curve/equivalent_ratio"])
        return "nuts", [(float(m), float(a), float(b)) for a, m, b in zip(low, middle, high, strict=True)]
    own = set(verdict.damping.split("+"))
    rows = [r for r in run.posteriors if r["signal"] == signal and set(damping_of(r).split("+")) == own]
    trusted = [r for r in rows if r["restoring"] == verdict.restoring and r["outcome"] == OK]
    for model, sampler in dict.fromkeys((r["model"], r["sampler"]) for r in trusted):
        content = PosteriorContent.maybe(run.cell("posterior", signal, repeat, model, sampler))
        if content is not None and len(content.ratios) == len(verdict.damping_ratio):
            return sampler, [(r.value, r.low, r.high) for r in content.ratios]
    return None


def _same_sum(run: Run, signal: str, repeat: int) -> str:
    """Whether evidence with the same deviations puts the verdict's sum first."""
    answer, found = answer_of(run, signal, repeat), ranking(run, signal, repeat)
    if answer is None or found is None or len(found.dampings) < 2:
        return ""
    first = damping_of(found.best)
    whose = f"Evidence with the same deviations ({words.method(found.method)})"
    share = words.probability(found.dampings[first])
    if set(first.split("+")) == set(answer.verdict.damping.split("+")):
        return f"{whose} agrees: {words.model(first)} has probability {share}."
    return f"{whose} puts {words.model(first)} first, with probability {share}."
