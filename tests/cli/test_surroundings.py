"""What surrounds a command: the terminal's width and letters, a screen that is none, names that no text can hold."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

from bayesdamp.cli import main

LOOK = ("look", "ok.csv")


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> Path:
    """Of a simulated record."""
    monkeypatch.chdir(tmp_path)
    assert main(["simulate", "--samples", "400", "--duration", "8", "--out", "ok.csv"]) == 0
    capsys.readouterr()
    return tmp_path


def one_line(capsys: pytest.CaptureFixture[str]) -> str:
    """What was said of a wrong input."""
    said = capsys.readouterr()
    assert said.out == ""
    assert said.err.count("\n") == 1
    return said.err


def in_process(words: tuple[str, ...], **environment: str) -> subprocess.CompletedProcess[bytes]:
    """The command in an environment of its own."""
    return subprocess.run(
        (sys.executable, "-m", "bayesdamp", *words), env={**os.environ, **environment}, capture_output=True
    )


@pytest.mark.parametrize("columns", ["0", "1", "2", "80"])
def test_a_terminal_of_any_width_is_told(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], columns: str
) -> None:
    monkeypatch.setenv("COLUMNS", columns)
    assert main(LOOK) == 0
    assert "Used:" in "".join(capsys.readouterr().out.split())


def test_letters_that_the_output_has_not_are_replaced() -> None:
    for environment in (
        {"PYTHONIOENCODING": "ascii"},
        {"LC_ALL": "C", "PYTHONUTF8": "0", "PYTHONCOERCECLOCALE": "0"},
    ):
        done = in_process(LOOK, **environment)
        assert (done.returncode, done.stderr) == (0, b"")
        assert done.stdout.isascii()
        assert b"Used:" in done.stdout
    assert not in_process(LOOK, PYTHONIOENCODING="utf-8").stdout.isascii()  # the control: it has them


def test_a_page_is_drawn_without_a_screen(folder: Path) -> None:
    done = in_process((*LOOK, "--html", "ok.html"), MPLBACKEND="nonsense")
    assert (done.returncode, done.stderr) == (0, b"")
    assert "data:image/svg" in (folder / "ok.html").read_text(encoding="utf-8")


def test_a_study_of_a_file_whose_name_has_two_lines(folder: Path) -> None:
    (folder / "ok.csv").rename(folder / "a\nb.csv")
    assert main(["init", "a\nb.csv"]) == 0
    first = (folder / "a\nb.toml").read_text(encoding="utf-8").splitlines()[0]
    assert first.startswith("# A study of a\\nb.csv, as")
    assert main(["check", "a\nb.toml"]) == 0


def test_a_name_that_no_text_can_hold(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """It is read where only its content counts, and refused rightly where a run would name it."""
    name = os.fsdecode(b"\xff.csv")
    try:
        (folder / "ok.csv").rename(folder / name)
    except OSError:
        pytest.skip("a disk that has no such names")
    for command in ("compare", "init"):
        assert main([command, name]) == 2
        assert one_line(capsys).startswith("\\udcff.csv: the file name is not valid UTF-8; rename the file")
    done = in_process(("look", name, "--html", "a.html"))
    assert (done.returncode, done.stderr) == (0, b"")


def test_a_link_that_leads_nowhere_is_not_a_folder(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (folder / "link").symlink_to("gone")
    assert main(["compare", "ok.csv", "--out", "link"]) == 2
    assert "link is not a folder" in one_line(capsys)
    assert main(["compare", "ok.csv", "--out", "ok.csv"]) == 2
    assert "ok.csv is not a folder" in one_line(capsys)  # the control


def test_claims_are_judged_by_a_run_of_the_paper_s_study(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (folder / "base").mkdir()
    about = {"name": "base", "seed": 0, "study": {"name": "base"}, "signals": {}, "models": []}
    (folder / "base" / "run.json").write_text(json.dumps(about))
    assert main(["claims", "--paper", "base", "--out", "a.md"]) == 2
    assert one_line(capsys).startswith(
        "--paper base: is not a run of the paper's study (studies/paper.toml); give"
    )
    paper = Path(__file__).parents[2] / "reports" / "paper"
    assert main(["claims", "--paper", str(paper), "--out", "a.md"]) == 0  # the control
