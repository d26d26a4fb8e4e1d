"""What all results can do: print as a short table, be saved and loaded."""

from __future__ import annotations

import zipfile
from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Self, TypeVar

import numpy as np

from bayesdamp import __version__
from bayesdamp.calls import Told
from bayesdamp.serial import join, split
from bayesdamp.store.files import BROKEN, packed, save_bytes, unpacked
from bayesdamp.table import Table
from bayesdamp.types import InputError

R = TypeVar("R")
META = "result.json"


class Shown(Told, ABC):
    """A value that prints as a short table, in a notebook too; its methods refuse misspelt keywords in one line."""

    @abstractmethod
    def _table(self) -> Table: ...

    def __repr__(self) -> str:
        return self._table().text()

    def _repr_html_(self) -> str:
        return self._table().__html__()


class Result(Shown):
    """A frozen value that prints as a short table and can be saved and loaded."""

    def save(self, path: str | Path) -> Path:
        """Write it to a file, all of it or nothing; the path. Raises InputError where it cannot be written."""
        arrays = dict[str, np.ndarray]()
        head = {"kind": type(self).__name__, "version": __version__, "value": split(self, arrays)}
        return save_bytes(path, packed(META, head, arrays, zipfile.ZIP_DEFLATED))

    @classmethod
    def load(cls, path: str | Path) -> Self:
        """Read what `save` wrote. Raises InputError where the file is no such result."""

        def own(kind: str) -> type[Self]:
            if kind != cls.__name__:
                raise InputError(f"{path}: holds a {kind}, not a {cls.__name__}; use bayesdamp.load")
            return cls

        return read(path, own)


def read(path: str | Path, class_of: Callable[[str], type[R]]) -> R:
    """Return the result in a file. class_of: returns the class of a kind of result. Raises InputError where `save` did
    not write the file, or that of another version did."""
    path = Path(path)
    if not path.is_file():
        raise InputError(f"{path}: no such file; give one that a result's save() wrote")
    try:
        head, arrays = unpacked(path, META)
        kind, version = head["kind"], head["version"]
    except BROKEN:
        raise InputError(
            f"{path}: is not a result of bayesdamp, or not a whole one; give one that save() wrote"
        ) from None
    own = class_of(kind)
    try:
        return join(own, head["value"], arrays)
    except BROKEN:
        raise InputError(
            f"{path}: was saved by bayesdamp {version}, which this version does not read"
        ) from None


def outcome_notes(outcome: str, notes: Sequence[str] = ()) -> tuple[str, ...]:
    """The sentences below a table: the outcome, where it is more than `ok`, and notes."""
    return (*([f"Outcome: {outcome}"] if outcome != "ok" else []), *notes)
