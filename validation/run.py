"""Answers to simulated records and their scores: `python -m validation.run --group family --out FILE.csv`."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from importlib import import_module
from pathlib import Path

import pandas as pd

from bayesdamp.outcomes import Status, status_of
from bayesdamp.types import InputError
from validation.answers import COLUMNS, Row, row_of
from validation.rows import gathered, read_frame
from validation.scoring import markdown, scores
from validation.truth.records import FAMILY, KINDS, case

ANSWER = "validation.reports.verdicts:sampled_verdict"
DISCREPANT = "discrepant"


@dataclass(frozen=True)
class Job:
    """One record, by what it is drawn from."""

    kind: str
    seed: int
    number: int
    oversample: int

    @property
    def name(self) -> str:
        """The name of its case."""
        times = f"-x{self.oversample}" if self.oversample > 1 else ""
        return f"{self.kind}-{self.seed}-{self.number}{times}"


def jobs(group: str, seed: int, first: int, count: int, oversample: int = 1) -> list[Job]:
    """Records of a group: of "family", of one discrepancy, or of "discrepant", all ten in turn.

    Raises InputError on an unknown group.
    """
    if group == DISCREPANT:
        kinds = KINDS[1:]
        return [Job(kinds[i % 10], seed, i // 10, oversample) for i in range(first, first + count)]
    if group not in KINDS:
        raise InputError(
            f"--group {group!r} is unknown: it must be {DISCREPANT} or one of {', '.join(KINDS)}"
        )
    return [Job(group, seed, i, oversample) for i in range(first, first + count)]


def answering_of(path: str) -> Callable:
    """The function at `module:name`. Raises InputError where there is none."""
    module, _, name = path.partition(":")
    try:
        return getattr(import_module(module), name)
    except (ImportError, AttributeError, ValueError) as fault:
        raise InputError(
            f"--answer {path!r} must be module:function, such as {ANSWER}, that can be imported ({fault})"
        ) from None


def answered(job: Job, path: str, mode: str) -> Row:
    """The row of a record. A fault of the answering is kept as the outcome, so that the others go on."""
    made = case(job.kind, job.seed, job.number, job.oversample)
    answering = partial(answering_of(path), deviation=mode)
    try:
        return row_of(made, answering, mode)
    except Exception as fault:
        head = {"case": made.name, "kind": made.kind, "oversample": made.oversample, "mode": mode}
        return head | {
            "damping": made.damping, "restoring": made.restoring, "decided": False,
            "outcome": Status.FAILED.because(f"{type(fault).__name__}: {' '.join(str(fault).split())}"),
        }  # fmt: skip


def run(todo: Sequence[Job], path: str, mode: str, out: Path, workers: int = 2) -> pd.DataFrame:
    """Answer the records that a table lacks in this mode, each written as it is done; return all rows of the table.

    path: `module:function`; it is called as answer(signal, amplitudes, deviation=mode).
    """
    answering_of(path)
    wanted = {f"{job.name}/{mode}": (job, path, mode) for job in todo}
    gathered(out, COLUMNS, wanted, answered, workers, key=("case", "mode"))
    return read_frame(out, COLUMNS)


def main(arguments: Sequence[str] | None = None) -> int:
    """The command line; its exit status: 0, 2 where the input is wrong, 3 where an answer failed."""
    parser = argparse.ArgumentParser(prog="python -m validation.run", description=__doc__)
    parser.add_argument("--group", default=FAMILY, help=f"{DISCREPANT} (all in turn), or {', '.join(KINDS)}")
    parser.add_argument("--count", type=int, default=100)
    parser.add_argument("--first", type=int, default=0, help="number of the first record")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument(
        "--oversample", type=int, default=1, help="so many times the samples of the same records"
    )
    parser.add_argument("--deviation", default="auto", help="passed on to the answer: none, law, auto")
    parser.add_argument("--answer", default=ANSWER, help="module:function(signal, amplitudes, deviation=...)")
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--out", type=Path, required=True, help="a CSV; what it has is not done again")
    given = parser.parse_args(arguments)
    try:
        todo = jobs(given.group, given.seed, given.first, given.count, given.oversample)
        rows = run(todo, given.answer, given.deviation, given.out, given.workers)
    except InputError as fault:
        print(fault, file=sys.stderr)
        return 2
    if len(rows):
        print(markdown(scores(rows)))
    faults = rows[[status_of(str(said)) is Status.FAILED for said in rows["outcome"]]]
    for name, outcome in zip(faults["case"], faults["outcome"], strict=True):
        print(f"{name}: {outcome}", file=sys.stderr)
    return 3 if len(faults) else 0


if __name__ == "__main__":
    sys.exit(main())
