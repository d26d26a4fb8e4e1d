"""Run the contest and write its page: `python -m validation.contest ROWS.csv FOLDER [--seed 813 --count 200]`."""

from dataclasses import replace
from typing import Any

import numpy as np

from bayesdamp.types import Refusal, Signal
from bayesdamp.verdict.types import Verdict
from validation.contest.page import page
from validation.contest.peers import ROSTER
from validation.contest.records import simulate_record
from validation.scoring import make_page, page_options, row_of
from validation.truth.records import Case


def row(record: Case, name: str) -> dict[str, Any]:
    """Let a peer (a method of the contest, by its name) answer a record, and return the row of the table.

    If a verdict names no law, its damping ratios may be at amplitudes near the requested ones. They are judged as if
    they were at the requested amplitudes.
    """

    def answer(signal: Signal, amplitudes: tuple[float, ...]) -> Verdict:
        try:
            verdict = ROSTER[name](signal, amplitudes)
        except (ValueError, ArithmeticError, np.linalg.LinAlgError) as fault:
            raise Refusal(str(fault)) from None
        pairs = zip(verdict.damping_ratio, amplitudes, strict=False)
        return replace(verdict, damping_ratio=tuple(replace(at, amplitude=a) for at, a in pairs))

    return row_of(record, answer, name)


def main() -> None:
    """Run the command line: answer the records that the table lacks, and write the page."""
    options = page_options(__doc__, seed=813, count=200, workers=1).parse_args()
    records = [simulate_record(options.seed, number) for number in range(options.count)]
    for name in ROSTER:  # import and compile before any record is timed
        row(records[0], name)
    todo = {f"{record.name}/{name}": (record, name) for record in records for name in ROSTER}
    make_page(options, todo, row, page)


if __name__ == "__main__":
    main()
