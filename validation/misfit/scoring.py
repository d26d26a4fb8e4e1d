"""Score the answers of `bayesdamp compare --quick` on simulated records, and write the page.

`python -m validation.misfit.scoring TABLE FOLDER --seed 21 [--count 4]`.
"""

from __future__ import annotations

import tempfile
import time
from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path

from bayesdamp.cli.records import ReadingOptions, records_in
from bayesdamp.formatting import markdown_table as table
from bayesdamp.interface.answer import answer
from bayesdamp.types import InputError
from bayesdamp.verdict.parts import Grade
from bayesdamp.verdict.types import Verdict
from validation.misfit.cases import INSIDE, OUTSIDE, Case, draw_case
from validation.rows import make_page, page_options
from validation.scoring import hits_of

COLUMNS = (
    "case", "kind", "truth", "noise_pct", "outcome", "grade", "motion", "damping", "probability", "deviation",
    "seconds", "sentence",
)  # fmt: skip
REFUSED, OPEN, RIGHT, WRONG = "refused", "open", "right", "wrong"
"""Outcomes: the answer names no damping; it names none outright; it names the true damping outright, or another one."""
NO_ANSWER = (Grade.NO_FREE_DECAY, Grade.NOT_WEIGHED)

HEADS = (
    "kind", "cases", "refused (not a free decay, or no fit)", "left open", "named outright, correctly",
    "named outright, wrongly",
)  # fmt: skip


def row(kind: str, number: int, seed: int) -> dict[str, object]:
    """Simulate a case, answer it, and return its row."""
    return score(draw_case(kind, number, seed))


def score(case: Case) -> dict[str, object]:
    """Write a case to a CSV file, answer it as `bayesdamp compare --quick` does, and return its row.

    The column `seconds` is CPU time.
    """
    began = time.process_time()
    head: dict[str, object] = {
        "case": case.name, "kind": case.kind, "truth": case.damping, "noise_pct": f"{100 * case.noise:.3g}",
    }  # fmt: skip
    with tempfile.TemporaryDirectory() as folder:
        verdict = _verdict(case, Path(folder) / "record.csv")
    spent = {"seconds": f"{time.process_time() - began:.1f}"}
    if isinstance(verdict, str):
        return {**head, "outcome": REFUSED, "sentence": verdict, **spent}
    return {
        **head, **spent,
        "outcome": outcome(verdict, case.damping),
        "grade": str(verdict.grade),
        "motion": "" if verdict.motion is None else str(verdict.motion),
        "damping": verdict.damping,
        "probability": "" if verdict.grade in NO_ANSWER else f"{verdict.probability:.4f}",
        "deviation": "" if verdict.deviation is None else f"{verdict.deviation.value:.3g}",
        "sentence": verdict.sentence,
    }  # fmt: skip


def outcome(verdict: Verdict, truth: str) -> str:
    """Return the outcome of a verdict: REFUSED, OPEN, RIGHT or WRONG."""
    if verdict.grade in NO_ANSWER:
        return REFUSED
    if not verdict.decided:
        return OPEN
    return RIGHT if set(verdict.damping.split("+")) == set(truth.split("+")) else WRONG


def _verdict(case: Case, file: Path) -> Verdict | str:
    """Return the verdict, or the reason why the file is refused."""
    lines = [f"{t!r},{y!r}" for t, y in zip(case.t.tolist(), case.y.tolist(), strict=True)]
    file.write_text("\n".join(["t,angle", *lines]) + "\n", encoding="utf-8")
    try:
        (record,) = records_in(file, ReadingOptions(time="t", angle="angle", unit="rad"))
    except InputError as refusal:
        return str(refusal).replace(str(file.parent), "")
    if record.signal is None:
        return record.refusal
    return answer(record.signal, sample=False).verdict


def page(rows: Sequence[Mapping[str, str]]) -> str:
    """Return the page in Markdown: the result, how it was computed, and the table."""
    inside, outside = ([r for r in rows if r["kind"] in kinds] for kinds in (INSIDE, OUTSIDE))
    own, other = (Counter(r["outcome"] for r in part) for part in (inside, outside))
    lines = []
    for title, kinds, part in (("of the family", INSIDE, inside), ("outside", OUTSIDE, outside)):
        for name, cases in [
            *((k, [r for r in part if r["kind"] == k]) for k in kinds),
            (f"**{title}**", part),
        ]:
            counts = Counter(r["outcome"] for r in cases)
            lines.append([name, str(len(cases)), *(str(counts[o]) for o in (REFUSED, OPEN, RIGHT, WRONG))])
    return "\n".join(
        [
            "# Simulated misfits",
            "",
            "On records that no law fits, a wrong damping is named outright, without a warning, in "
            f"{hits_of(other[WRONG], len(outside))}. On records of the family with poor data this is so in "
            f"{hits_of(own[WRONG], len(inside))}, and the true damping is named outright in "
            f"{hits_of(own[RIGHT], len(inside))}. The brackets contain 95 % intervals of the fractions.",
            "",
            "The records are simulated by SciPy's solver (`validation/misfit/records.py`) with random parameters "
            "(`cases.py`: 240 samples, 6 to 12 cycles, 0.3 to 5 % noise, 20 to 85 % of the amplitude lost). Each is "
            "written to a file and answered as `bayesdamp compare --quick` does: under all dampings and restoring "
            "laws, which may hold approximately. *Correctly* means that the damping that is named outright is the "
            "true sum. Stiction, cubic and square-root damping are not among the sums that are compared, so any "
            "damping that is named there is wrong. No threshold was chosen on this seed.",
            "",
            table(HEADS, lines),
            "",
            "scored.csv has every case with its sentence. `make reports` makes this report again; `ARGS=--full` uses "
            "three times as many records.",
            "",
        ]
    )


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
