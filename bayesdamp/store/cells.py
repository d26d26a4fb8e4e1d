"""The folder of a run: its cells, one atomic file each, and its lock; nothing else in it is replaced or removed."""

from __future__ import annotations

import fcntl
import json
import os
import stat
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import IO, Any

import numpy as np

from bayesdamp.store.files import (
    BROKEN,
    TEMPORARY,
    create,
    name_in_errors,
    no_room,
    packed,
    special_kind,
    unpacked,
    write_bytes,
)
from bayesdamp.store.tables import CALIBRATION_TABLES, SPECIMEN_TABLES, TABLES
from bayesdamp.types import OK, InputError

MARK = ".bayesdamp"
"""The file that marks a folder as a run's."""
SIGNED = "bayesdamp run\n"
PLACES = ("cells", "figures", "posterior")
"""Folders of a run."""
LOCK = ".lock"
FILES = (LOCK, "damping_curves.csv", "report.html", "run.json", "verdict.json", "verdicts.csv")
CELL = "cell.json"
"""The first member of each cell's archive."""
_ZIP = 30
"""Bytes before a member's name in an archive."""
_ELSEWHERE = "choose another folder with --out"
_FOREIGN = f"where a run's own files belong; {_ELSEWHERE}, or remove it"


def claim(folder: Path, tables: Iterable[str] = ()) -> None:
    """Mark a folder as a run's, or check that it is one: by its mark, or by its run.json.

    Parameters
    ----------
    folder
        The run's folder, which need not exist.
    tables
        Names of further files that a run writes.

    Raises
    ------
    InputError
        The folder holds something of such a name that no run wrote, or a link where a run's files belong.
    OSError
        It cannot be written.
    """
    present = set(os.listdir(folder)) if os.path.lexists(folder) else set()
    if MARK not in present:
        taken = sorted(present & {*PLACES, *FILES, *tables})
        # A clone of a repository has a run's description without the mark.
        try:
            path = folder / "run.json"
            description = json.loads(path.read_bytes()) if is_regular(path) else None
        except (ValueError, RecursionError):
            description = None
        has_run = isinstance(description, dict) and {"name", "seed", "study"} <= description.keys()
        if taken and not has_run:
            what = f"holds {taken[0]!r}, which no run of bayesdamp wrote"
            raise InputError(f"{folder}: {what}; {_ELSEWHERE}, or move it away")
        with suppress(FileExistsError):
            create(folder / MARK, SIGNED.encode())
    if not _is_marked(folder):
        raise InputError(f"{folder / MARK}: is not the mark of a run; {_ELSEWHERE}, or remove it")
    for entry in (folder / name for name in sorted({*FILES, *tables} - {LOCK})):
        kind = special_kind(entry)
        if kind is not None:
            raise InputError(f"{entry}: is {kind}, {_FOREIGN}")
    for place in PLACES:
        for entry in _entries(folder / place):
            if entry.is_symlink():
                raise InputError(f"{entry}: is a link, {_FOREIGN}")


def _is_marked(folder: Path) -> bool:
    path = folder / MARK
    if not is_regular(path):
        return False
    with path.open("rb") as handle:
        return handle.read(len(SIGNED)) == SIGNED.encode()


def is_regular(path: Path) -> bool:
    """Return whether there is a file, and it is neither a link nor a device."""
    try:
        return stat.S_ISREG(path.lstat().st_mode)
    except OSError:
        return False


def _entries(place: Path) -> Iterator[Path]:
    """Iterate over one of a run's folders and all that is below it, but nothing beyond a link."""
    if not place.is_symlink() and not place.is_dir():
        return
    yield place
    for below, folders, files in os.walk(place, followlinks=False):
        yield from (Path(below, name) for name in (*folders, *files))


def sweep(folder: Path) -> None:
    """Remove the temporary files that a killed run left, which have a name of their own."""
    top = (folder / name for name in os.listdir(folder))
    for path in (*top, *(entry for place in PLACES for entry in _entries(folder / place))):
        if TEMPORARY.fullmatch(path.name) and is_regular(path):
            path.unlink(missing_ok=True)


def remove_cells(folder: Path) -> None:
    """Remove the cells of a run; other files among them stay."""
    cells = folder / "cells"
    entries = list(_entries(cells))
    if not _is_marked(folder) or any(path.is_symlink() for path in entries):
        return
    for path in entries:
        if path.suffix != ".npz" or not is_regular(path):
            continue
        # A cell's own name comes first in its file, also in one that is cut off.
        name = path.relative_to(cells).as_posix().removesuffix(".npz")
        beginning = f'{CELL}{{"name": {json.dumps(name)},'.encode()
        with path.open("rb") as handle:
            is_cell = handle.read(_ZIP + len(beginning))[_ZIP:] == beginning
        if is_cell:
            path.unlink(missing_ok=True)


def remove_listed(folder: Path, listed: Iterable[str]) -> None:
    """Remove the regular files of these names that are directly in a folder, unless the folder is a link."""
    if folder.is_symlink():
        return
    for name in listed:
        path = folder / name
        if path.name == name and is_regular(path):
            path.unlink(missing_ok=True)


def open_lock(folder: Path) -> IO[str]:
    """Open the lock's file to read and to write. Raises InputError where it is a link, a device or shared; OSError."""
    path = folder / LOCK
    if not os.path.lexists(path):
        path.touch()
    if not is_regular(path) or path.lstat().st_nlink > 1:
        raise InputError(f"{path}: is a link or not a regular file; {_ELSEWHERE}, or remove it")
    return os.fdopen(os.open(path, os.O_RDWR | os.O_APPEND | os.O_NOFOLLOW | os.O_CLOEXEC), "a+")


