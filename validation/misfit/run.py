"""Score simulated cases: `python -m validation.misfit.run TABLE FOLDER --seed 21 [--count 4 --kinds clean,beats]`."""

from __future__ import annotations

import argparse
from pathlib import Path

from validation.misfit.cases import INSIDE, OUTSIDE
from validation.misfit.scoring import COLUMNS, row
from validation.misfit.summary import page
from validation.rows import gathered, shipped


def main() -> None:
    """Score the cases that the table lacks; write README.md and scored.csv into the folder."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("table", type=Path, help="CSV file of the rows; missing rows are added")
    parser.add_argument("folder", type=Path, help="folder of the page")
    parser.add_argument("--seed", type=int, required=True)
    parser.add_argument("--count", type=int, default=1)
    parser.add_argument("--kinds", default=",".join((*INSIDE, *OUTSIDE)))
    parser.add_argument("--workers", type=int, default=2)
    given = parser.parse_args()
    todo = {
        f"{kind}-{given.seed}-{number}": (kind, number, given.seed)
        for number in range(given.count)
        for kind in given.kinds.split(",")
    }
    rows = gathered(given.table, COLUMNS, todo, row, given.workers)
    shipped(given.folder / "scored.csv", COLUMNS, rows)
    (given.folder / "README.md").write_text(page(rows), encoding="utf-8")


if __name__ == "__main__":
    main()
