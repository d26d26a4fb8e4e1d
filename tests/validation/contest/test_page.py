"""The page, the rows' table, and the command."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from bayesdamp.types import Refusal
from tests.validation.contest.test_contest_scoring import row, table
from validation.contest import rows
from validation.contest.__main__ import main
from validation.contest.page import page, write
from validation.contest.records import closed_form
from validation.contest.reply import Reply
from validation.contest.roster import OURS
from validation.rows import rounded, write_row


def stored():
    """Twenty records in which curve_fit is nearer and the decrement is not."""
    made = []
    for i in range(20):
        group = "short" if i % 2 else "family"
        name, error = f"{group}-811-{i}", 0.01 * (1 + i % 5)
        made += [
            row(name, OURS, error, half=0.1, named="viscous", relation="right"),
            row(name, "curve_fit", error / 4, half=0.001),
            row(name, "decrement", 3 * error, outcome="ok" if i else "fewer than three peaks"),
        ]
    return table(*made)


def test_a_peer_that_is_nearer_is_said():
    said = page(stored(), {})
    lines = [x for x in said.splitlines() if x.startswith("- **")]
    assert any(
        x.startswith("- **SciPy curve_fit, decaying cosine** is nearer in: family, short") for x in lines
    )
    assert not any(x.startswith("- **logarithmic") for x in lines)
    assert "logarithmic decrement: 1 × fewer than three peaks" in said
    assert "Seed 811;" in said


def test_no_peer_is_nearer_where_none_is():
    made = [row(f"family-811-{i}", OURS, 0.01 * (1 + i % 5)) for i in range(20)]
    made += [row(f"family-811-{i}", "script", 0.01 * (1 + (i + 2) % 5)) for i in range(20)]
    made += [row(f"family-811-{i}", "decrement", 0.5) for i in range(20)]
    said = page(table(*made), {})
    assert "no peer is nearer to the truth in any group by more than chance" in said
    assert "- Neither nearer nor farther by more than chance: an engineer's script in family." in said
    assert "no peer is nearer" not in page(stored(), {})


def test_plots_and_page_are_written(tmp_path: Path):
    write(tmp_path, stored(), {})
    assert {p.name for p in tmp_path.iterdir()} == {"README.md", "errors.svg", "cost.svg"}
    before = (tmp_path / "errors.svg").read_bytes()
    write(tmp_path, stored(), {})
    assert (tmp_path / "errors.svg").read_bytes() == before


def test_the_row_of_an_answer_a_refusal_and_a_fault(tmp_path: Path):
    def refuses(t, y, amplitudes):
        raise Refusal("too short")

    def fails(t, y, amplitudes):
        raise ZeroDivisionError("by nothing")

    def nothing(t, y, amplitudes):
        return Reply((float("nan"),) * 3)

    record = closed_form()
    made = [rows.row_of(record, name, peer) for name, peer in (("a", refuses), ("b", fails), ("c", nothing))]
    good = rows.row_of(record, "d", lambda t, y, a: Reply((0.02,) * 3, named="viscous"))
    assert [r["outcome"] for r in made] == [
        "too short",
        "ZeroDivisionError: by nothing",
        "its ratio is not finite",
    ]
    assert (good["outcome"], good["relation"], good["value_2"]) == ("ok", "right", 0.02)
    for one in (*made, good, good | {"peer": "e", "seconds": float("nan")}):
        write_row(tmp_path / "rows.csv", rows.COLUMNS, rounded(one))
    read = rows.read(tmp_path / "rows.csv")
    assert list(read["peer"]) == list("abcde")
    assert np.isnan(read["seconds"].iloc[-1])
    assert list(read["named"]) == ["", "", "", "viscous", "viscous"]


def test_it_goes_on_where_it_was_cut_off(tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    command = ["--peers", "decrement", "--out", str(tmp_path), "--measured", str(tmp_path)]
    assert main([*command, "--count", "1"]) == 0
    first = (tmp_path / "rows.csv").read_text()
    assert main([*command, "--count", "2"]) == 0
    again = (tmp_path / "rows.csv").read_text()
    assert again.startswith(first)
    assert len(again.splitlines()) == 3
    assert "measured records are omitted: Run_1-10_no_magnet.csv is missing" in capsys.readouterr().err


def test_a_wrong_option_is_one_line(capsys: pytest.CaptureFixture[str]):
    cases = [["--peers", "nobody"], ["--count", "-1"], ["--page", "--out", "no-such-folder"]]
    for wrong in cases:
        assert main(wrong) == 2
        assert capsys.readouterr().err.count("\n") == 1
