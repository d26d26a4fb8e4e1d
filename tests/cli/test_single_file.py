"""What a command writes beside a run's folder replaces nothing that it did not make."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest

from bayesdamp.cli import look_page, main
from bayesdamp.cli.files import GENERATOR

WRITING = {
    "mine.csv": ("simulate", "--samples", "400", "--duration", "8", "--out"),
    "mine.html": ("look", "ok.csv", "--html"),
    "mine.md": ("claims", "--out"),
}
"""The name of a file, and the command that writes one of its kind."""


def test_a_file_of_the_user_s_stays(
    folder: Path,
    refused: Callable[..., str],
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.setattr("bayesdamp.cli.commands.claims.CLAIMS", ())  # which take seconds to measure
    like = (
        f"<!doctype html><style></style><p>{GENERATOR}\n# Mine\n\nMade by `bayesdamp claims`. So he said.\n"
    )
    for name, words in WRITING.items():
        for content in (
            b"precious\n",
            b"",
            b"\xff\x00",
            like.encode(),
            b"t,x\n0,0.3\n# simulated by bayesdamp\n",
        ):
            (folder / name).write_bytes(content)
            what = "already exists and was not made by bayesdamp; give another name, or remove it"
            assert refused(*words, name) == f"{words[-1]} {name}: {what}"
            assert (folder / name).read_bytes() == content
        (folder / name).unlink()  # the control: a new name, and then what the command itself wrote
        for _ in range(2):
            assert main([*words, name]) == 0
            capsys.readouterr()
        made = (folder / name).read_bytes()
        for other, command in WRITING.items():  # of another kind
            if other != name:
                refused(*command, name)
        assert (folder / name).read_bytes() == made


def test_what_a_command_reads_it_does_not_replace(
    folder: Path, refused: Callable[..., str], capsys: pytest.CaptureFixture[str]
) -> None:
    before = (folder / "ok.csv").read_bytes()
    assert "is an input of this command" in refused("look", "ok.csv", "--html", "./ok.csv")
    assert main(["look", "ok.csv", "--html", "ok.html"]) == 0
    capsys.readouterr()
    drawn = (folder / "ok.html").read_bytes()  # of the right kind, and yet
    assert "is an input of this command" in refused("look", "ok.html", "--html", "ok.html")
    assert "is an input" not in refused("look", "none.csv", "--html", "other.html")  # the control
    assert (folder / "ok.csv").read_bytes() == before
    assert (folder / "ok.html").read_bytes() == drawn


def test_a_file_that_comes_up_meanwhile_stays(
    folder: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def slow(*_: object) -> str:
        (folder / "new.html").write_text("mine")
        return "page"

    monkeypatch.setattr(look_page, "page_of", slow)
    assert main(["look", "ok.csv", "--html", "new.html"]) == 2
    assert "was not made by bayesdamp" in capsys.readouterr().err
    assert (folder / "new.html").read_text() == "mine"
