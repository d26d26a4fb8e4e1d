"""One sentence a record: whether anything fits, before any probability."""

from __future__ import annotations

from dataclasses import dataclass

from bayesdamp.report import words
from bayesdamp.report.reading import ASIDE, label, ranking
from bayesdamp.report.run import Run, rows_of

SURE = 0.95
"""Probability from which a candidate is named without reservation."""
TIE = 0.05
"""Probability from which another candidate is named beside the first."""
MISFIT = "does not fit"


@dataclass(frozen=True)
class Verdict:
    """misfit: whether the sentence, the first to read, warns that no candidate or not the most probable one fits."""

    misfit: bool
    sentence: str


def verdict(run: Run, signal: str, repeat: int) -> Verdict:
    """What a record's tables say, in one sentence."""
    found = ranking(run, signal, repeat)
    if found is None:
        return Verdict(False, "nothing was weighed, so no damping can be named.")
    weighed = [row["model"] for row in found.rows if not row["outcome"].startswith(ASIDE)]
    checks = {r["model"]: r["verdict"] for r in rows_of(run.fits, signal=signal, repeat=repeat)}
    said = [checks[m] for m in weighed if m in checks]
    best = found.best
    ties = [label(r) for r in found.rows[1:] if r["probability"] >= TIE]
    share = words.probability(best["probability"])
    record = run.cell("signal", signal, repeat)
    odd = words.listing(record.meta.get("anomalies", ())) if record else ""
    if odd:
        sentence = (
            f"the record is no free decay of one oscillator, so no candidate fits: {odd}; of those that are compared "
            f"all the same, {label(best)} comes first, with a probability of {share} among them only."
        )
        return Verdict(True, sentence)
    if said and all(s.startswith(MISFIT) for s in said):
        why = checks[weighed[0]].removeprefix(MISFIT + ": ")
        sentence = (
            f"no candidate fits ({why}){_left(run, signal, repeat, weighed[0])}; of those that do not fit, "
            f"{label(best)} is least unlikely, with a probability of {share} among them only."
        )
        return Verdict(True, sentence)
    warned = checks.get(best["model"], "").startswith(MISFIT)
    if warned:
        lead = f"the most probable candidate, {label(best)}, {checks[best['model']]}; {share} is its share among all"
        fine = [label(r) for r in found.rows if checks.get(r["model"], MISFIT).startswith("fits")]
        less = f" Fitting, though less probable: {words.listing(fine)}." if fine else ""
        return Verdict(True, f"{lead}.{less}")
    name = label(best)
    if best["probability"] >= SURE:
        return Verdict(
            False, f"damping is {name}, with a probability of {share} among {len(found.rows)} candidates."
        )
    beside = f"; {words.listing(ties)} cannot be excluded" if ties else ""
    return Verdict(False, f"damping is most likely {name}, with a probability of {share}{beside}.")


def _left(run: Run, signal: str, repeat: int, model: str) -> str:
    """How large the residual of a candidate is: the misfit that a long record shows may be a small one."""
    cell = run.cell("mode", signal, repeat, model)
    size = cell.meta.get("share") if cell else None
    return f", leaving {words.number(100 * size, 2)} % of the amplitude unexplained" if size else ""
