"""The runner keeps each row as it is done, resumes, and says what failed."""

from __future__ import annotations

import inspect
from pathlib import Path
from typing import get_type_hints

import pandas as pd
import pytest

from bayesdamp.verdict.types import Verdict
from validation.answers import COLUMNS
from validation.rows import read_frame
from validation.run import ANSWER, answering_of, main

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


def test_faults_and_refusals_are_kept(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "rows.csv"
    arguments = ["--count", "2", "--answer", f"{HERE}sometimes", "--out", str(out), "--workers", "1"]
    assert main(arguments) == 3
    outcomes = set(read_frame(out, COLUMNS)["outcome"])
    assert outcomes == {"too many samples for this test", "failed: RuntimeError: a fault of two lines"}
    assert "failed: RuntimeError: a fault of two lines" in capsys.readouterr().err


def test_wrong_input_is_one_line(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for arguments, text in (
        (
            ["--group", "cubic"],
            "--group 'cubic' is unknown: it must be discrepant or one of family, cubic_sensor",
        ),
        (["--answer", "math"], "--answer 'math' must be module:function"),
    ):
        out = tmp_path / "rows.csv"
        assert main([*arguments, "--out", str(out), "--workers", "1"]) == 2
        said = capsys.readouterr().err
        assert text in said
        assert said.count("\n") == 1
        assert not out.exists()


def test_the_answer_that_is_judged_by_default_is_one() -> None:
    """The default was once a function whose result no row could be made of."""
    parameters = inspect.signature(answering_of(ANSWER)).parameters
    assert list(parameters)[:2] == ["signal", "amplitudes"]
    assert get_type_hints(answering_of(ANSWER))["return"] is Verdict
