"""One sentence a record: whether anything fits, and whether the record decides, before any probability."""

from __future__ import annotations

from dataclasses import dataclass, replace

from bayesdamp.outcomes import Fitting, Status, fitting_of, reason_of, status_of
from bayesdamp.report import words
from bayesdamp.report.results.reading import (
    Ranking,
    damping_of,
    label,
    mode_of,
    other_forms,
    over_widths,
    ranking,
)
from bayesdamp.report.results.run import Run, rows_of
from bayesdamp.store.contents.records import RecordContent
from bayesdamp.types import OK, candidate_parts

SURE = 0.95
"""Probability from which a candidate is named without reservation."""
TIE = 0.05
"""Probability from which another candidate is named beside the first."""
HOLDS = 0.8
"""Probability that a candidate which is named without reservation keeps, whatever the width of the priors, and against
any other form of damping beside its own."""
FEW = 3
"""Forms of damping that a sentence lists."""


@dataclass(frozen=True)
class Verdict:
    """The first sentence to read.

    misfit: whether it warns that no candidate or not the most probable one fits; open: whether it says that the record,
    or the priors' width, leaves the answer open; rivals: other forms of damping that are not ruled out, the likeliest
    first, with the probability of the first candidate with each beside its own damping against it without.
    """

    misfit: bool
    sentence: str
    open: bool = False
    rivals: tuple[tuple[str, float], ...] = ()


def verdict(run: Run, signal: str, repeat: int) -> Verdict:
    """What a record's tables say, in one sentence."""
    found = ranking(run, signal, repeat)
    if found is None:
        return Verdict(
            False, f"nothing was weighed, so no damping can be named{_why(run, signal, repeat)}.", open=True
        )
    weighed = [row["model"] for row in found.rows if status_of(row["outcome"]) is not Status.PRUNED]
    # The checks of fits are of laws that hold exactly: where they need not, the answer says how well they do.
    fits = [] if run.under_law else rows_of(run.fits, signal=signal, repeat=repeat)
    checks = {r["model"]: r["verdict"] for r in fits}
    said = [checks[m] for m in weighed if m in checks]
    best = found.best
    share = words.probability(best["probability"])
    record = run.cell("signal", signal, repeat)
    content = RecordContent.maybe(record)
    odd = words.listing(content.anomalies) if content else ""
    if odd:
        sentence = (
            f"the record is no free decay of one oscillator, so no model fits: {odd}; of those that are compared "
            f"all the same, {label(best)} comes first, with probability {share} among them only."
        )
        return Verdict(True, sentence)
    if said and all(fitting_of(s) is Fitting.DOES_NOT_FIT for s in said):
        why = reason_of(checks[weighed[0]])
        sentence = (
            f"no model fits ({why}){_left(run, signal, repeat, weighed[0])}; of those that do not fit, "
            f"{label(best)} is least unlikely, with probability {share} among them only."
        )
        return Verdict(True, sentence)
    fitting = {m: fitting_of(text) for m, text in checks.items()}
    warned = fitting.get(best["model"]) is Fitting.DOES_NOT_FIT
    if warned:
        lead = (
            f"the most probable model, {label(best)}, {checks[best['model']]}; {share} is its share among all"
        )
        fine = [label(r) for r in found.rows if fitting.get(r["model"]) is Fitting.FITS]
        less = f" Fitting, though less probable: {words.listing(fine)}." if fine else ""
        return Verdict(True, f"{lead}.{less}")
    return _decided(run, signal, repeat, found)


