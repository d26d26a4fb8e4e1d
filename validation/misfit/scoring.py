"""Score the answers of `bayesdamp compare --quick` on simulated records, and write the page.

`python -m validation.misfit.scoring TABLE FOLDER --seed 21 [--count 4]`.
"""

from __future__ import annotations

import tempfile
from pathlib import Path
from typing import Any

import pandas as pd

from bayesdamp.cli.records import ReadingOptions, records_in
from bayesdamp.interface.answer import answer
from bayesdamp.types import InputError, Refusal, Signal
from validation.misfit.cases import INSIDE, OUTSIDE, draw_case
from validation.rows import make_page, page_options, where
from validation.scoring import COLUMNS, KEY, Reply, groups_of, hits_of, named, reply_of, row_of, score_table


def answer_file(signal: Signal, amplitudes: tuple[float, ...]) -> Reply:
    """Write a record to a CSV file, and read and answer it as `bayesdamp compare --quick` does.

    Raises Refusal if the file is refused, or if the record is not the free decay of one oscillator.
    """
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "record.csv"
        pd.DataFrame({"t": signal.t, "angle": signal.y}).to_csv(file, index=False)
        try:
            (record,) = records_in(file, ReadingOptions(time="t", angle="angle", unit="rad"))
        except InputError as refusal:
            raise Refusal(str(refusal).replace(folder, "")) from None
    if record.signal is None:
        raise Refusal(record.refusal)
    return reply_of(answer(record.signal, sample=False).verdict)


def row(kind: str, number: int, seed: int) -> dict[str, Any]:
    """Simulate record `number` of a kind, write it to a file, answer the file, and return the row of the table.

    kind: one of `cases.OUTSIDE` or `cases.INSIDE`. seed: seed of all random numbers, with kind and number.
    """
    return row_of(draw_case(kind, number, seed), answer_file)


def page(rows: pd.DataFrame) -> str:
    """Return the page in Markdown: the result, how it was computed, and the table."""
    inside, outside = (where(rows, rows["group"].isin(kinds)) for kinds in (INSIDE, OUTSIDE))
    parts = {
        **groups_of(inside, order=INSIDE), "**of the family**": inside,
        **groups_of(outside, order=OUTSIDE), "**outside**": outside,
    }  # fmt: skip
    return f"""# Simulated misfits

On records that no law fits, a wrong damping is named outright, without a warning, in \
{hits_of(named(outside, right=0), len(outside))}. On records of the family with poor data this is so in \
{hits_of(named(inside, right=0), len(inside))}, and the true damping is named outright in \
{hits_of(named(inside, right=1), len(inside))}. The brackets contain 95 % intervals of the fractions.

The records are simulated by SciPy's solver (`validation/misfit/records.py`) with random parameters (`cases.py`: 240 \
samples, 6 to 12 cycles, 0.3 to 5 % noise, 20 to 85 % of the amplitude lost). Each is written to a file and answered \
as `bayesdamp compare --quick` does: under all dampings and restoring laws, which may hold approximately. Without an \
answer are records that are recognised as not being the free decay of one oscillator. *Correctly* \
means that the damping that is named outright is the true sum. Stiction, cubic and square-root damping are not among \
the sums that are compared, so any damping that is named there is wrong. No threshold was chosen on this seed.

{score_table(parts, "records", "answered", "named outright, correctly", "named outright, wrongly")}

scored.csv has every case. `make reports` makes this report again.
"""


def main() -> None:
    """Run the command line: score the cases that the table lacks, and write the page."""
    given = page_options(__doc__, seed=21, count=1).parse_args()
    todo = {
        f"{kind}-{given.seed}-{number}/bayesdamp": (kind, number, given.seed)
        for number in range(given.count)
        for kind in (*INSIDE, *OUTSIDE)
    }
    make_page(given, "scored.csv", COLUMNS, todo, row, page, KEY)


if __name__ == "__main__":
    main()
