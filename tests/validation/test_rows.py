"""A table of rows: each is kept as it is computed, a second run adds what is missing, and other columns are refused."""

from __future__ import annotations

from functools import partial
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from bayesdamp.types import InputError
from tests.validation.answering import by_envelope, sometimes
from validation.reports.deviation import COLUMNS, page, row_of
from validation.rows import complete_rows, make_page, page_options, read_rows
from validation.truth.records import KINDS, case


def row(kind: str, number: int, mode: str) -> dict[str, object]:
    """Answer a record without the package."""
    return row_of(case(kind, 1, number), partial(by_envelope, deviation=mode), mode)


def refused_or_failed(number: int) -> dict[str, object]:
    return row_of(case("family", 1, number), partial(sometimes, deviation="auto"), "auto")


def jobs(count: int, mode: str) -> dict[str, tuple[str, int, str]]:
    return {f"{kind}-1-0/{mode}": (kind, 0, mode) for kind in KINDS[1 : 1 + count]}


def test_a_run_scores_and_resumes(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    table, key = tmp_path / "rows.csv", ("case", "mode")
    first = complete_rows(table, COLUMNS, jobs(2, "none"), row, 1, key)
    assert list(first["case"]) == ["cubic_sensor-1-0", "drift-1-0"]
    capsys.readouterr()
    second = complete_rows(table, COLUMNS, jobs(3, "none"), row, 1, key)
    pd.testing.assert_frame_equal(second.iloc[:2], first)
    assert list(second["case"][2:]) == ["power-1-0"]
    assert capsys.readouterr().err == "1/1 power-1-0 viscous\n"
    todo = jobs(3, "none") | jobs(3, "auto")
    options = page_options(None).parse_args([str(table), str(tmp_path / "page"), "--workers", "2"])
    make_page(options, "rows.csv", COLUMNS, todo, row, page, key)
    shipped = read_rows(tmp_path / "page" / "rows.csv", COLUMNS)
    assert list(shipped["case"] + "/" + shipped["mode"]) == list(todo)
    assert len(read_rows(table)) == 6
    text = (tmp_path / "page" / "README.md").read_text(encoding="utf-8")
    assert text.count("| all discrepancies/auto | 3 | 3 | 0.00 (0.00–0.56) |") == 1
    assert text.count("| all discrepancies/none | 3 |") == 1


def test_numbers_read_back_with_six_digits(tmp_path: Path) -> None:
    rows = complete_rows(
        tmp_path / "t.csv", ("a", "b", "c"), {"x, y": ()}, lambda: {"a": "x, y", "b": np.pi}, 1
    )
    assert rows.to_dict("records") == [{"a": "x, y", "b": 3.14159, "c": pytest.approx(np.nan, nan_ok=True)}]


def test_a_refusal_is_a_row_and_a_fault_ends_the_run(tmp_path: Path) -> None:
    table = tmp_path / "rows.csv"
    with pytest.raises(RuntimeError, match="a fault"):
        complete_rows(table, COLUMNS, {f"family-1-{i}": (i,) for i in range(2)}, refused_or_failed, 1)
    assert list(read_rows(table)["outcome"]) == ["too many samples for this test"]


def test_other_columns_are_refused(tmp_path: Path) -> None:
    (tmp_path / "t.csv").write_text("a,c\n1,2\n", encoding="utf-8")
    with pytest.raises(InputError, match="the columns differ"):
        read_rows(tmp_path / "t.csv", ("a", "b"))
