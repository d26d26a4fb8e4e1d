"""A run replaces and removes only what a run wrote, and nothing through a link."""

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
from bayesdamp.store.files import temporary_path, write_bytes
from bayesdamp.store.results import MARK_FILE, MARK_TEXT, Store, TaskResult
from bayesdamp.types import InputError

CELL = TaskResult("signal/a/0", "k")


def tree(folder: Path) -> dict[str, bytes | str]:
    """Return everything in a folder: the content of files and the targets of links, by path."""
    return {
        str(path.relative_to(folder)): os.readlink(path) if path.is_symlink() else path.read_bytes()
        for path in folder.rglob("*")
        if path.is_symlink() or path.is_file()
    }


def user_file(name: str, content: str = "mine") -> Callable[[Path], None]:
    """Return a function that writes a file of the user."""

    def write(folder: Path) -> None:
        (folder / name).parent.mkdir(exist_ok=True)
        (folder / name).write_text(content)

    return write


def linked(name: str) -> Callable[[Path], None]:
    """Return a function that replaces a part of a run by a link to something of the user."""

    def write(folder: Path) -> None:
        with Store(folder).lock():
            pass
        (folder / name).unlink(missing_ok=True)
        user_file("other/a.npz")(folder)
        (folder / name).symlink_to(folder / "other" / ("a.npz" if name == ".lock" else ""))

    return write


OTHERS: dict[str, Callable[[Path], None]] = {
    "cells": user_file("cells/photo.npz"), "report": user_file("report.html"), "lock": user_file(".lock"),
    "description": user_file("run.json", '{"name": "mine"}'), "mark": user_file(MARK_FILE),
    "half a mark": user_file(MARK_FILE, MARK_TEXT[:9]),
    "linked lock": linked(".lock"), "linked cells": linked("cells"),
}  # fmt: skip


@pytest.mark.parametrize("make", OTHERS.values(), ids=OTHERS)
def test_a_folder_with_a_file_that_no_run_wrote_is_refused_and_left_alone(tmp_path: Path, make) -> None:
    make(tmp_path)
    before, store = tree(tmp_path), Store(tmp_path)
    with pytest.raises(InputError, match=r"^[^\n]*--out[^\n]*$"), store.lock():
        store.clear()
    assert tree(tmp_path) == before


def test_a_file_of_the_user_with_the_name_of_a_run_s_file_is_not_replaced(tmp_path: Path) -> None:
    """Control: the run's own folder may be locked again."""
    run, records = tmp_path / "run", [str(tmp_path / f"{name}.csv") for name in "ab"]
    for record in records:
        assert main(["simulate", "--samples", "300", "--duration", "8", "--out", record]) == 0
    words = "--repeats --restoring linear --damping viscous --quick --deviation none --workers 1 --out"
    assert main(["compare", *records, *words.split(), str(run)]) == 0
    names = [path.name for path in run.iterdir() if path.is_file() and path.name != MARK_FILE]
    assert {"verdict.json", "verdicts.csv", "damping_curves.csv", "fits.csv", "run.json"} < set(names)
    for name in names:
        folder = tmp_path / name.replace(".", "_")
        folder.mkdir()
        (folder / name).write_text("mine")
        with pytest.raises(InputError, match="no run of bayesdamp wrote"), Store(folder).lock():
            pass
        assert tree(folder) == {name: b"mine"}
    with Store(run).lock():
        pass


def test_files_of_the_user_stay_in_the_folder_of_a_run(tmp_path: Path) -> None:
    """Only what a killed run left is removed, and results with --fresh: not an archive or a copy among them."""
    store, cells = Store(tmp_path), tmp_path / "cells"
    names = ["answered/a/0", CELL.name, "signal/a/0/deeper", "signal/noise_sd=0.003/0"]
    with store.lock():
        for name in reversed(names):
            store.write(TaskResult(name, "k", arrays={"x": np.zeros(9)}))
        assert store.names() == names
    own = [tmp_path / "rig.csv", tmp_path / ".notes.tmp", temporary_path(tmp_path / "sub" / "x")]
    own += [cells / "notes.txt", cells / "signal" / ".0123.tmp"]
    for path in own:
        path.parent.mkdir(exist_ok=True)
        path.write_text("mine")
    for path in (cells / "mine.npz", cells / "sub" / "mine.npz"):
        path.parent.mkdir(exist_ok=True)
        np.savez(path, a=1)
    result = cells / "signal" / "a" / "0.npz"
    shutil.copy(result, cells / "copy.npz")
    left_by_kill = temporary_path(cells / "signal" / "b.npz")
    left_by_kill.write_text("half")
    before = tree(tmp_path)
    with store.lock():
        assert not left_by_kill.exists()
        result.write_bytes(result.read_bytes()[:200])
        store.clear()
    of_run = {f"cells/{name}.npz" for name in names} | {str(left_by_kill.relative_to(tmp_path))}
    assert tree(tmp_path) == {path: content for path, content in before.items() if path not in of_run}


def test_a_run_without_its_mark_is_recognised_by_its_description(tmp_path: Path) -> None:
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
    kinds = {"link": "a link", "dangling": "a link", "folder": "a folder", "pipe": "a device"}
    for name, what in kinds.items():
        with pytest.raises(InputError, match=f"{name}: is {what} and is not replaced"):
            write_bytes(tmp_path / name, b"new")
    write_bytes(tmp_path / "file", b"new")
    assert (tmp_path / "file").read_bytes() == b"new"
    assert (tmp_path / "pipe").is_fifo()


def test_a_mark_is_complete_or_absent(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A full disk leaves nothing that a later run would refuse. Control: with space the mark is written."""

    class Full(io.StringIO):
        def write(self, text: str) -> int:
            raise OSError(errno.ENOSPC, "No space left on device")

    usual = Path.open
    with monkeypatch.context() as full:
        full.setattr(
            Path, "open", lambda path, *a, **k: Full() if path.suffix == ".tmp" else usual(path, *a, **k)
        )
        with pytest.raises(OSError, match="No space"):
            write_bytes(tmp_path / MARK_FILE, b"mine")
    assert not list(tmp_path.iterdir())
    write_bytes(tmp_path / MARK_FILE, b"mine")
    assert {p.name: p.read_text() for p in tmp_path.iterdir()} == {MARK_FILE: "mine"}
