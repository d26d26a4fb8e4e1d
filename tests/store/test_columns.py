"""Every column that is written is described on the site's page of columns, and the page has no column that is not."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from pathlib import Path

from bayesdamp import store
from bayesdamp.calibrate import tables as calibrated
from bayesdamp.verdict import types as verdict

PAGE = Path(__file__).resolve().parents[2] / "docs" / "columns.md"
WRITTEN: Mapping[str, Sequence[str]] = {
    **store.TABLES,
    **store.SPECIMEN_TABLES,
    "verdicts.csv": verdict.columns(),
    "damping_curves.csv": ("record", "unit", *store.DAMPING_CURVES),
    "calibration.csv": calibrated.COLUMNS,
    "ranks.csv": calibrated.RANK_COLUMNS,
    "recovery.csv": calibrated.RECORD_COLUMNS,
}


def described(page: str) -> dict[str, set[str]]:
    """Return the columns that a page describes, by table."""
    parts = re.split(r"^## ", page, flags=re.MULTILINE)
    tables = {
        head: body for head, _, body in (part.partition("\n") for part in parts) if head.endswith("csv")
    }
    return {
        name: {
            c for row in re.findall(r"^\| (`.*?) \|", body, re.MULTILINE) for c in re.findall(r"`(.*?)`", row)
        }
        for name, body in tables.items()
    }


def test_columns_are_described() -> None:
    found = described(PAGE.read_text(encoding="utf-8"))
    assert {table: sorted(columns) for table, columns in found.items()} == {
        table: sorted(columns) for table, columns in WRITTEN.items()
    }


def test_a_column_without_a_description_is_seen() -> None:
    page = PAGE.read_text(encoding="utf-8")
    assert "rms" not in described(page.replace("| `rms` |", "| rms |"))["fits.csv"]
