"""Answer measured decays: `python -m validation.measured.run FOLDER`.

Each record is read with only its columns, sampling rate and unit as options, and answered as `bayesdamp compare` does.
Ten runs of one rig are also answered together, as repeated records of one specimen. `verdicts.csv` and `README.md` in
FOLDER have a row for each answer.
"""

import sys
import tomllib
from collections.abc import Iterator, Sequence
from pathlib import Path

from bayesdamp.cli.records import ReadingOptions, records_in
from bayesdamp.formatting import markdown_table
from bayesdamp.interface.answer import answer, compare_models
from bayesdamp.store.files import write_table
from bayesdamp.types import Signal
from bayesdamp.verdict.specimen import specimen
from bayesdamp.verdict.types import Verdict, columns

DATA = Path(__file__).resolve().parents[3] / "shared" / "data"
"""Folder of the measured records."""
RECORDS = Path(__file__).with_name("records.toml")
"""File that lists the measured records by name. It states the file of each record, relative to the data folder, and the
options with which it is read."""
RUNS = "ten-runs"
"""Name of the record that consists of ten runs of one rig, which are also answered together as one specimen."""


def signals() -> Iterator[tuple[str, Sequence[Signal]]]:
    """Yield the name of each record and its free decays.

    The record `RUNS` gives all decays in its file; every other record gives only the first one.
    """
    for name, options in tomllib.loads(RECORDS.read_text(encoding="utf-8")).items():
        results = records_in(DATA / options.pop("file"), ReadingOptions(**options))
        decays = [r.signal for r in results if r.signal is not None]
        yield name, decays if name == RUNS else decays[:1]


def main(folder: Path) -> None:
    """Run the command line: answer the records, and write README.md and verdicts.csv."""
    results: list[Verdict] = []
    for name, records in signals():
        answers = [answer(signal, compare_models(signal), repeated=len(records) > 1) for signal in records]
        results += [a.verdict for a in answers]
        if len(answers) > 1:
            results.append(specimen(name, [a.of_specimen() for a in answers if a.arrays]))
        print(f"{name}: {results[-1].sentence}", flush=True)
    write_table(folder / "verdicts.csv", columns(), [v.row() for v in results])
    page = f"""# Measured decays

Of {len(results)} answers, {sum(v.decided for v in results)} name one damping outright; no truth is known.

The table contains the answers of `bayesdamp compare` on published measurements.

{markdown_table(("record", "grade", "answer"), [(v.record, str(v.grade), v.sentence) for v in results])}
"""
    (folder / "README.md").write_text(page, encoding="utf-8")


if __name__ == "__main__":
    main(Path(sys.argv[1]))
