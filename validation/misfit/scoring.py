"""Score the quick answers on simulated cases, each read as a user's file, and write the page.

`python -m validation.misfit.scoring TABLE FOLDER --seed 21 [--count 4 --kinds clean,beats]`.
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
from validation.misfit.cases import INSIDE, OUTSIDE, Case, drawn
from validation.rows import make_page, page_options
from validation.scoring import hits_of

COLUMNS = (
    "case", "kind", "truth", "noise_pct", "outcome", "grade", "motion", "damping", "probability", "deviation",
    "seconds", "sentence",
)  # fmt: skip
REFUSED, OPEN, RIGHT, WRONG = "refused", "open", "right", "wrong"
"""Outcomes: no damping is given; none is named without reservation; the true one is, or another."""
NO_ANSWER = (Grade.NO_FREE_DECAY, Grade.NOT_WEIGHED)

HEADS = (
    "kind", "cases", "said to be no free decay, or nothing weighed", "left open", "named outright, right",
    "named outright, wrong and unwarned",
)  # fmt: skip


def row(kind: str, number: int, seed: int) -> dict[str, object]:
    """Return the row of case `number` of a kind under a seed."""
    return score(drawn(kind, number, seed))


def score(case: Case) -> dict[str, object]:
    """Return the row of a case, read from a CSV file and answered as `bayesdamp compare --quick` does.

    Its seconds are processor time.
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
    """Return the outcome of a verdict, given the true damping."""
    if verdict.grade in NO_ANSWER:
        return REFUSED
    if not verdict.decided:
        return OPEN
    return RIGHT if set(verdict.damping.split("+")) == set(truth.split("+")) else WRONG


def _verdict(case: Case, file: Path) -> Verdict | str:
    """Return the verdict, or why the file is refused."""
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
    """Return the page: the answer, the table, and how it is made."""
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
            "Records that no law fits are named a wrong damping outright, without a warning, in "
            f"{hits_of(other[WRONG], len(outside))}; records of the family under bad conditions in "
            f"{hits_of(own[WRONG], len(inside))}, and are named rightly in {hits_of(own[RIGHT], len(inside))}. In "
            "brackets: 95 % intervals of the shares.",
            "",
            "Records of SciPy's solver (`validation/misfit/records.py`), drawn broadly from a seed (`cases.py`: 240 "
            "samples, 6 to 12 cycles, 0.3 to 5 % noise, 20 to 85 % of the amplitude lost), written to a file and "
            "answered as `bayesdamp compare --quick` does: under all dampings and restoring laws, which may hold "
            "approximately. *Right*: the damping that is named without reservation is the true sum; friction that is "
            "larger near rest (stiction), cubic and square-root damping have none among those that are weighed, so "
            "that whatever is named is wrong. No threshold was chosen on this seed.",
            "",
            table(HEADS, lines),
            "",
            "scored.csv has every case with its sentence. `make reports` makes it again, with `ARGS=--full` from "
            "three times as many.",
            "",
        ]
    )


def main() -> None:
    """Write the page, and score the cases that the table lacks."""
    parser = page_options(__doc__)
    parser.add_argument("--seed", type=int, required=True)
    parser.add_argument("--count", type=int, default=1)
    parser.add_argument("--kinds", default=",".join((*INSIDE, *OUTSIDE)))
    given = parser.parse_args()
    todo = {
        f"{kind}-{given.seed}-{number}": (kind, number, given.seed)
        for number in range(given.count)
        for kind in given.kinds.split(",")
    }
    make_page(given, "scored.csv", COLUMNS, todo, row, page)


if __name__ == "__main__":
    main()
