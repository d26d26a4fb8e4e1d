"""A full disk: one line that names the file, and no incomplete files."""

import errno
import os
from collections.abc import Callable
from pathlib import Path

import pytest

from bayesdamp.cli import main

COMPARE = ("compare", "ok.csv", "--quick", "--quiet", "--workers", "1", "--out", "run")
SMALL = 1000
"""Bytes of a file for which there is still room, such as the result of a failed task."""


def fill_disk(monkeypatch: pytest.MonkeyPatch, code: int = errno.ENOSPC, times: int = 99) -> None:
    """Let writing of files that are not small fail with an error code, for a number of times."""
    synced: Callable[[int], None] = os.fsync
    left = [times]

    def fsync(handle: int) -> None:
        if left[0] and os.fstat(handle).st_size > SMALL:
            left[0] -= 1
            raise OSError(code, os.strerror(code))
        synced(handle)

    monkeypatch.setattr(os, "fsync", fsync)


FULL = "the disk is full; make room there, then run the same command again"


def test_no_incomplete_file_is_left(
    folder: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Control: the same command with room on the disk."""
    for words, name in (
        (("init", "ok.csv"), "ok.toml"),
        (("simulate", "--duration", "8", "--out", "new/deeper/a.csv"), "new/deeper/a.csv"),
    ):
        before = {path for path in folder.rglob("*") if path.is_file()}
        with monkeypatch.context() as full:
            fill_disk(full)
            assert main(words) == 2
        assert capsys.readouterr().err == f"{name}: {FULL}\n"
        assert {path for path in folder.rglob("*") if path.is_file()} == before
        assert main(words) == 0
        assert (folder / name).is_file()
        capsys.readouterr()


def test_a_result_that_cannot_be_written_is_not_a_failed_task(
    folder: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Control: an input/output error is a failure of the task."""
    with monkeypatch.context() as full:
        fill_disk(full)
        for _ in range(2):
            assert main(COMPARE) == 2
            assert capsys.readouterr() == ("", f"run/cells/signal/ok/0.npz: {FULL}\n")
    assert not [path for path in (folder / "run" / "cells").rglob("*") if path.is_file()]
    with monkeypatch.context() as broken:
        fill_disk(broken, errno.EIO, 1)
        assert main(COMPARE) == 3
    assert "failed: OSError" in capsys.readouterr().err
