"""Score the answers of `bayesdamp compare --quick` on simulated records, and write the page.

`python -m validation.misfit.scoring TABLE FOLDER --seed 21 [--count 4]`.
"""

from __future__ import annotations

import tempfile
import time
from pathlib import Path

import pandas as pd

from bayesdamp.cli.records import ReadingOptions, records_in
from bayesdamp.formatting import markdown_table as table
from bayesdamp.interface.answer import answer
from bayesdamp.types import InputError
from bayesdamp.verdict.parts import Grade
from bayesdamp.verdict.types import Verdict
from validation.misfit.cases import INSIDE, OUTSIDE, Case, draw_case
from validation.rows import make_page, page_options, where
from validation.scoring import hits_of, terms_of

COLUMNS = (
    "case", "kind", "truth", "noise_pct", "outcome", "grade", "motion", "damping", "probability", "deviation",
    "seconds", "sentence",
)  # fmt: skip
REFUSED, OPEN, RIGHT, WRONG = "refused", "open", "right", "wrong"
"""Outcomes of an answer. REFUSED: it names no damping, because the record is not a free decay or no model fits. OPEN:
it names no damping outright. RIGHT: it names the true damping outright. WRONG: it names another damping outright."""
NO_ANSWER = (Grade.NO_FREE_DECAY, Grade.NOT_WEIGHED)

HEADS = (
    "kind", "cases", "refused (not a free decay, or no fit)", "left open", "named outright, correctly",
    "named outright, wrongly",
)  # fmt: skip


def row(kind: str, number: int, seed: int) -> dict[str, object]:
    """Simulate a case, answer its CSV file as `bayesdamp compare --quick` does, and return its row of the table.

    The column `seconds` is the CPU time of the answer.
    """
    case = draw_case(kind, number, seed)
    began = time.process_time()
    with tempfile.TemporaryDirectory() as folder:
        verdict = _verdict(case, Path(folder) / "record.csv")
    head: dict[str, object] = {
        "case": case.name, "kind": case.kind, "truth": case.damping, "noise_pct": 100 * case.noise,
        "seconds": time.process_time() - began,
    }  # fmt: skip
    if isinstance(verdict, str):
        return head | {"outcome": REFUSED, "sentence": verdict}
    return head | {
        "outcome": outcome(verdict, case.damping),
        "grade": str(verdict.grade),
        "motion": verdict.motion and str(verdict.motion),
        "damping": verdict.damping,
        "probability": None if verdict.grade in NO_ANSWER else verdict.probability,
        "deviation": verdict.deviation and verdict.deviation.value,
        "sentence": verdict.sentence,
    }


def outcome(verdict: Verdict, truth: str) -> str:
    """Return the outcome of a verdict: REFUSED, OPEN, RIGHT or WRONG."""
    if verdict.grade in NO_ANSWER:
        return REFUSED
    if not verdict.decided:
        return OPEN
    return RIGHT if terms_of(verdict.damping) == terms_of(truth) else WRONG


def _verdict(case: Case, file: Path) -> Verdict | str:
    """Write a case to a CSV file and read it as `compare` does; return the verdict, or the reason why it is refused."""
    pd.DataFrame({"t": case.t, "angle": case.y}).to_csv(file, index=False)
    try:
        (record,) = records_in(file, ReadingOptions(time="t", angle="angle", unit="rad"))
    except InputError as refusal:
        return str(refusal).replace(str(file.parent), "")
    if record.signal is None:
        return record.refusal
    return answer(record.signal, sample=False).verdict


def page(rows: pd.DataFrame) -> str:
    """Return the page in Markdown: the result, how it was computed, and the table."""
    inside, outside = (where(rows, rows["kind"].isin(kinds)) for kinds in (INSIDE, OUTSIDE))
    parts = [(kind, where(rows, kind=kind)) for kind in INSIDE] + [("**of the family**", inside)]
    parts += [(kind, where(rows, kind=kind)) for kind in OUTSIDE] + [("**outside**", outside)]
    lines = [
        [name, str(len(part)), *(str(len(where(part, outcome=o))) for o in (REFUSED, OPEN, RIGHT, WRONG))]
        for name, part in parts
    ]

    def hits(part: pd.DataFrame, result: str) -> str:
        return hits_of(len(where(part, outcome=result)), len(part))

    return f"""# Simulated misfits

On records that no law fits, a wrong damping is named outright, without a warning, in {hits(outside, WRONG)}. On \
records of the family with poor data this is so in {hits(inside, WRONG)}, and the true damping is named outright in \
{hits(inside, RIGHT)}. The brackets contain 95 % intervals of the fractions.

The records are simulated by SciPy's solver (`validation/misfit/records.py`) with random parameters (`cases.py`: 240 \
samples, 6 to 12 cycles, 0.3 to 5 % noise, 20 to 85 % of the amplitude lost). Each is written to a file and answered \
as `bayesdamp compare --quick` does: under all dampings and restoring laws, which may hold approximately. *Correctly* \
means that the damping that is named outright is the true sum. Stiction, cubic and square-root damping are not among \
the sums that are compared, so any damping that is named there is wrong. No threshold was chosen on this seed.

{table(HEADS, lines)}

scored.csv has every case with its sentence. `make reports` makes this report again; `ARGS=--full` uses three times as \
many records.
"""


def main() -> None:
    """Run the command line: score the cases that the table lacks, and write the page."""
    parser = page_options(__doc__)
    parser.add_argument("--seed", type=int, required=True)
    parser.add_argument("--count", type=int, default=1)
    given = parser.parse_args()
    todo = {
        f"{kind}-{given.seed}-{number}": (kind, number, given.seed)
        for number in range(given.count)
        for kind in (*INSIDE, *OUTSIDE)
    }
    make_page(given, "scored.csv", COLUMNS, todo, row, page)


if __name__ == "__main__":
    main()
