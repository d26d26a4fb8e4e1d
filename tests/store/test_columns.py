"""The page docs/columns.md describes every column of every table that the program writes, and no other column."""

import re
from collections.abc import Mapping, Sequence
from pathlib import Path

from bayesdamp.calibrate import tables as calibrated
from bayesdamp.store import files as stored
from bayesdamp.verdict import types as verdict

PAGE = Path(__file__).resolve().parents[2] / "docs" / "columns.md"
WRITTEN: Mapping[str, Sequence[str]] = {
    **stored.TABLES,
    "verdicts.csv": verdict.columns(),
    "damping_curves.csv": ("record", "unit", *stored.DAMPING_CURVES),
    "population.csv": stored.POPULATION,
    "calibration.csv": calibrated.COLUMNS,
    "ranks.csv": calibrated.RANK_COLUMNS,
    "recovery.csv": calibrated.RECORD_COLUMNS,
}


def described(page: str) -> dict[str, set[str]]:
    """Return the columns that a page describes, by table."""
    tables: dict[str, set[str]] = {}
    for part in re.split(r"^## ", page, flags=re.MULTILINE):
        head, _, body = part.partition("\n")
        if head.endswith("csv"):
            first_cells = "".join(re.findall(r"^\| (`.*?) \|", body, re.MULTILINE))
            tables[head] = set(re.findall(r"`(.*?)`", first_cells))
    return tables


def test_the_page_describes_exactly_the_columns_that_are_written() -> None:
    """Control: a column whose name is not marked as code counts as not described."""
    page = PAGE.read_text(encoding="utf-8")
    columns = {table: sorted(names) for table, names in described(page).items()}
    assert columns == {table: sorted(names) for table, names in WRITTEN.items()}
    assert "rms" not in described(page.replace("| `rms` |", "| rms |"))["fits.csv"]
