"""Counts by kind over a table of scored cases, as Markdown: `python -m tests.misfit.summary TABLE`."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from pathlib import Path

from tests.misfit.cases import INSIDE, OUTSIDE
from tests.misfit.scoring import LIMIT, read_rows

HEADS = (
    "kind",
    "cases",
    "misfit or refused",
    "left open",
    f"wrong above {LIMIT:g}",
    "of these unwarned",
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
            silent = [r for r in wrong if r["warned"] == "no"]
            hidden = ", ".join(f"{float(r['nats_hidden']):.0f} ({r['relation']})" for r in silent)
            warned = sum(r["warned"] not in ("no", "open") for r in found)
            left_open = sum(r["warned"] == "open" for r in found)
            lines.append(
                f"| {name} | {len(found)} | {warned} | {left_open} | {len(wrong)} | {len(silent)} | {hidden} |"
            )
    return "\n".join(lines)


if __name__ == "__main__":
    print(counts(read_rows(Path(sys.argv[1]))))
