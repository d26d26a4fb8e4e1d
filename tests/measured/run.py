"""The answers on measured decays: `python -m tests.measured.run FOLDER [NAME ...]`.

Each record is read with no options but its columns and unit and answered as `bayesdamp compare` does; the runs
of one file are also taken as one specimen. `verdicts.csv` and `README.md` in FOLDER have a row for each.
"""

from __future__ import annotations

import sys
from collections.abc import Iterator
from pathlib import Path

from bayesdamp.cli.records import ReadingOptions as Options
from bayesdamp.cli.records import records_in as found_records
from bayesdamp.interface.answer import Answer, answer
from bayesdamp.store import write_table
from bayesdamp.types import Signal
from bayesdamp.verdict.specimen import specimen
from bayesdamp.verdict.types import Verdict, columns
from tests.measured.records import DATA, RECORDS, RUNS


def signals(wanted: list[str]) -> Iterator[tuple[str, list[Signal]]]:
    """Each file's name and the free decays in it."""
    for record in RECORDS:
        if not wanted or record.name in wanted:
            options = {
                k: None if v is None else v if k == "rate" else str(v) for k, v in record.options.items()
            }
            found = found_records(record.path, Options(**options))  # type: ignore[arg-type]
            yield record.name, [one.signal for one in found if one.signal is not None][:1]
    if not wanted or RUNS.name in wanted:
        found = found_records((DATA / RUNS.file).resolve(), Options(**RUNS.options))
        yield RUNS.name, [one.signal for one in found if one.signal is not None]


def verdicts(wanted: list[str]) -> Iterator[Verdict]:
    """One for each record, and one for the runs of a file together."""
    for name, records in signals(wanted):
        answers: list[Answer] = []
        for number, signal in enumerate(records, start=1):
            answers.append(answer(signal, repeated=len(records) > 1))
            said = answers[-1].verdict
            print(f"{name} {number}: {said.sentence}", flush=True)
            yield said
        if len(answers) > 1:
            together = specimen(name, [a.of_specimen() for a in answers if a.arrays])
            print(f"{name}: {together.sentence}", flush=True)
            yield together


def main(folder: Path, wanted: list[str]) -> None:
    folder.mkdir(parents=True, exist_ok=True)
    found = list(verdicts(wanted))
    write_table(folder / "verdicts.csv", columns(), [v.row() for v in found])
    lines = [f"| {v.record} | {v.grade} | {v.sentence} |" for v in found]
    named = sum(v.decided for v in found)
    page = f"# Measured decays\n\nOf {len(found)} answers {named} name one damping outright; no truth is known.\n\n"
    page += "What `bayesdamp compare` says of records that others measured.\n\n"
    page += "| record | grade | answer |\n|---|---|---|\n" + "\n".join(lines) + "\n"
    (folder / "README.md").write_text(page, encoding="utf-8")


if __name__ == "__main__":
    main(Path(sys.argv[1]), sys.argv[2:])
