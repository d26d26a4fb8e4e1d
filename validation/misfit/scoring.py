"""Answer a simulated case as a user's file and score the quick answer: a row for each case."""

from __future__ import annotations

import tempfile
import time
from pathlib import Path

from bayesdamp.cli.records import ReadingOptions, records_in
from bayesdamp.interface.answer import answer
from bayesdamp.types import InputError
from bayesdamp.verdict.parts import Grade
from bayesdamp.verdict.types import Verdict
from validation.misfit.cases import Case, drawn

COLUMNS = (
    "case", "kind", "truth", "noise_pct", "outcome", "grade", "motion", "damping", "probability", "deviation",
    "seconds", "sentence",
)  # fmt: skip
REFUSED, OPEN, RIGHT, WRONG = "refused", "open", "right", "wrong"
"""Outcomes: no damping is given; none is named without reservation; the true one is, or another."""
NO_ANSWER = (Grade.NO_FREE_DECAY, Grade.NOT_WEIGHED)


def row(kind: str, number: int, seed: int) -> dict[str, object]:
    """Return the row of case `number` of a kind under a seed."""
    return score(drawn(kind, number, seed))


def score(case: Case) -> dict[str, object]:
    """Return the row of a case, read from a CSV file and answered as `bayesdamp compare --quick` does.

    Its seconds are processor time.
    """
    began = time.process_time()
    head: dict[str, object] = {
        "case": case.name, "kind": case.kind, "truth": case.damping, "noise_pct": f"{100 * case.noise:.3g}",
    }  # fmt: skip
    with tempfile.TemporaryDirectory() as folder:
        verdict = _verdict(case, Path(folder) / "record.csv")
    spent = {"seconds": f"{time.process_time() - began:.1f}"}
    if isinstance(verdict, str):
        return {**head, "outcome": REFUSED, "sentence": verdict, **spent}
    return {
        **head, **spent,
        "outcome": outcome(verdict, case.damping),
        "grade": str(verdict.grade),
        "motion": "" if verdict.motion is None else str(verdict.motion),
        "damping": verdict.damping,
        "probability": "" if verdict.grade in NO_ANSWER else f"{verdict.probability:.4f}",
        "deviation": "" if verdict.deviation is None else f"{verdict.deviation.value:.3g}",
        "sentence": verdict.sentence,
    }  # fmt: skip


def outcome(verdict: Verdict, truth: str) -> str:
    """Return the outcome of a verdict, given the true damping."""
    if verdict.grade in NO_ANSWER:
        return REFUSED
    if not verdict.decided:
        return OPEN
    return RIGHT if set(verdict.damping.split("+")) == set(truth.split("+")) else WRONG


def _verdict(case: Case, file: Path) -> Verdict | str:
    """Return the verdict, or why the file is refused."""
    lines = [f"{t!r},{y!r}" for t, y in zip(case.t.tolist(), case.y.tolist(), strict=True)]
    file.write_text("\n".join(["t,angle", *lines]) + "\n", encoding="utf-8")
    try:
        (record,) = records_in(file, ReadingOptions(time="t", angle="angle", unit="rad"))
    except InputError as refusal:
        return str(refusal).replace(str(file.parent), "")
    if record.signal is None:
        return record.refusal
    return answer(record.signal, sample=False).verdict
