"""Answer measured decays: `python -m validation.measured.run FOLDER [NAME ...]`.

Each record is read with its columns and unit as the only options, and answered as `bayesdamp compare` does. The runs in
a file are also answered together as one specimen. `verdicts.csv` and `README.md` in FOLDER have a row for each.
"""

from __future__ import annotations

import sys
from collections.abc import Iterator
from pathlib import Path

from bayesdamp.cli.records import records_in
from bayesdamp.interface.answer import Answer, answer
from bayesdamp.store import write_table
from bayesdamp.types import Signal
from bayesdamp.verdict.specimen import specimen
from bayesdamp.verdict.types import Verdict, columns
from validation.measured.records import RECORDS, RUNS


def signals(wanted: list[str]) -> Iterator[tuple[str, list[Signal]]]:
    """Yield the name of each file and its free decays; of a single record only the first."""
    for record in (*RECORDS, RUNS):
        if not wanted or record.name in wanted:
            results = records_in(record.path, record.options)
            decays = [r.signal for r in results if r.signal is not None]
            yield record.name, decays if record is RUNS else decays[:1]


def verdicts(wanted: list[str]) -> Iterator[Verdict]:
    """Yield the verdict on each record, and on the runs of a file together."""
    for name, records in signals(wanted):
        answers: list[Answer] = []
        for number, signal in enumerate(records, start=1):
            answers.append(answer(signal, repeated=len(records) > 1))
            print(f"{name} {number}: {answers[-1].verdict.sentence}", flush=True)
            yield answers[-1].verdict
        if len(answers) > 1:
            together = specimen(name, [a.of_specimen() for a in answers if a.arrays])
            print(f"{name}: {together.sentence}", flush=True)
            yield together


def main(folder: Path, wanted: list[str]) -> None:
    """Answer the records, and write README.md and verdicts.csv into a folder."""
    folder.mkdir(parents=True, exist_ok=True)
    results = list(verdicts(wanted))
    write_table(folder / "verdicts.csv", columns(), [v.row() for v in results])
    lines = [f"| {v.record} | {v.grade} | {v.sentence} |" for v in results]
    named = sum(v.decided for v in results)
    page = f"# Measured decays\n\nOf {len(results)} answers {named} name one damping outright; no truth is known.\n\n"
    page += "What `bayesdamp compare` says of records that others measured.\n\n"
    page += "| record | grade | answer |\n|---|---|---|\n" + "\n".join(lines) + "\n"
    (folder / "README.md").write_text(page, encoding="utf-8")


if __name__ == "__main__":
    main(Path(sys.argv[1]), sys.argv[2:])
