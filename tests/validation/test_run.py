"""The runner keeps each row as it is done, resumes, and says what failed."""

from __future__ import annotations

import inspect
from pathlib import Path
from typing import get_type_hints

import pandas as pd
import pytest

from bayesdamp.types import InputError
from bayesdamp.verdict.types import Verdict
from validation.answers import COLUMNS
from validation.rows import read_frame
from validation.run import ANSWER, answered, answering_of, jobs, main
from validation.truth.records import KINDS

HERE = "tests.validation.answering:"


def test_a_run_scores_and_resumes(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "rows.csv"
    common = ["--group", "discrepant", "--seed", "1", "--answer", f"{HERE}by_envelope", "--out", str(out)]
    assert main([*common, "--count", "2", "--deviation", "none", "--workers", "1"]) == 0
    first = read_frame(out, COLUMNS)
    assert list(first["case"]) == ["cubic_sensor-1-0", "drift-1-0"]
    assert main([*common, "--count", "3", "--deviation", "none", "--workers", "1"]) == 0
    second = read_frame(out, COLUMNS)
    pd.testing.assert_frame_equal(second.iloc[:2], first)
    assert list(second["case"][2:]) == ["power-1-0"]
    assert main([*common, "--count", "3", "--deviation", "auto", "--workers", "1"]) == 0
    assert len(read_frame(out, COLUMNS)) == 6
    assert main([*common, "--count", "0"]) == 0  # the scores alone
    said = capsys.readouterr()
    assert "| all discrepancies/auto | 3 | 3 | 0.00 (0.00–0.56) |" in said.out
    assert said.out.count("| all discrepancies/auto | 3 |") == 2
    assert "1/1 power-1-0 viscous" in said.err


def test_two_processes_make_the_rows_of_one(tmp_path: Path) -> None:
    rows = []
    for workers in ("1", "2"):
        out = tmp_path / f"{workers}.csv"
        arguments = ["--count", "2", "--answer", f"{HERE}by_envelope", "--out", str(out)]
        assert main([*arguments, "--workers", workers]) == 0
        rows.append(read_frame(out, COLUMNS).sort_values("case", ignore_index=True).drop(columns="seconds"))
    pd.testing.assert_frame_equal(*rows)


def test_faults_and_refusals_are_kept(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "rows.csv"
    arguments = ["--count", "2", "--answer", f"{HERE}sometimes", "--out", str(out), "--workers", "1"]
    assert main(arguments) == 3
    outcomes = set(read_frame(out, COLUMNS)["outcome"])
    assert outcomes == {"too many samples for this test", "failed: RuntimeError: a fault of two lines"}
    assert "failed: RuntimeError: a fault of two lines" in capsys.readouterr().err


def test_records_are_named_as_their_jobs() -> None:
    todo = jobs("discrepant", 3, 0, 12, 10)
    assert {job.kind for job in todo} == set(KINDS[1:])
    assert answered(todo[11], f"{HERE}by_envelope", "auto")["case"] == todo[11].name == "drift-3-1-x10"


def test_wrong_input_is_one_line(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    cases = [
        (
            ["--group", "cubic"],
            "--group 'cubic' is unknown: it must be discrepant or one of family, cubic_sensor",
        ),
        (["--answer", "nowhere:answer"], "--answer 'nowhere:answer' must be module:function"),
        (["--answer", "math"], "--answer 'math' must be module:function"),
    ]
    for arguments, text in cases:
        out = tmp_path / "rows.csv"
        assert main([*arguments, "--out", str(out), "--workers", "1"]) == 2
        said = capsys.readouterr().err
        assert text in said
        assert said.count("\n") == 1
        assert not out.exists()


def test_another_table_is_left_alone(tmp_path: Path) -> None:
    out = tmp_path / "rows.csv"
    out.write_text("a,b\n1,2\n", encoding="utf-8")
    with pytest.raises(InputError, match="the columns differ from those"):
        read_frame(out, COLUMNS)


def test_the_answer_that_is_judged_by_default_is_one() -> None:
    """The default was once a function whose result no row could be made of."""
    parameters = inspect.signature(answering_of(ANSWER)).parameters
    assert list(parameters)[:2] == ["signal", "amplitudes"]
    assert get_type_hints(answering_of(ANSWER))["return"] is Verdict
