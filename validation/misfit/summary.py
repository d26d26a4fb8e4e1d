"""Write the page on scored cases: counts by kind, in Markdown."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence

from validation.misfit.cases import INSIDE, OUTSIDE
from validation.misfit.scoring import OPEN, REFUSED, RIGHT, WRONG
from validation.scoring import wilson

Rows = Sequence[Mapping[str, str]]
OUTCOMES = (REFUSED, OPEN, RIGHT, WRONG)
HEADS = (
    "kind", "cases", "said to be no free decay, or nothing weighed", "left open", "named outright, right",
    "named outright, wrong and unwarned",
)  # fmt: skip


def counted(rows: Rows) -> Counter[str]:
    """Count the outcomes of cases."""
    return Counter(r["outcome"] for r in rows)


def share(hits: int, count: int) -> str:
    """Format hits of a count with Wilson's 95 % interval of their share."""
    low, high = wilson(hits / count if count else 0.0, count)
    return f"{hits} of {count} ({low:.2f}–{high:.2f})"


def page(rows: Rows) -> str:
    """Return the page: the answer, the table, and how it is made."""
    inside, outside = ([r for r in rows if r["kind"] in kinds] for kinds in (INSIDE, OUTSIDE))
    own, other = counted(inside), counted(outside)
    return "\n".join(
        [
            "# Simulated misfits",
            "",
            "Records that no law fits are named a wrong damping outright, without a warning, in "
            f"{share(other[WRONG], len(outside))}; records of the family under bad conditions in "
            f"{share(own[WRONG], len(inside))}, and are named rightly in {share(own[RIGHT], len(inside))}. In "
            "brackets: 95 % intervals of the shares.",
            "",
            "Records of SciPy's solver (`validation/misfit/records.py`), drawn broadly from a seed (`cases.py`: 240 "
            "samples, 6 to 12 cycles, 0.3 to 5 % noise, 20 to 85 % of the amplitude lost), written to a file and "
            "answered as `bayesdamp compare --quick` does: under all dampings and restoring laws, which may hold "
            "approximately. *Right*: the damping that is named without reservation is the true sum; friction that is "
            "larger near rest (stiction), cubic and square-root damping have none among those that are weighed, so "
            "that whatever is named is wrong. No threshold was chosen on this seed.",
            "",
            *_table(inside, outside),
            "",
            "scored.csv has every case with its sentence. `make reports` makes it again, with `ARGS=--full` from "
            "three times as many.",
            "",
        ]
    )


def _table(inside: Rows, outside: Rows) -> list[str]:
    lines = ["| " + " | ".join(HEADS) + " |", "|---|" + "---|" * (len(HEADS) - 1)]
    for title, kinds, part in (("of the family", INSIDE, inside), ("outside", OUTSIDE, outside)):
        groups = [(kind, [r for r in part if r["kind"] == kind]) for kind in kinds]
        for name, cases in [*groups, (f"**{title}**", part)]:
            counts = counted(cases)
            lines.append(f"| {name} | {len(cases)} | " + " | ".join(str(counts[o]) for o in OUTCOMES) + " |")
    return lines
