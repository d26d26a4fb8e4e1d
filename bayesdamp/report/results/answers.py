"""The verdicts that a run's folder holds."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from bayesdamp.report.results.run import Run
from bayesdamp.store.contents.answers import AnswerContent, WeighedCandidate
from bayesdamp.types import OK
from bayesdamp.verdict.types import Verdict


@dataclass(frozen=True)
class Answer:
    """A record's verdict, what was weighed for it, and what its picture is drawn from."""

    signal: str
    repeat: int
    verdict: Verdict
    candidates: tuple[WeighedCandidate, ...]
    arrays: Mapping[str, np.ndarray]


def answer_of(run: Run, signal: str, repeat: int) -> Answer | None:
    """The answer on one record, with its motions sampled where they were; None where there is none."""
    found = (run.cell(kind, signal, repeat) for kind in ("sampled", "answer"))
    cell = next((c for c in found if c is not None and c.outcome == OK), None)
    if cell is None:
        return None
    content = AnswerContent.of(cell)
    return Answer(signal, repeat, Verdict.from_dict(content.verdict), content.candidates, cell.arrays)


def verdicts(run: Run) -> list[Verdict]:
    """The verdict of every record's first repeat, in the study's order."""
    found = (answer_of(run, signal, run.repeats(signal)[0]) for signal in run.signals)
    return [one.verdict for one in found if one is not None]


def only_answered(run: Run) -> bool:
    """Whether a run went no further than to answers: exact laws were neither fitted nor sampled."""
    return bool(verdicts(run)) and not any(run.cells("mode", signal) for signal in run.signals)
