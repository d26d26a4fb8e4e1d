"""The environment of a command: width and letters of the terminal, no screen, unusual file names."""

import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from bayesdamp.cli import main

LOOK = ("look", "ok.csv")


def in_process(words: tuple[str, ...], **environment: str) -> subprocess.CompletedProcess[bytes]:
    """Run the command in a new process with these environment variables."""
    command = (sys.executable, "-m", "bayesdamp", *words)
    return subprocess.run(command, env={**os.environ, **environment}, capture_output=True)


pytestmark = pytest.mark.usefixtures("folder")


def test_a_terminal_may_have_any_width(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    for columns in ("0", "1", "80"):
        monkeypatch.setenv("COLUMNS", columns)
        assert main(LOOK) == 0
        printed = capsys.readouterr().out
        assert "Used:" in "".join(printed.split())
        assert not printed.isascii()  # the control of the next test


def test_missing_letters_are_replaced() -> None:
    process = in_process(LOOK, PYTHONIOENCODING="ascii")
    assert (process.returncode, process.stderr) == (0, b"")
    assert process.stdout.isascii()
    assert b"Used:" in process.stdout


def test_figures_need_no_screen(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("MPLBACKEND", "nonsense")
    assert main(("--version",)) == 0
    assert os.environ["MPLBACKEND"] == "agg"


def test_a_file_name_may_have_two_lines(folder: Path) -> None:
    (folder / "ok.csv").rename(folder / "a\nb.csv")
    assert main(["init", "a\nb.csv"]) == 0
    first = (folder / "a\nb.toml").read_text(encoding="utf-8").splitlines()[0]
    assert first.startswith("# A study of a\\nb.csv with")
    assert main(["check", "a\nb.toml"]) == 0


def test_a_file_name_that_is_not_utf_8_is_refused_where_a_run_would_contain_it(
    folder: Path, refused: Callable[..., str]
) -> None:
    """Control: `look` reads it."""
    name = os.fsdecode(b"\xff.csv")
    try:
        (folder / "ok.csv").rename(folder / name)
    except OSError:
        pytest.skip("this file system does not allow such names")
    line = "\\udcff.csv: the file name is not valid UTF-8; rename the file"
    for command in ("compare", "init"):
        assert refused(command, name).startswith(line)
    process = in_process(("look", name))
    assert (process.returncode, process.stderr) == (0, b"")
