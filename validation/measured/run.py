"""Answer measured decays: `python -m validation.measured.run FOLDER`.

Each record is read with its columns and unit as the only options, and answered as `bayesdamp compare` does. Several
runs in a file are also answered together as one specimen. `verdicts.csv` and `README.md` in FOLDER have a row for each
answer.
"""

from __future__ import annotations

import sys
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from bayesdamp.cli.records import ReadingOptions, records_in
from bayesdamp.formatting import markdown_table
from bayesdamp.interface.answer import Answer, answer
from bayesdamp.store import write_table
from bayesdamp.types import Signal
from bayesdamp.verdict.specimen import specimen
from bayesdamp.verdict.types import Verdict, columns

DATA = Path(__file__).resolve().parents[3] / "shared" / "data"
"""Folder of the measured records."""
RIG = ReadingOptions(time="Time_Elapsed(s)", angle="Angle(deg)", unit="deg")
"""Options for the files of the horizontal pendulum."""
SPRING = ReadingOptions(time="1", angle="2", unit="m")
"""Options for the files of a disc on a stiff spring: times in column 1, positions in m in column 2."""


@dataclass(frozen=True)
class Measured:
    """A measured record: its name, its file (relative to the data folder), and the options with which it is read."""

    name: str
    file: str
    options: ReadingOptions


RECORDS = (
    Measured(
        "rotary", "rotary_pendulum/pendulum_free_swing_data_01.txt", ReadingOptions(rate=1000.0, unit="deg")
    ),
    Measured("video", "video_pendulum/lab1_data.txt", ReadingOptions(time="1", angle="2")),
    Measured(
        "disc", "spring_disc/molla_dura_discopieno_0.1223kg.csv",
        ReadingOptions(time="Time (s) Run #1", angle="Position (m) Run #1", unit="m"),
    ),
    Measured(
        "encoder", "encoder_pendulum/SingleDataFreeSwing_1_Dt_0_0001.mat",
        ReadingOptions(time="Theta1.time", angle="Theta1.signals.values"),
    ),
    Measured("rig-80P", "horizontal_pendulum/80P.txt", RIG),
    Measured("rig-60", "horizontal_pendulum/60.txt", RIG),
    Measured("rig-100", "horizontal_pendulum/100.txt", RIG),
    Measured("stiff-disc-2", "spring_disc/molla_durissima_discopieno_14.91945_0.2016_2.csv", SPRING),
    Measured("stiff-disc-3", "spring_disc/molla_durissima_discopieno_14.91945_0.2016_3.csv", SPRING),
    Measured("ship", "ship_roll/model_test_21338.csv", ReadingOptions(time="time", angle="phi")),
)  # fmt: skip
RUNS = Measured("ten-runs", "ten_runs/Run_1-10_no_magnet.csv", ReadingOptions())
"""A file with ten runs of one rig, which are also answered together as one specimen."""


def signals() -> Iterator[tuple[str, list[Signal]]]:
    """Yield the name of each record and its free decays.

    Only the file of ten runs gives several decays; of every other file the first one is used.
    """
    for record in (*RECORDS, RUNS):
        results = records_in(DATA / record.file, record.options)
        decays = [r.signal for r in results if r.signal is not None]
        yield record.name, decays if record is RUNS else decays[:1]


def verdicts() -> Iterator[Verdict]:
    """Yield the verdict on each free decay, and that on all runs of a file as one specimen."""
    for name, records in signals():
        answers: list[Answer] = []
        for number, signal in enumerate(records, start=1):
            answers.append(answer(signal, repeated=len(records) > 1))
            print(f"{name} {number}: {answers[-1].verdict.sentence}", flush=True)
            yield answers[-1].verdict
        if len(answers) > 1:
            together = specimen(name, [a.of_specimen() for a in answers if a.arrays])
            print(f"{name}: {together.sentence}", flush=True)
            yield together


def main(folder: Path) -> None:
    """Run the command line: answer the records, and write README.md and verdicts.csv."""
    folder.mkdir(parents=True, exist_ok=True)
    results = list(verdicts())
    write_table(folder / "verdicts.csv", columns(), [v.row() for v in results])
    page = f"""# Measured decays

Of {len(results)} answers, {sum(v.decided for v in results)} name one damping outright; no truth is known.

The table contains the answers of `bayesdamp compare` on published measurements.

{markdown_table(("record", "grade", "answer"), [(v.record, str(v.grade), v.sentence) for v in results])}
"""
    (folder / "README.md").write_text(page, encoding="utf-8")


if __name__ == "__main__":
    main(Path(sys.argv[1]))
