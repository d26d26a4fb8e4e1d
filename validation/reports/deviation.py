"""The page of what the answer is worth: `python -m validation.reports.deviation ROWS.csv FOLDER`."""

from __future__ import annotations

import sys
from pathlib import Path

import pandas as pd

from validation.answers import COLUMNS
from validation.rows import read_frame, write_frame
from validation.scoring import SHARES, markdown, scores, where, with_interval

TITLE = "# Laws that hold approximately: what the answer is worth"
INTRODUCTION = """Simulated records with a truth from outside (`validation.truth.records`, SciPy's DOP853),
answered under all dampings and restoring laws from linear models, before any sampling. No threshold and no prior was
chosen on these seeds. Records of the family are drawn until the true sum is 12 nats or more ahead of every sum that
lacks one of its terms: of any records, fewer could be named. *none* takes laws to hold exactly; *auto* weighs exact and
approximate ones. In brackets: 95 % intervals of the shares, by the number of records. Widths are relative to those of
exact laws on the same record.
"""
BARS = """What was aimed at. In the family, none: named at least 0.90, right 0.97, coverage 0.92 to 0.98; auto: 0.75,
0.95, at least 0.95, at most twice as wide. Discrepant, auto: coverage at least 0.92 (0.90 at ten times the sampling
rate), wrong outright and *deviates* each at most 0.05.
"""


def page(rows: pd.DataFrame) -> str:
    """The page, in Markdown, from rows as `validation.run` writes them."""
    table = scores(rows)
    seeds = ", ".join(sorted({str(case).split("-")[1] for case in rows["case"]}))
    made = "`make reports` makes the table again, from a clean tree; `rows.csv` has every record."
    head = [TITLE, "", answer(table), "", INTRODUCTION, BARS]
    return "\n".join([*head, f"Seed {seeds}:", "", markdown(table), "", made, ""])


def answer(table: pd.DataFrame) -> str:
    """What the scores say of both groups, in a sentence each."""
    said = []
    for group, condition in (
        ("family/auto", "law holds"),
        ("all discrepancies/auto", "law does not hold quite"),
    ):
        for line in where(table, group=group).to_dict("records"):
            share = {k: with_interval(line[k], line[f"{k}_low"], line[f"{k}_high"]) for k in SHARES}
            said.append(
                f"Where a {condition}, 95 % intervals of the damping ratio hold the truth in {share['coverage']} of "
                f"{line['records']} records; the damping is named outright in {share['decided']}, rightly in "
                f"{share['right']} of these."
            )
    return " ".join(said) or "No record is of a group that is judged."


def main(table: Path, folder: Path) -> None:
    """Write README.md and rows.csv into a folder."""
    rows = read_frame(table, COLUMNS)
    write_frame(folder / "rows.csv", rows)
    (folder / "README.md").write_text(page(rows), encoding="utf-8")


if __name__ == "__main__":
    main(Path(sys.argv[1]), Path(sys.argv[2]))
