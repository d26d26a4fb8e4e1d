"""Commands that write a single file replace only files that they have written themselves."""

from collections.abc import Callable
from pathlib import Path

import pytest

from bayesdamp.cli import main
from bayesdamp.cli.commands import simulate

WRITING = {"mine.csv": "simulate --samples 400 --duration 8 --out", "mine.md": "claims --out"}
"""The name of a file, and a command that writes such a file."""
SIMILAR = "# Mine\n\nMade by `bayesdamp claims`. So he said.\n"
CONTENTS = (b"precious\n", b"", b"\xff\x00", SIMILAR.encode(), b"t,x\n0,0.3\n# simulated by bayesdamp\n")


@pytest.mark.parametrize("name", WRITING)
def test_a_user_s_file_is_not_replaced(
    folder: Path, refused: Callable[..., str], monkeypatch: pytest.MonkeyPatch, name: str
) -> None:
    """Controls: a new name, and a file that the same command has written."""
    monkeypatch.setattr("bayesdamp.cli.commands.claims.CLAIMS", ())  # the claims take seconds to compute
    words = WRITING[name].split()
    line = "already exists and was not made by bayesdamp; give another name, or delete that file"
    for content in CONTENTS:
        (folder / name).write_bytes(content)
        assert refused(*words, name) == f"{words[-1]} {name}: {line}"
        assert (folder / name).read_bytes() == content
    (folder / name).unlink()
    assert [main([*words, name]) for _ in range(2)] == [0, 0]
    written = (folder / name).read_bytes()
    for command in (command for other, command in WRITING.items() if other != name):
        assert main([*command.split(), name]) == 2
    assert (folder / name).read_bytes() == written


def test_a_file_that_appears_during_the_command_is_not_replaced(
    folder: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def slow(*_: object) -> str:
        (folder / "new.csv").write_text("mine")
        return "t,x"

    monkeypatch.setattr(simulate, "as_csv", slow)
    assert main(["simulate", "--out", "new.csv"]) == 2
    assert "was not made by bayesdamp" in capsys.readouterr().err
    assert (folder / "new.csv").read_text() == "mine"
