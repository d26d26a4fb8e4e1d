"""Define what all results can do: print as a short table, be saved and loaded."""

from __future__ import annotations

import zipfile
from abc import ABC, abstractmethod
from collections.abc import Sequence
from importlib import import_module
from pathlib import Path
from typing import Any, Self

import numpy as np

from bayesdamp import __version__
from bayesdamp.calls import CheckedMethods
from bayesdamp.plugins import nearest
from bayesdamp.serial import join, split
from bayesdamp.store.files import BROKEN, packed, save_bytes, unpacked
from bayesdamp.table import Table
from bayesdamp.types import InputError

META = "result.json"
KINDS = (
    "Record", "Signal", "Model", "Estimate", "Fit", "Posterior", "Evidence", "Comparison", "Prediction",
)  # fmt: skip
"""Public names of the results that are saved."""


class Shown(CheckedMethods, ABC):
    """A value that prints as a short table, also in a notebook; its methods refuse misspelt keywords in one line."""

    @abstractmethod
    def _table(self) -> Table: ...

    def __repr__(self) -> str:
        return self._table().text()

    def _repr_html_(self) -> str:
        return self._table().__html__()


class Result(Shown):
    """A frozen value that prints as a short table and can be saved and loaded."""

    def save(self, path: str | Path) -> Path:
        """Write the result to a file, completely or not at all, and return the path.

        Raises
        ------
        InputError
            Where the file cannot be written.
        """
        arrays = dict[str, np.ndarray]()
        head = {"kind": type(self).__name__, "version": __version__, "value": split(self, arrays)}
        return save_bytes(path, packed(META, head, arrays, zipfile.ZIP_DEFLATED))

    @classmethod
    def load(cls, path: str | Path) -> Self:
        """Read what `save` wrote.

        Raises
        ------
        InputError
            Where the file is not such a result.
        """
        return _read(path, cls)


def load(path: str | Path) -> Any:
    """Read the result that `save` wrote to a file, a verdict in JSON, or the run in a folder, whichever it is.

    A class's own `load`, such as `Fit.load(path)`, does the same with a type.

    Raises
    ------
    InputError
        Where the path is none of them.
    """
    path = Path(path)
    if path.is_dir():
        return import_module("bayesdamp").Run.load(path)
    if path.suffix == ".json":
        from bayesdamp.verdict.types import Verdict

        return Verdict.load(path)
    return _read(path, None)


def _read(path: str | Path, cls: type[Any] | None) -> Any:
    """Return the result in a file, which must be one of `cls` where that is given."""
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
    if cls is not None and kind != cls.__name__:
        raise InputError(f"{path}: holds a {kind}, not a {cls.__name__}; use bayesdamp.load")
    if cls is None:
        if kind not in KINDS:
            raise InputError(f"{path}: holds a {kind!r}, which is not known here{nearest(kind, list(KINDS))}")
        cls = getattr(import_module("bayesdamp"), kind)
    try:
        return join(cls, head["value"], arrays)
    except BROKEN:
        raise InputError(
            f"{path}: was saved by bayesdamp {version}, which this version does not read"
        ) from None


def outcome_notes(outcome: str, notes: Sequence[str] = ()) -> tuple[str, ...]:
    """Return the sentences below a table: the outcome, where it is not `ok`, and notes."""
    return (*([f"Outcome: {outcome}"] if outcome != "ok" else []), *notes)