@dataclass(frozen=True)
class Place:
    """The parts of a task's name such as `estimate/bench/0/viscous/least_squares`; empty or None where it has none.

    kind: of task. record: the signal's name, or the specimen's. repeat: of the record. candidate: the damping sum, with
    its law where several are compared, or the law of a fit that all dampings share. method: the estimator, the sampler,
    the evidence method, or what is changed.
    """

    kind: str
    record: str = ""
    repeat: int | None = None
    candidate: str = ""
    method: str = ""

    @classmethod
    def of(cls, name: str) -> Place:
        """Read a task's name."""
        kind, *rest = name.split("/")
        record = rest.pop(0) if rest else ""
        repeat = int(rest.pop(0)) if rest and rest[0].isdigit() else None  # a specimen has none
        candidate, method = (*rest, "", "")[:2]
        return cls(kind, record, repeat, candidate, method)


@dataclass(frozen=True)
class CellResult:
    """The stored result of one cell.

    name: the cell's path-like name, such as `estimate/bench/0/viscous/least_squares`.
    key: hash of everything the result depends on; a result is reused only under the same key.
    meta: values that JSON can hold (nan and infinities included); tuples come back as lists.
    arrays: named numeric arrays.
    """

    name: str
    key: str
    meta: Mapping[str, Any] = field(default_factory=dict)
    arrays: Mapping[str, np.ndarray] = field(default_factory=dict)
    outcome: str = OK
    seconds: float = 0.0

    @property
    def place(self) -> Place:
        """The parts of its name."""
        return Place.of(self.name)


class Store:
    """The cells of one run, each an `.npz` file under `cells/`. Nothing is created before the first write.

    only: name to key of the visible cells, where a folder may also hold those of another study; None for all.
    """

    def __init__(self, folder: Path, only: Mapping[str, str] | None = None) -> None:
        self.folder = Path(folder)
        self.only = only
        self._cells = self.folder / "cells"
        self._keys: dict[tuple[object, ...], tuple[tuple[object, ...], str]] = {}

    def key(self, cell_name: str, of: tuple[object, ...], compute: Callable[[], str]) -> str:
        """Return a cell's key, computed once for the objects that it depends on: many cells share their record's."""
        identity = (cell_name, *map(id, of))
        if identity not in self._keys:
            self._keys[identity] = of, compute()  # an object that is stored here keeps its identity
        return self._keys[identity][1]

    def has(self, cell_name: str, key: str) -> bool:
        """Return whether there is a whole result under this key; a damaged file counts as absent."""
        cell = self.find(cell_name)
        return cell is not None and cell.key == key

    def read(self, cell_name: str, *, arrays: bool = True) -> CellResult:
        """Return the result of one cell, or all but its arrays. Raises KeyError where none can be read."""
        if self.only is not None and cell_name not in self.only:
            raise KeyError(cell_name)
        try:
            path = self._path(cell_name)
            if not is_regular(path):  # reading a device or a pipe would wait
                raise FileNotFoundError(path)
            head, stored = unpacked(path, CELL, arrays=arrays)
            cell = CellResult(cell_name, head["key"], head["meta"], stored, head["outcome"], head["seconds"])
        except BROKEN as fault:
            raise KeyError(cell_name) from fault
        if self.only is not None and self.only[cell_name] != cell.key:
            raise KeyError(cell_name)
        return cell

    def find(self, cell_name: str, *, arrays: bool = True) -> CellResult | None:
        """Return what `read` returns, None where none can be read."""
        try:
            return self.read(cell_name, arrays=arrays)
        except KeyError:
            return None

    def write(self, result: CellResult) -> None:
        """Store a result in one step: another process sees the old file or the new one, never a part."""
        head = {"name": result.name, "key": result.key, "outcome": result.outcome}
        head |= {"seconds": float(result.seconds), "meta": result.meta}
        write_bytes(self._path(result.name), packed(CELL, head, result.arrays))

    def names(self) -> list[str]:
        """Return the names of all stored cells, sorted; some may be damaged."""
        paths = (p.relative_to(self._cells).as_posix() for p in self._cells.rglob("*.npz"))
        names = (path.removesuffix(".npz") for path in paths)
        return sorted(name for name in names if self.only is None or name in self.only)

    def clear(self) -> None:
        """Remove all cells of a folder that is marked as a run's; other files stay."""
        remove_cells(self.folder)

    @contextmanager
    def lock(self) -> Iterator[None]:
        """Hold the folder for writing, and remove the temporary files of a killed run.

        Raises InputError while another process holds it, and where the folder holds files that no run wrote. The system
        drops the lock of a process that dies.
        """
        try:
            claim(self.folder, (*TABLES, *SPECIMEN_TABLES, *CALIBRATION_TABLES))
            handle = open_lock(self.folder)
        except OSError as fault:
            if no_room(fault):
                raise
            raise InputError(f"{self.folder}: cannot write a run here ({fault.strerror})") from fault
        with handle:
            try:
                fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except OSError as fault:
                handle.seek(0)
                holder = handle.read().strip() or "unknown"
                raise InputError(
                    f"{self.folder}: another run (process {holder}) is writing here; "
                    "wait until it is done or choose another folder with --out"
                ) from fault
            with name_in_errors(self.folder):
                handle.truncate(0)
                os.write(
                    handle.fileno(), str(os.getpid()).encode()
                )  # unbuffered: a full disk is reported once
            sweep(self.folder)
            yield

    def _path(self, cell_name: str) -> Path:
        parts = cell_name.split("/")
        if any(not p or p[0] == "." or "\\" in p or "\0" in p for p in parts):
            raise ValueError(f"not a cell's name: {cell_name!r}")
        return self._cells.joinpath(*parts[:-1], parts[-1] + ".npz")
