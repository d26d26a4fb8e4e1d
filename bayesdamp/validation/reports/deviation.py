"""The page of what the answer is worth: `python -m bayesdamp.validation.reports.deviation ROWS.csv FOLDER`."""

from __future__ import annotations

import sys
from pathlib import Path

import pandas as pd

from bayesdamp.validation.scoring import markdown, scores

INTRODUCTION = """# Laws that hold approximately: what the answer is worth

Simulated records with a truth from outside (`bayesdamp.validation.truth.records`, SciPy's DOP853), answered under all
dampings and restoring laws from linear models, before any sampling. No threshold and no prior was chosen on these
seeds. *none* takes laws to hold exactly; *auto* weighs exact and approximate ones. In brackets: 95 % intervals of the
shares, by the number of records. Widths are relative to those of exact laws on the same record.
"""
BARS = """What was aimed at. In the family, none: named at least 0.90, right 0.97, coverage 0.92 to 0.98; auto: 0.75,
0.95, at least 0.95, at most twice as wide. Discrepant, auto: coverage at least 0.92 (0.90 at ten times the sampling
rate), wrong outright and *deviates* each at most 0.05.
"""


def page(rows: pd.DataFrame) -> str:
    """The page, in Markdown, from rows as `bayesdamp.validation.run` writes them."""
    seeds = ", ".join(sorted({str(case).split("-")[1] for case in rows["case"]}))
    made = "`make reports` makes the table again, from a clean tree; `rows.csv` has every record."
    return "\n".join([INTRODUCTION, BARS, f"Seed {seeds}:", "", markdown(scores(rows)), "", made, ""])


def main(table: Path, folder: Path) -> None:
    """Write README.md and rows.csv into a folder."""
    rows = pd.read_csv(table, keep_default_na=False, na_values=[""])
    folder.mkdir(parents=True, exist_ok=True)
    rows.to_csv(folder / "rows.csv", index=False, float_format="%.6g")
    (folder / "README.md").write_text(page(rows), encoding="utf-8")


if __name__ == "__main__":
    main(Path(sys.argv[1]), Path(sys.argv[2]))
