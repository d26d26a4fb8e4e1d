"""A disk that takes nothing more: one line that names what was to be written, and nothing half-written."""

from __future__ import annotations

import errno
import os
from collections.abc import Callable
from pathlib import Path

import pytest

from bayesdamp.cli import main

COMPARE = ("compare", "ok.csv", "--quick", "--quiet", "--workers", "1", "--out", "run")
SMALL = 1000
"""Bytes of a file that the disk still takes, such as a failed cell."""


def filled(monkeypatch: pytest.MonkeyPatch, code: int = errno.ENOSPC, times: int = 99) -> None:
    """Let files that are not small be refused, so many times."""
    synced: Callable[[int], None] = os.fsync
    left = [times]

    def fsync(handle: int) -> None:
        if left[0] and os.fstat(handle).st_size > SMALL:
            left[0] -= 1
            raise OSError(code, os.strerror(code))
        synced(handle)

    monkeypatch.setattr(os, "fsync", fsync)


def test_nothing_is_left_of_a_file(
    folder: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    for words, named in (
        (("init", "ok.csv"), "ok.toml"),
        (("simulate", "--duration", "8", "--out", "new/deeper/a.csv"), "new/deeper/a.csv"),
        (("look", "ok.csv", "--html", "page/a.html"), "page/a.html"),
    ):
        before = {path for path in folder.rglob("*") if path.is_file()}
        with monkeypatch.context() as full:
            filled(full)
            assert main(words) == 2
        said = "the disk is full; make room there, then run the same command again"
        assert capsys.readouterr().err == f"{named}: {said}\n"
        assert {path for path in folder.rglob("*") if path.is_file()} == before
        assert main(words) == 0  # the control: the same command, with room
        assert (folder / named).is_file()
        capsys.readouterr()


def test_a_cell_that_finds_no_room_is_no_failed_one(
    folder: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    with monkeypatch.context() as full:
        filled(full)
        for _ in range(2):
            assert main(COMPARE) == 2
            said = capsys.readouterr()
            assert said.out == ""
            assert said.err.startswith("run/cells/signal/ok/0.npz: the disk is full; make room")
            assert said.err.count("\n") == 1
    assert not [path for path in (folder / "run" / "cells").rglob("*") if path.is_file()]
    with monkeypatch.context() as broken:  # the control: another fault is the task's own
        filled(broken, errno.EIO, 1)
        assert main(COMPARE) == 3
    assert "failed: OSError" in capsys.readouterr().out