def _decided(run: Run, signal: str, repeat: int, found: Ranking) -> Verdict:
    """What is said where the first candidate fits: of the damping, whatever the restoring law."""
    if found.lost:
        names = words.listing(label(row) for row in found.lost)
        rest = _decided(run, signal, repeat, replace(found, lost=()))
        why = found.lost[0]["outcome"].rstrip(".")
        return replace(rest, sentence=f"{names} could not be weighed ({why}); of the others, {rest.sentence}")
    if found.unsettled:
        names = words.listing(label(row) for row in found.unsettled)
        sentence = (
            f"the evidence of {names} is not settled, so the record is not said to decide: damping is most likely "
            f"{words.model(next(iter(found.dampings)))}, with probability "
            f"{words.probability(next(iter(found.dampings.values())))} as far as it is known."
        )
        return Verdict(False, sentence, open=True)
    dampings = found.dampings
    damping, probability = next(iter(dampings.items()))
    name, share = words.model(damping), words.probability(probability)
    if probability < SURE:
        ties = [words.model(d) for d, p in dampings.items() if d != damping and p >= TIE]
        between = f" between {words.listing([name, *ties])}" if ties else ""
        sentence = (
            f"the record does not decide{between}: damping is most likely {name}, with probability {share}."
        )
        return Verdict(False, sentence, open=True)
    lowest = min(over_widths(run, signal, repeat, found), key=lambda w: w.probability, default=None)
    if lowest is not None and lowest.probability < HOLDS:
        rival = lowest.second if lowest.first == name else lowest.first
        sentence = (
            f"how wide the priors are decides between {name} and {rival}: "
            f"damping is {name} with probability {share} among {len(found.rows)} models, but "
            f"{words.probability(lowest.probability)} under priors {words.number(lowest.factor, 2)} times as wide."
        )
        return Verdict(False, sentence, open=True)
    if found.best["probability"] < SURE:
        sentence = (
            f"damping is {name}, with probability {share} among {len(found.rows)} models{_laws(found)}."
        )
    else:
        share = words.probability(found.best["probability"])
        sentence = f"damping is {label(found.best)}, with probability {share} among {len(found.rows)} models."
    forms = [] if run.under_law else other_forms(run, signal, repeat, found.best["model"])
    rivals = tuple((form.words, form.probability) for form in forms if form.probability > 1 - HOLDS)
    if rivals:
        without = "that" if len(rivals) == 1 else "these"
        sentence = f"{_not_ruled_out(rivals)}; without {without}, {sentence}"
    return Verdict(False, sentence, open=bool(rivals), rivals=rivals)


def _laws(found: Ranking) -> str:
    """The restoring laws that a damping which is decided leaves open."""
    rows = [r for r in found.rows if damping_of(r) == damping_of(found.best)]
    laws = [(candidate_parts(r["model"])[1], r["probability"]) for r in rows]
    named = [f"{words.law(law)} ({words.probability(p)})" for law, p in laws if law and p >= TIE]
    return f"; the restoring law is left open: {words.listing(named, 'or')}" if len(named) > 1 else ""


def _not_ruled_out(rivals: tuple[tuple[str, float], ...]) -> str:
    """What the record leaves open beside its first candidate."""
    first, share = rivals[0][0], words.probability(rivals[0][1])
    named = [name for name, _ in rivals]
    if len(rivals) > FEW:
        return f"the record leaves open most other forms of damping (that {first}: {share})"
    if len(rivals) > 1:
        return f"the record leaves open whether {words.listing(named, 'or')} (the first: {share})"
    return f"the record leaves open whether {first} ({share})"


def _why(run: Run, signal: str, repeat: int) -> str:
    """What the first candidate without a mode says, or the choice of the noise."""
    cells = [run.cell("noise", signal, repeat)]
    cells += [run.cell("mode", signal, repeat, m) for m in run.info.get("models", ())]
    said = [cell.outcome for cell in cells if cell is not None and cell.outcome != OK]
    return f": {said[0].rstrip('.')}" if said else ""


def _left(run: Run, signal: str, repeat: int, model: str) -> str:
    """How large the residual of a candidate is: the misfit that a long record shows may be a small one."""
    mode = mode_of(run, signal, repeat, model)
    size = mode.share if mode else 0.0
    return f", leaving {words.number(100 * size, 2)} % of the amplitude unexplained" if size else ""
