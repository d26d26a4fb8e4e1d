"""Whether answers on repeats and on halves of records agree: `python -m tests.measured.agreement FILE.csv [PART ...]`.

Parts: halves of measured records, runs of one rig, halves of simulated records with a discrepancy. A row a pair; of
each part the mean square of the standardised differences of the damping ratio at common amplitudes (1 where intervals
are right), how often a sum that is named has a probability of 0.05 or more in the other answer, and the records that
could not be compared. Answers are those of the linear models; with `sampled` among the parts, of the motions.
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
from tests.measured.run import signals
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
"""Of the simulated records."""
SPECIMENS = {"ten-runs": ("ten-runs",), "stiff discs": ("stiff-disc-2", "stiff-disc-3")}
SINGLE = ("rotary", "video", "disc", "rig-80P", "rig-60", "rig-100", "stiff-disc-2", "stiff-disc-3", "ship")
Answering = Callable[[Signal, tuple[float, ...]], Verdict]


def answered(sample: bool, signal: Signal, amplitudes: tuple[float, ...]) -> Verdict:
    """The verdict at amplitudes. Raises Refusal where it has no damping ratio."""
    found = answer(signal, amplitudes, sample=sample).verdict
    if not found.damping_ratio:
        raise Refusal(found.sentence)
    return found


def measured_halves(answering: Answering) -> Iterator[tuple[str, Callable[[], list[Agreement]]]]:
    """Halves of each measured record."""
    for name, records in signals(list(SINGLE)):
        yield name, lambda records=records: [halves(records[0], answering)]


def measured_runs(answering: Answering) -> Iterator[tuple[str, Callable[[], list[Agreement]]]]:
    """Every two runs of one rig."""
    for name, members in SPECIMENS.items():
        every = [one for _, records in signals(list(members)) for one in records]
        yield name, lambda every=every: runs(every, answering)


def simulated_halves(answering: Answering) -> Iterator[tuple[str, Callable[[], list[Agreement]]]]:
    """Halves of simulated records, the ten discrepancies in turn."""
    for i in range(COUNT):
        made = case(KINDS[1 + i % 10], SEED, i // 10)
        yield made.name, lambda made=made: [halves(made.signal, answering)]


PARTS = {"halves": measured_halves, "runs": measured_runs, "simulated": simulated_halves}


def main(file: Path, wanted: list[str]) -> None:
    answering = partial(answered, "sampled" in wanted)
    chosen = [name for name in PARTS if name in wanted] or list(PARTS)
    rows = []
    for part in chosen:
        found: list[Agreement] = []
        for name, compare in PARTS[part](answering):
            try:
                pairs = compare()
            except (Refusal, InputError) as why:
                print(f"{part}: {name}: not compared: {why}", flush=True)
                continue
            found += pairs
            rows.append(table(pairs).assign(part=part, record=name))
            pd.concat(rows).to_csv(file, index=False)
            print(f"{part}: {name}: mean z² {mean_square(pairs):.2f} of {len(pairs)}", flush=True)
        if found:
            print(
                f"{part}: {len(found)} pairs, mean square {mean_square(found):.2f}, "
                f"likeliest sums possible in the other answer {share_possible(found):.2f}, "
                "of those named outright {} of {}".format(*named_possible(found)),
                flush=True,
            )


if __name__ == "__main__":
    main(Path(sys.argv[1]), sys.argv[2:])
