"""Answer simulated records and score the answers: `python -m validation.run --group family --out FILE.csv`."""

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
from validation.rows import complete_rows, read_frame
from validation.scoring import markdown, scores
from validation.truth.records import FAMILY, KINDS, case

ANSWER = "validation.reports.verdicts:sampled_verdict"
DISCREPANT = "discrepant"


@dataclass(frozen=True)
class Job:
    """The arguments that determine one simulated record."""

    kind: str
    seed: int
    number: int
    oversample: int

    @property
    def name(self) -> str:
        """The name of the case."""
        times = f"-x{self.oversample}" if self.oversample > 1 else ""
        return f"{self.kind}-{self.seed}-{self.number}{times}"


def jobs(group: str, seed: int, count: int, oversample: int = 1) -> list[Job]:
    """Return the jobs of a group of records.

    Parameters
    ----------
    group : str
        "family", one discrepancy, or "discrepant" for all ten discrepancies in turn.
    seed : int
        Seed of the records.
    count : int
        Number of records.
    oversample : int
        Multiplies the sampling rate.

    Raises
    ------
    InputError
        The group is unknown.
    """
    if group == DISCREPANT:
        kinds = KINDS[1:]
        return [Job(kinds[i % 10], seed, i // 10, oversample) for i in range(count)]
    if group not in KINDS:
        raise InputError(
            f"--group {group!r} is unknown: it must be {DISCREPANT} or one of {', '.join(KINDS)}"
        )
    return [Job(group, seed, i, oversample) for i in range(count)]


def answering_of(path: str) -> Callable:
    """Return the function at `module:name`. Raises InputError if it does not exist."""
    module, _, name = path.partition(":")
    try:
        return getattr(import_module(module), name)
    except (ImportError, AttributeError, ValueError) as fault:
        raise InputError(
            f"--answer {path!r} must be module:function, such as {ANSWER}, that can be imported ({fault})"
        ) from None


def answer_job(job: Job, path: str, mode: str) -> Row:
    """Answer a record and return its row. An exception becomes its outcome, so that the run continues."""
    record = case(job.kind, job.seed, job.number, job.oversample)
    answering = partial(answering_of(path), deviation=mode)
    try:
        return row_of(record, answering, mode)
    except Exception as fault:
        head = {"case": record.name, "kind": record.kind, "oversample": record.oversample, "mode": mode}
        return head | {
            "damping": record.damping, "restoring": record.restoring, "decided": False,
            "outcome": Status.FAILED.because(f"{type(fault).__name__}: {' '.join(str(fault).split())}"),
        }  # fmt: skip


def run(todo: Sequence[Job], path: str, mode: str, out: Path, workers: int = 2) -> pd.DataFrame:
    """Answer the records that a table lacks in this mode; return all rows of the table.

    Each row is written as soon as it is computed.

    Parameters
    ----------
    todo : sequence of Job
        The requested records.
    path : str
        The answering function as `module:function`. It is called as answer(signal, amplitudes, deviation=mode).
    mode : str
        How deviations from the laws are treated: none, law or auto.
    out : Path
        The CSV file.
    workers : int
        Number of processes.
    """
    answering_of(path)
    wanted = {f"{job.name}/{mode}": (job, path, mode) for job in todo}
    complete_rows(out, COLUMNS, wanted, answer_job, workers, key=("case", "mode"))
    return read_frame(out, COLUMNS)


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line; return 0, or 2 if the input is wrong, or 3 if an answer failed."""
    parser = argparse.ArgumentParser(prog="python -m validation.run", description=__doc__)
    parser.add_argument("--group", default=FAMILY, help=f"{DISCREPANT} (all in turn), or {', '.join(KINDS)}")
    parser.add_argument("--count", type=int, default=100)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument(
        "--oversample", type=int, default=1, help="multiplies the number of samples of the same records"
    )
    parser.add_argument(
        "--deviation", default="auto", help="passed to the answering function: none, law, auto"
    )
    parser.add_argument("--answer", default=ANSWER, help="module:function(signal, amplitudes, deviation=...)")
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument(
        "--out", type=Path, required=True, help="CSV file; rows that it already has are not computed again"
    )
    given = parser.parse_args(arguments)
    try:
        todo = jobs(given.group, given.seed, given.count, given.oversample)
        rows = run(todo, given.answer, given.deviation, given.out, given.workers)
    except InputError as fault:
        print(fault, file=sys.stderr)
        return 2
    if len(rows):
        print(markdown(scores(rows)))
    faults = rows[[status_of(str(outcome)) is Status.FAILED for outcome in rows["outcome"]]]
    for name, outcome in zip(faults["case"], faults["outcome"], strict=True):
        print(f"{name}: {outcome}", file=sys.stderr)
    return 3 if len(faults) else 0


if __name__ == "__main__":
    sys.exit(main())
