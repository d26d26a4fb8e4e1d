"""Counts by kind over a table of scored cases, as Markdown: `python -m tests.misfit.summary TABLE`."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from pathlib import Path

from tests.misfit.cases import INSIDE, OUTSIDE
from tests.misfit.scoring import LIMIT, names_the_truth, read_rows, unwarned

HEADS = (
    "kind",
    "cases",
    "misfit or refused",
    "left open",
    "open beside other forms",
    f"wrong above {LIMIT:g}",
    "the truth left open first",
    "unwarned",
    "nats hidden there",
)


def counts(rows: Sequence[dict[str, str]]) -> str:
    """One line a kind. Nats hidden: how far the truth is ahead of the best candidate's fit, where nothing was said."""
    lines = ["| " + " | ".join(HEADS) + " |", "|---|" + "---|" * (len(HEADS) - 1)]
    for title, kinds in (("of the family", INSIDE), ("outside", OUTSIDE)):
        part = [r for r in rows if r["kind"] in kinds]
        for name, found in [(k, [r for r in part if r["kind"] == k]) for k in kinds] + [
            (f"**{title}**", part)
        ]:
            wrong = [r for r in found if r["wrong"] == "1"]
            named = sum(names_the_truth(r) for r in wrong)
            silent = [r for r in wrong if unwarned(r)]
            hidden = ", ".join(f"{float(r['nats_hidden']):.0f} ({r['relation']})" for r in silent)
            warned = sum(r["warned"] not in ("no", "open", "beside") for r in found)
            left_open, said = (sum(r["warned"] == w for r in found) for w in ("open", "beside"))
            numbers = (len(found), warned, left_open, said, len(wrong), named, len(silent))
            lines.append(f"| {name} | {' | '.join(map(str, numbers))} | {hidden} |")
    return "\n".join(lines)


if __name__ == "__main__":
    print(counts(read_rows(Path(sys.argv[1]))))
