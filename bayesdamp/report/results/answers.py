"""The verdicts that a run's folder holds."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from bayesdamp.report.results.run import Run
from bayesdamp.store.contents import AnswerContent, EnvelopeContent, WeighedCandidate
from bayesdamp.types import OK
from bayesdamp.verdict.types import Verdict
from bayesdamp.verdict.units import in_unit, picture_in_unit


@dataclass(frozen=True)
class Answer:
    """A record's verdict, what was weighed for it, and what its picture is drawn from; lengths in the record's unit."""

    signal: str
    repeat: int
    verdict: Verdict
    candidates: tuple[WeighedCandidate, ...]
    arrays: Mapping[str, np.ndarray]
    envelope: EnvelopeContent | None = None


def content_of(run: Run, signal: str) -> AnswerContent | None:
    """Return what is stored of the answer on one record before sampling; None where no law is the answer."""
    cell = run.cell("answer", signal, run.repeats(signal)[0])
    content = AnswerContent.of(cell) if cell is not None and cell.outcome == OK else None
    return None if content is None or content.verdict.get("law_free") else content


def answer_of(run: Run, signal: str, repeat: int) -> Answer | None:
    """The answer on one record, with its motions sampled where they were; None where there is none."""
    found = (run.cell(kind, signal, repeat) for kind in ("sampled", "answer"))
    cell = next((c for c in found if c is not None and c.outcome == OK), None)
    if cell is None:
        return None
    unit = run.unit(signal)
    content = AnswerContent.of(cell)
    verdict = in_unit(Verdict.from_dict(content.verdict), unit)
    arrays = picture_in_unit(cell.arrays, unit)
    return Answer(signal, repeat, verdict, content.candidates, arrays, content.envelope)


def answers(run: Run) -> list[Answer]:
    """The answer on every record's first repeat, in the study's order."""
    found = (answer_of(run, signal, run.repeats(signal)[0]) for signal in run.signals)
    return [one for one in found if one is not None]


def specimens(run: Run) -> list[Verdict]:
    """The verdict of every specimen that has several records."""
    together = [v for v in run.verdicts if v.record not in run.signals]
    units = {run.unit(signal) for signal in run.signals}
    return [in_unit(v, next(iter(units))) for v in together] if len(units) == 1 else together


def only_answered(run: Run) -> bool:
    """Whether a run went no further than to answers: exact laws were neither fitted nor sampled."""
    answered = any(answer_of(run, signal, run.repeats(signal)[0]) for signal in run.signals)
    return answered and not any(run.cells("mode", signal) for signal in run.signals)
