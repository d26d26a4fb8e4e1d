"""What all results can do: print as a short table, be saved and loaded."""

from __future__ import annotations

import io
import json
import zipfile
from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Self

import numpy as np

from bayesdamp import __version__
from bayesdamp.calls import Told
from bayesdamp.store import write_bytes
from bayesdamp.table import Table
from bayesdamp.types import InputError

META = "result.json"
BROKEN = (zipfile.BadZipFile, OSError, EOFError, KeyError, ValueError, TypeError)
"""What reading a file raises that `save` did not write, or not to its end."""


@dataclass(frozen=True)
class Packed:
    """A result as a file holds it: its kind, what JSON can hold, and named arrays."""

    kind: str
    meta: Mapping[str, Any] = field(default_factory=dict)
    arrays: Mapping[str, np.ndarray] = field(default_factory=dict)

    def within(self, prefix: str) -> dict[str, np.ndarray]:
        """Its arrays, named as parts of another result."""
        return {f"{prefix}/{name}": value for name, value in self.arrays.items()}

    def part(self, prefix: str) -> Packed:
        """The result that was packed within this one under that name."""
        found = {
            n.removeprefix(f"{prefix}/"): a for n, a in self.arrays.items() if n.startswith(f"{prefix}/")
        }
        return Packed(prefix, self.meta[prefix], found)


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

    @abstractmethod
    def _packed(self) -> Packed: ...

    @classmethod
    @abstractmethod
    def _unpacked(cls, packed: Packed) -> Self: ...

    def save(self, path: str | Path) -> Path:
        """Write it to a file, all of it or nothing; the path. Raises InputError where it cannot be written."""
        path, packed = Path(path), self._packed()
        head = {"kind": packed.kind, "version": __version__, "meta": dict(packed.meta)}
        buffer = io.BytesIO()
        with zipfile.ZipFile(buffer, "w", zipfile.ZIP_DEFLATED) as archive:
            archive.writestr(META, json.dumps({**head, "arrays": list(packed.arrays)}, default=_plain))
            for i, array in enumerate(packed.arrays.values()):
                with archive.open(f"{i}.npy", "w") as member:
                    np.lib.format.write_array(member, np.asarray(array), allow_pickle=False)  # type: ignore[arg-type]
        try:
            write_bytes(path, buffer.getvalue())
        except OSError as error:
            raise InputError(f"{path}: cannot be written ({error.strerror or error})") from None
        return path

    @classmethod
    def load(cls, path: str | Path) -> Self:
        """Read what `save` wrote. Raises InputError where the file is no such result."""
        packed = read(path)
        if packed.kind != cls.__name__:
            raise InputError(f"{path}: holds a {packed.kind}, not a {cls.__name__}; use bayesdamp.load")
        return cls._unpacked(packed)


def read(path: str | Path) -> Packed:
    """What a file holds. Raises InputError where `save` did not write it."""
    path = Path(path)
    if not path.is_file():
        raise InputError(f"{path}: no such file; give one that a result's save() wrote")
    try:
        with zipfile.ZipFile(path) as archive:
            head = json.loads(archive.read(META))
            arrays = {
                name: np.lib.format.read_array(io.BytesIO(archive.read(f"{i}.npy")), allow_pickle=False)
                for i, name in enumerate(head["arrays"])
            }
        return Packed(head["kind"], head["meta"], arrays)
    except BROKEN:
        raise InputError(
            f"{path}: is not a result of bayesdamp, or not a whole one; give one that save() wrote"
        ) from None


def _plain(value: object) -> object:
    if isinstance(value, np.generic):
        return value.item()
    if isinstance(value, np.ndarray):
        return value.tolist()
    if isinstance(value, Mapping):
        return dict(value)
    return str(value)


def outcome_notes(outcome: str, notes: Sequence[str] = ()) -> tuple[str, ...]:
    """The sentences below a table: the outcome, where it is more than `ok`, and notes."""
    return (*([f"Outcome: {outcome}"] if outcome != "ok" else []), *notes)
