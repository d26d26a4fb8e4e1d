"""Write the page on the accuracy of the answer: `python -m validation.reports.deviation ROWS.csv FOLDER`."""

from __future__ import annotations

import sys
from pathlib import Path

import pandas as pd

from validation.answers import COLUMNS
from validation.rows import read_frame, write_frame
from validation.scoring import SHARES, markdown, scores, where, with_interval

TITLE = "# Laws that hold approximately: how accurate is the answer?"
INTRODUCTION = """The records are simulated, with a truth from an independent solver (`validation.truth.records`,
SciPy's DOP853). They are answered under all dampings and restoring laws with linear models, without sampling. No
threshold and no prior was chosen on these seeds. Records of the family are drawn until the true sum is 12 nats or more
ahead of every sum that lacks one of its terms; among arbitrary records, fewer dampings could be named. *none* assumes
that laws hold exactly; *auto* averages over exact and approximate laws. The brackets contain 95 % intervals of the
fractions for this number of records. Widths are relative to those of exact laws on the same record.
"""
BARS = """Targets. Family, *none*: named outright at least 0.90, right at least 0.97, coverage 0.92 to 0.98.
Family, *auto*: named outright at least 0.75, right at least 0.95, coverage at least 0.95, intervals at most twice as
wide. Discrepant records, *auto*: coverage at least 0.92 (0.90 at ten times the sampling rate); named wrongly and
*deviates* at most 0.05 each.
"""


def page(rows: pd.DataFrame) -> str:
    """Return the page in Markdown, from rows that `validation.run` wrote."""
    table = scores(rows)
    seeds = ", ".join(sorted({str(case).split("-")[1] for case in rows["case"]}))
    origin = "`make reports` makes this table again, from a clean working tree; `rows.csv` has every record."
    head = [TITLE, "", answer(table), "", INTRODUCTION, BARS]
    return "\n".join([*head, f"Seed {seeds}:", "", markdown(table), "", origin, ""])


def answer(table: pd.DataFrame) -> str:
    """Return the result of the page: a sentence on records of exact laws, and one on those with discrepancies."""
    sentences = []
    for group, condition in (
        ("family/auto", "a law holds exactly"),
        ("all discrepancies/auto", "a law holds only approximately"),
    ):
        for line in where(table, group=group).to_dict("records"):
            share = {k: with_interval(line[k], line[f"{k}_low"], line[f"{k}_high"]) for k in SHARES}
            sentences.append(
                f"If {condition}, 95 % intervals of the damping ratio contain the truth in {share['coverage']} of "
                f"{line['records']} records; the damping is named outright in {share['decided']}, correctly in "
                f"{share['right']} of these."
            )
    return " ".join(sentences) or "No record belongs to a judged group."


def main(table: Path, folder: Path) -> None:
    """Write README.md and rows.csv into a folder."""
    rows = read_frame(table, COLUMNS)
    write_frame(folder / "rows.csv", rows)
    (folder / "README.md").write_text(page(rows), encoding="utf-8")


if __name__ == "__main__":
    main(Path(sys.argv[1]), Path(sys.argv[2]))
