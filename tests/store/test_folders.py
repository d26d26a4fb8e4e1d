"""Nothing is replaced or removed that a run did not write, and nothing through a link."""

from __future__ import annotations

import errno
import io
import json
import os
import shutil
import threading
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from bayesdamp.cli import main
from bayesdamp.store import CellResult, Store, write_bytes
from bayesdamp.store.files import create, temporary_path
from bayesdamp.store.folders import MARK, SIGNED
from bayesdamp.types import InputError

CELL = CellResult("signal/a/0", "k")


def tree(folder: Path) -> dict[str, bytes | str]:
    """All that is in a folder: files with their content, links with where they lead."""
    found: dict[str, bytes | str] = {}
    for path in sorted(folder.rglob("*")):
        if path.is_symlink():
            found[str(path.relative_to(folder))] = os.readlink(path)
        elif path.is_file():
            found[str(path.relative_to(folder))] = path.read_bytes()
    return found


def cells_of_another(folder: Path) -> None:
    (folder / "cells").mkdir()
    (folder / "cells" / "photo.npz").write_bytes(b"mine")


def report_of_another(folder: Path) -> None:
    (folder / "report.html").write_text("mine")


def about_another(folder: Path) -> None:
    (folder / "run.json").write_text('{"name": "mine"}')


def lock_of_another(folder: Path) -> None:
    (folder / ".lock").write_text("mine")


def mark_of_another(folder: Path) -> None:
    (folder / MARK).write_text("mine")


def half_a_mark(folder: Path) -> None:
    (folder / MARK).write_text(SIGNED[:9])


def a_linked_lock(folder: Path) -> None:
    with Store(folder).lock():
        pass
    (folder / ".lock").unlink()
    (folder / "diary").write_text("mine")
    (folder / ".lock").symlink_to(folder / "diary")


def a_shared_lock(folder: Path) -> None:
    a_linked_lock(folder)
    (folder / ".lock").unlink()
    os.link(folder / "diary", folder / ".lock")


def linked_cells(folder: Path) -> None:
    with Store(folder).lock():
        pass
    (folder / "other").mkdir()
    (folder / "other" / "a.npz").write_bytes(b"mine")
    (folder / "cells").symlink_to(folder / "other")


def a_link_among_cells(folder: Path) -> None:
    linked_cells(folder)
    (folder / "cells").unlink()
    (folder / "cells" / "signal").mkdir(parents=True)
    (folder / "cells" / "signal" / "a").symlink_to(folder / "other")


def linked_figures(folder: Path) -> None:
    linked_cells(folder)
    (folder / "cells").rename(folder / "figures")


def a_linked_report(folder: Path) -> None:
    linked_cells(folder)
    (folder / "cells").unlink()
    (folder / "report.html").symlink_to(folder / "other" / "a.npz")


def a_folder_for_a_table(folder: Path) -> None:
    linked_cells(folder)
    (folder / "cells").unlink()
    (folder / "evidence.csv").mkdir()


OTHERS = (
    cells_of_another, report_of_another, about_another, lock_of_another, mark_of_another, half_a_mark, a_linked_lock,
    a_shared_lock, linked_cells, a_linked_report, a_folder_for_a_table, a_link_among_cells, linked_figures,
)  # fmt: skip


@pytest.mark.parametrize("make", OTHERS, ids=lambda make: make.__name__)
def test_a_folder_that_holds_what_no_run_wrote_is_refused_and_left_alone(
    make: Callable[[Path], None], tmp_path: Path
) -> None:
    make(tmp_path)
    before = tree(tmp_path)
    store = Store(tmp_path)
    with pytest.raises(InputError, match=r"--out") as caught, store.lock():
        store.clear()
    assert "\n" not in str(caught.value)
    assert tree(tmp_path) == before


@pytest.fixture(scope="module")
def a_run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("runs")
    records = [str(folder / f"{name}.csv") for name in "ab"]
    for record in records:
        assert main(["simulate", "--out", record]) == 0
    asked = ["compare", *records, "--repeats", "--restoring", "linear", "--damping", "viscous", "--damping"]
    assert main([*asked, "coulomb", "--quick", "--out", str(folder / "run")]) == 0
    return folder / "run"


def test_a_file_of_any_name_that_a_run_writes_is_not_replaced(a_run: Path, tmp_path: Path) -> None:
    names = [path.name for path in a_run.iterdir() if path.is_file() and path.name != MARK]
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
        for name in (CELL.name, "signal/b/0", "answered/a/0"):
            store.write(CellResult(name, "k", arrays={"x": np.zeros(9)}))
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
        assert (tmp_path / MARK).is_file()


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


def test_a_simulation_does_not_replace_a_device(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    os.mkfifo(tmp_path / "full")
    command = ["simulate", "--damping", "viscous=0.05", "--restoring", "linear"]
    command += ["--set", "stiffness=20,rest_angle=0", "--out", str(tmp_path / "full")]
    assert main(command) == 2
    said = capsys.readouterr()
    assert said.out == ""
    assert said.err.startswith("--out ")
    assert said.err.endswith("give a regular file or a new file's name\n")
    assert (tmp_path / "full").is_fifo()


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
        create(tmp_path / MARK, b"mine")
    assert not list(tmp_path.iterdir())
    monkeypatch.undo()
    create(tmp_path / MARK, b"mine")
    with pytest.raises(FileExistsError):
        create(tmp_path / MARK, b"other")
    assert {p.name: p.read_text() for p in tmp_path.iterdir()} == {MARK: "mine"}


def test_a_mark_where_files_have_one_name_only(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def no_links(*_: object) -> None:
        raise OSError(errno.EPERM, "Operation not permitted")

    monkeypatch.setattr(os, "link", no_links)
    create(tmp_path / MARK, b"mine")
    with pytest.raises(FileExistsError):
        create(tmp_path / MARK, b"other")
    assert {p.name: p.read_text() for p in tmp_path.iterdir()} == {MARK: "mine"}


def test_a_pipe_in_place_of_a_cell_is_not_waited_for(tmp_path: Path) -> None:
    store = Store(tmp_path)
    store.write(CELL)
    assert store.has(CELL.name, CELL.key)
    place = tmp_path / "cells" / "signal" / "a" / "0.npz"
    place.unlink()
    os.mkfifo(place)
    found: list[object] = []

    def read() -> None:
        found.append(store.has(CELL.name, CELL.key))
        with pytest.raises(KeyError):
            store.head(CELL.name)
        found.append("ended")

    reading = threading.Thread(target=read, daemon=True)
    reading.start()
    reading.join(20)
    assert found == [False, "ended"]
    with pytest.raises(InputError, match="is a device and is not replaced"):
        store.write(CELL)
