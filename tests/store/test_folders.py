"""Nothing is replaced or removed that a run did not write, and nothing through a link."""

from __future__ import annotations

import errno
import io
import json
import os
import shutil
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from bayesdamp.cli import main
from bayesdamp.store import Store, TaskResult, write_bytes
from bayesdamp.store.files import create, temporary_path
from bayesdamp.store.results import MARK_FILE, MARK_TEXT
from bayesdamp.types import InputError

CELL = TaskResult("signal/a/0", "k")


def tree(folder: Path) -> dict[str, bytes | str]:
    """All that is in a folder: files with their content, links with where they lead."""
    found: dict[str, bytes | str] = {}
    for path in sorted(folder.rglob("*")):
        if path.is_symlink():
            found[str(path.relative_to(folder))] = os.readlink(path)
        elif path.is_file():
            found[str(path.relative_to(folder))] = path.read_bytes()
    return found


def of_another(name: str, content: str = "mine") -> Callable[[Path], None]:
    """Return what writes somebody else's file."""

    def write(folder: Path) -> None:
        (folder / name).parent.mkdir(exist_ok=True)
        (folder / name).write_text(content)

    return write


def linked(name: str) -> Callable[[Path], None]:
    """Return what replaces a part of a run by a link to somebody else's folder."""

    def write(folder: Path) -> None:
        with Store(folder).lock():
            pass
        (folder / name).unlink(missing_ok=True)
        of_another("other/a.npz")(folder)
        (folder / name).symlink_to(folder / "other" / ("a.npz" if name == ".lock" else ""))

    return write


def hard_linked_lock(folder: Path) -> None:
    """Make the lock of a run a hard link to somebody else's file."""
    linked(".lock")(folder)
    (folder / ".lock").unlink()
    os.link(folder / "other" / "a.npz", folder / ".lock")


OTHERS: dict[str, Callable[[Path], None]] = {
    "cells": of_another("cells/photo.npz"), "report": of_another("report.html"), "lock": of_another(".lock"),
    "description": of_another("run.json", '{"name": "mine"}'), "mark": of_another(MARK_FILE),
    "half a mark": of_another(MARK_FILE, MARK_TEXT[:9]),
    "linked lock": linked(".lock"), "linked cells": linked("cells"), "hard-linked lock": hard_linked_lock,
}  # fmt: skip


@pytest.mark.parametrize("make", OTHERS.values(), ids=OTHERS)
def test_a_folder_that_holds_what_no_run_wrote_is_refused_and_left_alone(tmp_path: Path, make) -> None:
    make(tmp_path)
    before, store = tree(tmp_path), Store(tmp_path)
    with pytest.raises(InputError, match=r"^[^\n]*--out[^\n]*$"), store.lock():
        store.clear()
    assert tree(tmp_path) == before


@pytest.fixture(scope="module")
def a_run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("runs")
    records = [str(folder / f"{name}.csv") for name in "ab"]
    for record in records:
        assert main(["simulate", "--samples", "300", "--duration", "8", "--out", record]) == 0
    words = "--repeats --restoring linear --damping viscous --quick --deviation none --workers 1 --out"
    assert main(["compare", *records, *words.split(), str(folder / "run")]) == 0
    return folder / "run"


def test_a_file_of_any_name_that_a_run_writes_is_not_replaced(a_run: Path, tmp_path: Path) -> None:
    names = [path.name for path in a_run.iterdir() if path.is_file() and path.name != MARK_FILE]
    assert {"verdict.json", "verdicts.csv", "damping_curves.csv", "fits.csv", "run.json"} < set(names)
    for name in names:
        folder = tmp_path / name.replace(".", "_")
        folder.mkdir()
        (folder / name).write_text("mine")
        with pytest.raises(InputError, match="no run of bayesdamp wrote"), Store(folder).lock():
            pass
        assert tree(folder) == {name: b"mine"}
    with Store(a_run).lock():  # the control: its own folder
        pass


