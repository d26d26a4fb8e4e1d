"""Compare answers on repeats and on halves of records.

`python -m validation.measured.agreement FILE.csv [PART ...]`.

Parts: `halves` of measured records, `runs` of one rig, and halves of `simulated` records with a discrepancy. The file
has a row for each pair. For each part, the output contains the mean square of the standardised differences of the
damping ratio at common amplitudes (1 if the intervals are correct), how often the sum of one answer has a probability
of at least 0.05 in the other answer, and the records that could not be compared. The answers are from linear
approximations; with `sampled` among the parts, they are from sequential Monte Carlo.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path

import pandas as pd

from bayesdamp.interface.answer import answer
from bayesdamp.types import InputError, Refusal, Signal
from bayesdamp.verdict.types import Verdict
from validation.answers import Answering
from validation.measured.run import signals
from validation.repeats import (
    Agreement,
    halves,
    mean_square,
    named_possible,
    runs,
    share_possible,
    table,
)
from validation.truth.records import KINDS, case

SEED, COUNT = 621, 20
"""Seed and number of the simulated records."""
SPECIMENS = {"ten-runs": ("ten-runs",), "stiff discs": ("stiff-disc-2", "stiff-disc-3")}
SINGLE = ("rotary", "video", "disc", "rig-80P", "rig-60", "rig-100", "stiff-disc-2", "stiff-disc-3", "ship")


def verdict_at(sample: bool, signal: Signal, amplitudes: tuple[float, ...]) -> Verdict:
    """Return the verdict on a record, with damping ratios at amplitudes. Raises Refusal if it has none."""
    verdict = answer(signal, amplitudes, sample=sample).verdict
    if not verdict.damping_ratio:
        raise Refusal(verdict.sentence)
    return verdict


def measured_halves(answering: Answering) -> Iterator[tuple[str, Callable[[], list[Agreement]]]]:
    """Compare the halves of each measured record."""
    for name, records in signals(list(SINGLE)):
        yield name, lambda records=records: [halves(records[0], answering)]


def measured_runs(answering: Answering) -> Iterator[tuple[str, Callable[[], list[Agreement]]]]:
    """Compare every two runs of one rig."""
    for name, members in SPECIMENS.items():
        every = [signal for _, records in signals(list(members)) for signal in records]
        yield name, lambda every=every: runs(every, answering)


def simulated_halves(answering: Answering) -> Iterator[tuple[str, Callable[[], list[Agreement]]]]:
    """Compare the halves of simulated records, of which each has one of the ten discrepancies."""
    for i in range(COUNT):
        c = case(KINDS[1 + i % 10], SEED, i // 10)
        yield c.name, lambda c=c: [halves(c.signal, answering)]


PARTS = {"halves": measured_halves, "runs": measured_runs, "simulated": simulated_halves}


def main(file: Path, wanted: list[str]) -> None:
    """Run the command line: compare the answers of the wanted parts (or all), and write the table."""
    answering = partial(verdict_at, "sampled" in wanted)
    chosen = [name for name in PARTS if name in wanted] or list(PARTS)
    rows = []
    for part in chosen:
        agreements: list[Agreement] = []
        for name, compare in PARTS[part](answering):
            try:
                pairs = compare()
            except (Refusal, InputError) as why:
                print(f"{part}: {name}: not compared: {why}", flush=True)
                continue
            agreements += pairs
            rows.append(table(pairs).assign(part=part, record=name))
            pd.concat(rows).to_csv(file, index=False)
            print(f"{part}: {name}: mean z² {mean_square(pairs):.2f} of {len(pairs)}", flush=True)
        if agreements:
            print(
                f"{part}: {len(agreements)} pairs, mean square {mean_square(agreements):.2f}, "
                f"most probable sums that the other answer allows {share_possible(agreements):.2f}, "
                "of those named outright {} of {}".format(*named_possible(agreements)),
                flush=True,
            )


if __name__ == "__main__":
    main(Path(sys.argv[1]), sys.argv[2:])
