"""A simulated case as a user's file through the quick answer, and what is said of it: a row a case."""

from __future__ import annotations

import tempfile
import time
from pathlib import Path

from bayesdamp.cli.records import ReadingOptions as Options
from bayesdamp.cli.records import records_in as found_records
from bayesdamp.interface.answer import answer
from bayesdamp.types import InputError
from bayesdamp.verdict.parts import Grade
from bayesdamp.verdict.types import Verdict
from tests.misfit.cases import Case, drawn

COLUMNS = (
    "case", "kind", "truth", "noise_pct", "outcome", "grade", "motion", "damping", "probability", "deviation",
    "seconds", "sentence",
)  # fmt: skip
REFUSED, OPEN, RIGHT, WRONG = "refused", "open", "right", "wrong"
"""What comes of a case: no damping is told; none is named outright; one is, the true one or another."""
NO_ANSWER = (Grade.NO_FREE_DECAY, Grade.NOT_WEIGHED)


def row(kind: str, number: int, seed: int) -> dict[str, object]:
    """The row of case `number` of a kind under a seed."""
    return score(drawn(kind, number, seed))


def score(case: Case) -> dict[str, object]:
    """The row of one case, read from a CSV and answered as `bayesdamp compare --quick` does.

    seconds: of the processor.
    """
    began = time.process_time()
    head: dict[str, object] = {
        "case": case.name, "kind": case.kind, "truth": case.damping, "noise_pct": f"{100 * case.noise:.3g}",
    }  # fmt: skip
    with tempfile.TemporaryDirectory() as folder:
        said = _verdict(case, Path(folder) / "record.csv")
    spent = {"seconds": f"{time.process_time() - began:.1f}"}
    if isinstance(said, str):
        return {**head, "outcome": REFUSED, "sentence": said, **spent}
    return {
        **head, **spent,
        "outcome": outcome(said, case.damping),
        "grade": str(said.grade),
        "motion": "" if said.motion is None else str(said.motion),
        "damping": said.damping,
        "probability": "" if said.grade in NO_ANSWER else f"{said.probability:.4f}",
        "deviation": "" if said.deviation is None else f"{said.deviation.value:.3g}",
        "sentence": said.sentence,
    }  # fmt: skip


def outcome(said: Verdict, truth: str) -> str:
    """What comes of a verdict where this is the true damping."""
    if said.grade in NO_ANSWER:
        return REFUSED
    if not said.decided:
        return OPEN
    return RIGHT if set(said.damping.split("+")) == set(truth.split("+")) else WRONG


def _verdict(case: Case, file: Path) -> Verdict | str:
    """The verdict, or why the file is refused."""
    lines = [f"{t!r},{y!r}" for t, y in zip(case.t.tolist(), case.y.tolist(), strict=True)]
    file.write_text("\n".join(["t,angle", *lines]) + "\n", encoding="utf-8")
    try:
        (found,) = found_records(file, Options(time="t", angle="angle", unit="rad"))
    except InputError as refusal:
        return str(refusal).replace(str(file.parent), "")
    if found.signal is None:
        return found.refusal
    return answer(found.signal, sample=False).verdict