def test_other_files_beside_a_run_stay(tmp_path: Path) -> None:
    """In a folder of the user's, with what a killed run left: only that is removed, and only cells with --fresh."""
    store = Store(tmp_path)
    (tmp_path / "rig.csv").write_text("mine")
    (tmp_path / "sub").mkdir()
    mine = [tmp_path / "rig.csv", tmp_path / ".notes.tmp", temporary_path(tmp_path / "sub" / "x")]
    with store.lock():
        store.write(CELL)
    mine += [tmp_path / "cells" / "notes.txt", tmp_path / "cells" / "signal" / ".0123.tmp"]
    for path in mine:
        path.write_text("mine")
    half = temporary_path(tmp_path / "cells" / "signal" / "b.npz")
    half.write_text("half")
    with store.lock():
        assert not half.exists()
        assert store.names() == [CELL.name]
        store.clear()
        assert store.names() == []
    assert [path for path in mine if not path.exists()] == []


def test_only_cells_are_removed(tmp_path: Path) -> None:
    """An archive and a copy of a cell that somebody puts among a run's cells are not the run's."""
    store, cells = Store(tmp_path), tmp_path / "cells"
    with store.lock():
        names = ["answered/a/0", CELL.name, "signal/a/0/deeper", "signal/noise_sd=0.003/0"]
        for name in reversed(names):
            store.write(TaskResult(name, "k", arrays={"x": np.zeros(9)}))
        assert store.names() == names
        (cells / "sub").mkdir()
        np.savez(cells / "sub" / "mine.npz", a=1)
        np.savez(cells / "mine.npz", a=1)
        shutil.copy(cells / "signal" / "a" / "0.npz", cells / "copy.npz")
        half = cells / "signal" / "a" / "0.npz"
        half.write_bytes(half.read_bytes()[:200])
        store.clear()
    left = {path.relative_to(cells).as_posix() for path in cells.rglob("*") if path.is_file()}
    assert left == {"sub/mine.npz", "mine.npz", "copy.npz"}


def test_a_run_without_its_mark_is_known_by_its_description(tmp_path: Path) -> None:
    (tmp_path / "run.json").write_text(json.dumps({"name": "a", "seed": 1, "study": {}}))
    (tmp_path / "report.html").write_text("")
    with Store(tmp_path).lock():
        assert (tmp_path / MARK_FILE).is_file()


def test_the_folder_itself_may_be_a_link(tmp_path: Path) -> None:
    (tmp_path / "disk").mkdir()
    (tmp_path / "out").symlink_to(tmp_path / "disk")
    with Store(tmp_path / "out").lock():
        Store(tmp_path / "out").write(CELL)
    assert (tmp_path / "disk" / "cells").is_dir()


def test_only_a_regular_file_is_replaced(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("mine")
    (tmp_path / "link").symlink_to(tmp_path / "file")
    (tmp_path / "dangling").symlink_to(tmp_path / "nowhere")
    (tmp_path / "folder").mkdir()
    os.mkfifo(tmp_path / "pipe")
    for name, what in (
        ("link", "a link"),
        ("dangling", "a link"),
        ("folder", "a folder"),
        ("pipe", "a device"),
    ):
        with pytest.raises(InputError, match=f"{name}: is {what} and is not replaced"):
            write_bytes(tmp_path / name, b"new")
    write_bytes(tmp_path / "file", b"new")
    assert (tmp_path / "file").read_bytes() == b"new"
    assert (tmp_path / "pipe").is_fifo()


def test_a_mark_is_whole_or_not_there(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A disk that is full when a folder is claimed leaves nothing that a later run would not know. Control: with room
    the mark is there, and what is there stays."""

    class Full(io.StringIO):
        def write(self, text: str) -> int:
            raise OSError(errno.ENOSPC, "No space left on device")

    usual = Path.open
    monkeypatch.setattr(
        Path, "open", lambda path, *a, **k: Full() if path.suffix == ".tmp" else usual(path, *a, **k)
    )
    with pytest.raises(OSError, match="No space"):
        create(tmp_path / MARK_FILE, b"mine")
    assert not list(tmp_path.iterdir())
    monkeypatch.undo()
    create(tmp_path / MARK_FILE, b"mine")
    with pytest.raises(FileExistsError):
        create(tmp_path / MARK_FILE, b"other")
    assert {p.name: p.read_text() for p in tmp_path.iterdir()} == {MARK_FILE: "mine"}
