"""A table of rows: each is written once computed, a second run adds the missing ones, other columns are refused."""

from pathlib import Path
from unittest.mock import Mock

import numpy as np
import pandas as pd
import pytest

from bayesdamp.types import InputError, Refusal
from tests.validation.answering import a_case, peer_of
from validation.reports.accuracy import page
from validation.scoring import COLUMNS, complete_rows, make_page, page_options, read_rows, row_of
from validation.truth.records import KINDS


def row(kind: str, mode: str) -> dict[str, object]:
    """Answer a record without the package; `auto` has intervals of half the width, and only a drift deviates."""
    case = a_case(0, kind)
    sure, grade = 2.0 if mode == "auto" else 1.0, "deviates" if kind == "drift" else "exact"
    return row_of(case, peer_of(case, np.random.default_rng(1), sure=sure, grade=grade), mode)


def refused_or_failed(number: int) -> dict[str, object]:
    """Refuse the first record, and fail on the next."""
    faults = Refusal("too many samples for this test"), RuntimeError("a fault\nof two lines")
    return row_of(a_case(number), Mock(side_effect=faults[number]))


def jobs(count: int, mode: str) -> dict[str, tuple[str, str]]:
    return {f"{kind}-0/{mode}": (kind, mode) for kind in KINDS[1 : 1 + count]}


def test_a_run_scores_and_resumes(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    table = tmp_path / "rows.csv"
    first = complete_rows(table, jobs(2, "none"), row, workers=1)
    assert list(first["record"]) == ["cubic_sensor-0", "drift-0"]
    capsys.readouterr()
    second = complete_rows(table, jobs(3, "none"), row, workers=1)
    pd.testing.assert_frame_equal(second.iloc[:2], first)
    assert list(second["record"][2:]) == ["power-0"]
    assert capsys.readouterr().err == "1/1 power-0 viscous\n"
    todo = jobs(3, "none") | jobs(3, "auto")
    options = page_options(None).parse_args([str(table), str(tmp_path / "page"), "--workers", "2"])
    make_page(options, todo, row, page)
    shipped = read_rows(tmp_path / "page" / "rows.csv", COLUMNS)
    assert list(shipped["record"] + "/" + shipped["peer"]) == list(todo)
    assert len(read_rows(table)) == 6
    text = (tmp_path / "page" / "README.md").read_text(encoding="utf-8")
    assert text.count("| all discrepancies, auto | 3 | 3 | 3 of 3 (0.44–1.00) |") == 1
    for group, deviates in (("drift", 1), ("power", 0)):
        (line,) = (line for line in text.splitlines() if line.startswith(f"| {group}, auto |"))
        assert f"| 4.9 % | {deviates} |" in line


def test_numbers_read_back_with_six_digits(tmp_path: Path) -> None:
    row = {"record": "x, y", "peer": "b", "outcome": "ok", "seconds": np.pi}
    (read,) = complete_rows(tmp_path / "t.csv", {"x, y/b": ()}, lambda: row, workers=1).to_dict("records")
    assert read == {name: pytest.approx(np.nan, nan_ok=True) for name in COLUMNS} | row | {"seconds": 3.14159}


def test_a_refusal_is_a_row_and_an_exception_ends_the_run(tmp_path: Path) -> None:
    table = tmp_path / "rows.csv"
    with pytest.raises(RuntimeError, match="a fault"):
        complete_rows(table, {f"family-{i}/bayesdamp": (i,) for i in range(2)}, refused_or_failed, workers=1)
    assert list(read_rows(table)["outcome"]) == ["too many samples for this test"]


def test_other_columns_are_refused(tmp_path: Path) -> None:
    (tmp_path / "t.csv").write_text("a,c\n1,2\n", encoding="utf-8")
    with pytest.raises(InputError, match="the columns differ"):
        read_rows(tmp_path / "t.csv", ("a", "b"))
