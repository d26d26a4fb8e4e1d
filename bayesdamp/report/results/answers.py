"""The verdicts that a run's folder holds."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from bayesdamp.report.results.run import Run
from bayesdamp.types import OK
from bayesdamp.verdict.types import Verdict


@dataclass(frozen=True)
class Answer:
    """A record's verdict, what was weighed for it, and what its picture is drawn from."""

    signal: str
    repeat: int
    verdict: Verdict
    candidates: tuple[Mapping[str, object], ...]
    arrays: Mapping[str, np.ndarray]


def answer_of(run: Run, signal: str, repeat: int) -> Answer | None:
    """The answer on one record, with its motions sampled where they were; None where there is none."""
    found = (run.cell(kind, signal, repeat) for kind in ("sampled", "answer"))
    cell = next((c for c in found if c is not None and c.outcome == OK), None)
    if cell is None:
        return None
    verdict = Verdict.from_dict(cell.meta["verdict"])
    return Answer(signal, repeat, verdict, tuple(cell.meta["candidates"]), cell.arrays)


def verdicts(run: Run) -> list[Verdict]:
    """The verdict of every record's first repeat, in the study's order."""
    found = (answer_of(run, signal, run.repeats(signal)[0]) for signal in run.signals)
    return [one.verdict for one in found if one is not None]


def specimens(run: Run) -> list[Verdict]:
    """The verdict of every specimen that has several records."""
    try:
        found = json.loads((run.folder / "verdict.json").read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return []
    return [Verdict.from_dict(one) for one in found if one["record"] not in run.signals]


def only_answered(run: Run) -> bool:
    """Whether a run went no further than to answers: exact laws were neither fitted nor sampled."""
    return bool(verdicts(run)) and not any(run.cells("mode", signal) for signal in run.signals)
