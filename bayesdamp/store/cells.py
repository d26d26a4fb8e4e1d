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
from bayesdamp.store.beside import naming, no_room
from bayesdamp.store.files import BROKEN, packed, unpacked, write_bytes
from bayesdamp.store.tables import CALIBRATION_TABLES, SPECIMEN_TABLES, TABLES
from bayesdamp.types import OK, InputError


@dataclass(frozen=True)
class Place:
    """The parts of a name such as `estimate/bench/0/viscous/least_squares`; what it has not is empty, or None.

    kind: of task. record: whose it is, or the specimen's. repeat: of the record. candidate: the damping sum, with its
    law where several are compared, or the law of a fit that all dampings share. method: the estimator, the sampler, the
    way to evidence, or what is changed.
    """

    kind: str
    record: str = ""
    repeat: int | None = None
    candidate: str = ""
    method: str = ""

    @classmethod
    def of(cls, name: str) -> Place:
        """Of a task's name."""
        kind, *rest = name.split("/")
        record = rest.pop(0) if rest else ""
        repeat = int(rest.pop(0)) if rest and rest[0].isdigit() else None  # a specimen's have none
        candidate, method = (*rest, "", "")[:2]
        return cls(kind, record, repeat, candidate, method)


_HEAD = folders.CELL


@dataclass(frozen=True)
class CellResult:
    """What one cell left behind.

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
        """What the cell is about."""
        return Place.of(self.name)


class Store:
    """The cells of one run, each an `.npz` file under `cells/`. Nothing is created before the first write.

    only: name to key of the cells that are seen, where a folder may hold those of another question too; None for all.
    """

    def __init__(self, folder: Path, only: Mapping[str, str] | None = None) -> None:
        self.folder = Path(folder)
        self.only = only
        self._cells = self.folder / "cells"
        self._keys: dict[tuple[object, ...], tuple[tuple[object, ...], str]] = {}

    def key(self, cell_name: str, of: tuple[object, ...], made: Callable[[], str]) -> str:
        """A cell's key, made once for the objects that it is made of: a hundred cells share their record's."""
        known = (cell_name, *map(id, of))
        if known not in self._keys:
            self._keys[known] = of, made()  # what is held here keeps its identity
        return self._keys[known][1]

    def has(self, cell_name: str, key: str) -> bool:
        """Whether a whole result is there under this key; a truncated or damaged file counts as absent."""
        try:
            return self.read(cell_name).key == key
        except KeyError:
            return False

    def read(self, cell_name: str) -> CellResult:
        """The result of one cell. Raises KeyError where there is none that can be read."""
        if self.only is not None and cell_name not in self.only:
            raise KeyError(cell_name)
        try:
            head, arrays = unpacked(self._file(cell_name), _HEAD)
            own = head["key"], head["meta"], arrays, head["outcome"], head["seconds"]
        except BROKEN as fault:
            raise KeyError(cell_name) from fault
        found = CellResult(cell_name, *own)
        if self.only is not None and self.only[cell_name] != found.key:
            raise KeyError(cell_name)
        return found

    def find(self, cell_name: str) -> CellResult | None:
        """The result of one cell, None where there is none that can be read."""
        try:
            return self.read(cell_name)
        except KeyError:
            return None

    def head(self, cell_name: str) -> tuple[str, str]:
        """Key and outcome of a cell; its arrays are not looked at. Raises KeyError."""
        try:
            with zipfile.ZipFile(self._file(cell_name)) as archive:
                found = json.loads(archive.read(_HEAD))
            return found["key"], found["outcome"]
        except BROKEN as fault:
            raise KeyError(cell_name) from fault

    def write(self, result: CellResult) -> None:
        """Store a result in one step: another process sees the old file or the new one, never a part."""
        head = {"name": result.name, "key": result.key, "outcome": result.outcome}
        head |= {"seconds": float(result.seconds), "meta": result.meta}
        write_bytes(self._path(result.name), packed(_HEAD, head, result.arrays))

    def names(self) -> list[str]:
        """Names of all stored cells, sorted; whether each can be read, `read` tells."""
        found = (p.relative_to(self._cells).as_posix() for p in self._cells.rglob("*.npz"))
        names = (name.removesuffix(".npz") for name in found)
        return sorted(name for name in names if self.only is None or name in self.only)

    def clear(self) -> None:
        """Forget all cells of a folder that is marked as a run's; other files stay."""
        folders.remove_cells(self.folder)

    @contextmanager
    def lock(self) -> Iterator[None]:
        """Hold the folder for writing, and sweep what a killed run left half-written.

        Raises InputError while another process holds it, and where the folder holds what no run wrote. The system drops
        the lock of a process that dies.
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
            with naming(self.folder):
                handle.truncate(0)
                os.write(handle.fileno(), str(os.getpid()).encode())  # unbuffered: a full disk is told once
            folders.sweep(self.folder)
            yield

    def _file(self, cell_name: str) -> Path:
        """The cell's file, to read. Raises OSError where it is a device or a pipe, on which reading would wait."""
        path = self._path(cell_name)
        if not folders.regular(path):
            raise FileNotFoundError(path)
        return path

    def _path(self, cell_name: str) -> Path:
        parts = cell_name.split("/")
        if any(not p or p[0] == "." or "\\" in p or "\0" in p for p in parts):
            raise ValueError(f"not a cell's name: {cell_name!r}")
        return self._cells.joinpath(*parts[:-1], parts[-1] + ".npz")
