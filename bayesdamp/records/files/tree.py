"""Arrays by name under variables, structs, cells and groups, as columns."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from bayesdamp.provenance import Fact
from bayesdamp.records.files.contents import Column, Contents
from bayesdamp.records.files.facts import kept, said_unit, sampling_rate
from bayesdamp.types import InputError

WIDEST = 64
"""Columns of a matrix that are taken for columns of records."""
DEEPEST = 20
_TYPES = "fiub"


class Walk:
    """Collects vectors of numbers as columns, scalars and words as facts, by a path with dots.

    A matrix gives its columns, numbered from 1. Elements of a list (a cell array, an array of structs) that hold
    vectors are runs, numbered from 1.
    """

    def __init__(self) -> None:
        self.columns: list[Column] = []
        self.facts: dict[str, object] = {}

    def add(self, path: str, item: Any, run: str = "", depth: int = 0) -> None:
        """Put every vector and every fact under item into the lists."""
        if depth > DEEPEST:
            return
        if isinstance(item, Mapping):
            for key, below in item.items():
                if not str(key).startswith("__"):
                    self.add(_joined(path, key), below, run, depth + 1)
        elif isinstance(item, str | int | float | np.number) and not isinstance(item, bool):
            self.facts[path] = item.item() if isinstance(item, np.number) else item
        elif isinstance(item, list | tuple):
            self._listed(path, item, run, depth)
        elif isinstance(item, np.ndarray):
            self._array(path, item, run, depth)

    def _listed(self, path: str, item: Any, run: str, depth: int) -> None:
        if len(item) and all(isinstance(x, int | float) and not isinstance(x, bool) for x in item):
            self.vector(path, np.array([float(x) for x in item]), run)
            return
        nested = [x for x in item if isinstance(x, np.ndarray | Mapping | list | tuple)]
        held = sum((x.size if isinstance(x, np.ndarray) else len(x)) > 0 for x in nested)
        for i, below in enumerate(item, start=1):
            self.add(_joined(path, i), below, run or (str(i) if held > 1 else ""), depth + 1)

    def _array(self, path: str, array: np.ndarray, run: str, depth: int) -> None:
        if array.dtype.names:
            for key in array.dtype.names:
                self.add(_joined(path, key), array[key], run, depth + 1)
        elif array.dtype.kind == "O":
            self._listed(path, [_single(x) for x in array.ravel().tolist()], run, depth)
        elif array.dtype.kind in "mM" and array.ndim == 1 and array.size > 1:
            self.columns.append(Column(path or "1", seconds_of(array), _group(path), run, "s"))
        elif array.dtype.kind in "US" and array.size == 1:
            text = array.ravel()[0]
            self.facts[path] = text.decode("latin-1") if isinstance(text, bytes) else str(text)
        elif array.dtype.kind in _TYPES and array.size == 1:
            self.facts[path] = float(array.ravel()[0])
        elif array.dtype.kind in _TYPES and array.size > 1:
            self._matrix(path, np.squeeze(array), run)

    def _matrix(self, path: str, array: np.ndarray, run: str) -> None:
        if array.ndim == 1:
            self.vector(path, array.astype(float), run)
        elif array.ndim == 2:
            table = array if array.shape[0] >= array.shape[1] else array.T
            for i in range(table.shape[1] if table.shape[1] <= WIDEST else 0):
                self.vector(_joined(path, i + 1), table[:, i].astype(float), run)

    def vector(self, path: str, values: np.ndarray, run: str = "", **said: Any) -> None:
        """Put one column in the list."""
        self.columns.append(Column(path or "1", values, _group(path), run, **said))

    def contents(self, form: str, **more: Any) -> Contents:
        """All that was collected. Raises InputError where there is no vector."""
        if not self.columns:
            raise InputError(
                "no numeric array of numbers in it; save the times and the values as plain arrays"
            )
        return Contents(form, tuple(self.columns), kept(self.facts), **more)


def described(attributes: Mapping[str, Fact]) -> dict[str, Any]:
    """Unit and rate that attributes of one array say, as `Walk.vector` takes them."""
    rate = sampling_rate(attributes)
    return {"unit": said_unit(attributes), "rate": rate[0] if rate else None}


def seconds_of(times: np.ndarray) -> np.ndarray:
    """Dates (n,), or lengths of time, in s: dates from the first midnight on; NaN for none."""
    if times.dtype.kind == "M":
        known = times[~np.isnat(times)]
        times = times - (known[0].astype("datetime64[D]") if known.size else np.datetime64(0, "D"))
    if np.issubdtype(times.dtype, np.timedelta64) and np.datetime_data(times.dtype)[0] == "generic":
        return times.astype(float)
    out = times / np.timedelta64(1, "s")
    return np.asarray(out, float)


def _joined(path: str, key: object) -> str:
    return f"{path}.{key}" if path else str(key)


def _group(path: str) -> str:
    """What stands before the first dot: a variable with all that is below it."""
    return path.partition(".")[0] if "." in path else ""


def _single(item: Any) -> Any:
    """An array of one object as that object."""
    return (
        item.ravel()[0] if isinstance(item, np.ndarray) and item.dtype == object and item.size == 1 else item
    )


def plain(value: Any) -> Any:
    """Return an attribute as a number or a word, where it is one."""
    if isinstance(value, bytes):
        return value.decode("utf-8", "replace")
    if isinstance(value, np.ndarray) and value.size == 1:
        return plain(value.ravel()[0])
    if isinstance(value, np.datetime64):
        return str(value)
    return value.item() if isinstance(value, np.generic) else value
