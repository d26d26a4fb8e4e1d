"""What tests share: no plug-in stays after a test; a command that is refused, and a folder with a simulated record."""

from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from bayesdamp.cli import main
from bayesdamp.plugins import use_modules


@pytest.fixture(autouse=True)
def _no_plug_in_stays() -> Iterator[None]:
    yield
    use_modules(())


@pytest.fixture
def refused(capsys: pytest.CaptureFixture[str]) -> Callable[..., str]:
    """Run a command that exits with status 2 and prints one short line to stderr; return the line."""

    def run(*words: str) -> str:
        assert main(words) == 2
        printed = capsys.readouterr()
        assert printed.out == ""
        (line,) = printed.err.splitlines()
        assert 0 < len(line) <= 300
        return line

    return run


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> Path:
    """A working directory with a simulated record, ok.csv."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("COLUMNS", "80")
    monkeypatch.delenv("BAYESDAMP_DEBUG", raising=False)
    assert main(["simulate", "--samples", "400", "--duration", "8", "--out", "ok.csv"]) == 0
    capsys.readouterr()
    return tmp_path
