"""What surrounds a command: the terminal's width and letters, a screen that is none, names that no text can hold."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from bayesdamp.cli import main

LOOK = ("look", "ok.csv")


def in_process(words: tuple[str, ...], **environment: str) -> subprocess.CompletedProcess[bytes]:
    """The command in an environment of its own."""
    return subprocess.run(
        (sys.executable, "-m", "bayesdamp", *words), env={**os.environ, **environment}, capture_output=True
    )


pytestmark = pytest.mark.usefixtures("folder")


def test_a_terminal_of_any_width_is_told(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    for columns in ("0", "1", "80"):
        monkeypatch.setenv("COLUMNS", columns)
        assert main(LOOK) == 0
        said = capsys.readouterr().out
        assert "Used:" in "".join(said.split())
        assert not said.isascii()  # the control of the next test


def test_letters_and_screens_that_the_output_has_not(folder: Path) -> None:
    """Letters are replaced, and a page is drawn without a screen."""
    done = in_process((*LOOK, "--html", "ok.html"), PYTHONIOENCODING="ascii", MPLBACKEND="nonsense")
    assert (done.returncode, done.stderr) == (0, b"")
    assert done.stdout.isascii()
    assert b"Used:" in done.stdout
    assert "data:image/svg" in (folder / "ok.html").read_text(encoding="utf-8")


def test_a_study_of_a_file_whose_name_has_two_lines(folder: Path) -> None:
    (folder / "ok.csv").rename(folder / "a\nb.csv")
    assert main(["init", "a\nb.csv"]) == 0
    first = (folder / "a\nb.toml").read_text(encoding="utf-8").splitlines()[0]
    assert first.startswith("# A study of a\\nb.csv with")
    assert main(["check", "a\nb.toml"]) == 0


def test_a_name_that_no_text_can_hold(folder: Path, refused: Callable[..., str]) -> None:
    """It is read where only its content counts, and refused rightly where a run would name it."""
    name = os.fsdecode(b"\xff.csv")
    try:
        (folder / "ok.csv").rename(folder / name)
    except OSError:
        pytest.skip("a disk that has no such names")
    for command in ("compare", "init"):
        assert refused(command, name).startswith(
            "\\udcff.csv: the file name is not valid UTF-8; rename the file"
        )
    done = in_process(("look", name, "--html", "a.html"))
    assert (done.returncode, done.stderr) == (0, b"")
