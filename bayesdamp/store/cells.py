"""The cells of a run's folder: one atomic file each, and a lock."""

from __future__ import annotations

import fcntl
import json
import os
import zipfile
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from bayesdamp.store import folders
from bayesdamp.store.files import BROKEN, name_in_errors, no_room, packed, unpacked, write_bytes
from bayesdamp.store.tables import CALIBRATION_TABLES, SPECIMEN_TABLES, TABLES
from bayesdamp.types import OK, InputError


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

    def read(self, cell_name: str) -> CellResult:
        """Return the result of one cell. Raises KeyError where there is none that can be read."""
        if self.only is not None and cell_name not in self.only:
            raise KeyError(cell_name)
        try:
            head, arrays = unpacked(self._file(cell_name), folders.CELL)
            cell = CellResult(cell_name, head["key"], head["meta"], arrays, head["outcome"], head["seconds"])
        except BROKEN as fault:
            raise KeyError(cell_name) from fault
        if self.only is not None and self.only[cell_name] != cell.key:
            raise KeyError(cell_name)
        return cell

    def find(self, cell_name: str) -> CellResult | None:
        """Return the result of one cell, None where there is none that can be read."""
        try:
            return self.read(cell_name)
        except KeyError:
            return None

    def head(self, cell_name: str) -> tuple[str, str]:
        """Return key and outcome of a cell, without reading its arrays. Raises KeyError."""
        try:
            with zipfile.ZipFile(self._file(cell_name)) as archive:
                head = json.loads(archive.read(folders.CELL))
            return head["key"], head["outcome"]
        except BROKEN as fault:
            raise KeyError(cell_name) from fault

    def write(self, result: CellResult) -> None:
        """Store a result in one step: another process sees the old file or the new one, never a part."""
        head = {"name": result.name, "key": result.key, "outcome": result.outcome}
        head |= {"seconds": float(result.seconds), "meta": result.meta}
        write_bytes(self._path(result.name), packed(folders.CELL, head, result.arrays))

    def names(self) -> list[str]:
        """Return the names of all stored cells, sorted; some may be damaged."""
        paths = (p.relative_to(self._cells).as_posix() for p in self._cells.rglob("*.npz"))
        names = (path.removesuffix(".npz") for path in paths)
        return sorted(name for name in names if self.only is None or name in self.only)

    def clear(self) -> None:
        """Remove all cells of a folder that is marked as a run's; other files stay."""
        folders.remove_cells(self.folder)

    @contextmanager
    def lock(self) -> Iterator[None]:
        """Hold the folder for writing, and remove the temporary files of a killed run.

        Raises InputError while another process holds it, and where the folder holds files that no run wrote. The system
        drops the lock of a process that dies.
        """
        try:
            folders.claim(self.folder, (*TABLES, *SPECIMEN_TABLES, *CALIBRATION_TABLES))
            handle = folders.open_lock(self.folder)
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
            folders.sweep(self.folder)
            yield

    def _file(self, cell_name: str) -> Path:
        """Return the cell's file, to read. Raises OSError for a device or a pipe, on which reading would wait."""
        path = self._path(cell_name)
        if not folders.is_regular(path):
            raise FileNotFoundError(path)
        return path

    def _path(self, cell_name: str) -> Path:
        parts = cell_name.split("/")
        if any(not p or p[0] == "." or "\\" in p or "\0" in p for p in parts):
            raise ValueError(f"not a cell's name: {cell_name!r}")
        return self._cells.joinpath(*parts[:-1], parts[-1] + ".npz")
