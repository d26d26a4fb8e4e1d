"""Arrays by name under variables, structs, cells and groups, as columns."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from bayesdamp.records.files.contents import Column, Contents
from bayesdamp.records.files.names import sampling_rate, stated_unit, trim_facts
from bayesdamp.types import Fact, InputError

WIDEST = 64
"""Columns of a matrix that are taken for columns of records."""
DEEPEST = 20
"""Levels of nesting that are followed."""
_NUMBERS = "fiub"
"""Kinds of NumPy's data types that hold numbers."""


class Walk:
    """Collects vectors of numbers as columns, and scalars and texts as facts, each by a path with dots.

    A matrix gives its columns, numbered from 1. Elements of a list (a cell array, an array of structs) that hold
    vectors are runs, numbered from 1.

    Attributes
    ----------
    columns
        Those collected so far.
    facts
        Numbers and texts by path.
    """

    def __init__(self) -> None:
        self.columns: list[Column] = []
        self.facts: dict[str, object] = {}

    def add(self, path: str, item: Any, run: str = "", depth: int = 0) -> None:
        """Collect every vector and every fact in an item.

        Parameters
        ----------
        path
            Of the item; empty for the whole file.
        item
            A mapping, list, array, number or text; other items are ignored.
        run
            The run that the item belongs to; empty where there is none.
        depth
            Levels of nesting above the item.
        """
        if depth > DEEPEST:
            return
        if isinstance(item, Mapping):
            for key, below in item.items():
                if not str(key).startswith("__"):
                    self.add(join_path(path, key), below, run, depth + 1)
        elif isinstance(item, str | int | float | np.number) and not isinstance(item, bool):
            self.facts[path] = item.item() if isinstance(item, np.number) else item
        elif isinstance(item, list | tuple):
            self._add_list(path, item, run, depth)
        elif isinstance(item, np.ndarray) and item.dtype.names:
            for key in item.dtype.names:
                self.add(join_path(path, key), item[key], run, depth + 1)
        elif isinstance(item, np.ndarray) and item.dtype.kind == "O":
            items = [
                x.ravel()[0] if isinstance(x, np.ndarray) and x.dtype == object and x.size == 1 else x
                for x in item.ravel().tolist()
            ]
            self._add_list(path, items, run, depth)
        elif isinstance(item, np.ndarray) and item.size == 1:
            only = item.ravel()[0]
            if item.dtype.kind in "US":
                self.facts[path] = only.decode("latin-1") if isinstance(only, bytes) else str(only)
            elif item.dtype.kind in _NUMBERS:
                self.facts[path] = float(only)
        elif isinstance(item, np.ndarray) and item.dtype.kind in "mM" and item.ndim == 1 and item.size:
            self._add_vector(path, to_seconds(item), run, "s")
        elif isinstance(item, np.ndarray) and item.dtype.kind in _NUMBERS and item.size:
            table = np.squeeze(item)
            if table.ndim == 1:
                self._add_vector(path, table.astype(float), run)
            elif table.ndim == 2 and min(table.shape) <= WIDEST:
                table = table if table.shape[0] >= table.shape[1] else table.T
                for i in range(table.shape[1]):
                    self._add_vector(join_path(path, i + 1), table[:, i].astype(float), run)

    def _add_list(self, path: str, items: Any, run: str, depth: int) -> None:
        if len(items) and all(isinstance(x, int | float) and not isinstance(x, bool) for x in items):
            self._add_vector(path, np.array([float(x) for x in items]), run)
            return
        nested = [x for x in items if isinstance(x, np.ndarray | Mapping | list | tuple)]
        filled = sum((x.size if isinstance(x, np.ndarray) else len(x)) > 0 for x in nested)
        for i, below in enumerate(items, start=1):
            self.add(join_path(path, i), below, run or (str(i) if filled > 1 else ""), depth + 1)

    def _add_vector(self, path: str, values: np.ndarray, run: str, unit: str = "") -> None:
        group = path.partition(".")[0] if "." in path else ""  # a variable with all that is below it
        self.columns.append(Column(path or "1", values, group, run, unit))

    def contents(self, format_name: str) -> Contents:
        """Return all that was collected. Raises InputError where there is no vector."""
        if not self.columns:
            raise InputError(
                "contains no numeric array with more than one number; save the times and the values as plain arrays"
            )
        return Contents(format_name, tuple(self.columns), trim_facts(self.facts))


def unit_and_rate(attributes: Mapping[str, Fact]) -> dict[str, Any]:
    """Return the fields `unit` and `rate` of a column that the attributes of its array state."""
    rate = sampling_rate(attributes)
    return {"unit": stated_unit(attributes), "rate": rate[0] if rate else None}


def to_seconds(times: np.ndarray) -> np.ndarray:
    """Return dates or lengths of time in s.

    Parameters
    ----------
    times
        Dates or lengths of time, (n,).

    Returns
    -------
    np.ndarray
        Dates from the first one's midnight on; NaN where a time is missing, (n,).
    """
    if times.dtype.kind == "M":
        known = times[~np.isnat(times)]
        times = times - (known[0].astype("datetime64[D]") if known.size else np.datetime64(0, "D"))
    if np.issubdtype(times.dtype, np.timedelta64) and np.datetime_data(times.dtype)[0] == "generic":
        return times.astype(float)
    return np.asarray(times / np.timedelta64(1, "s"), float)


def join_path(path: str, key: object) -> str:
    """Return the path of what is below a path."""
    return f"{path}.{key}" if path else str(key)


def to_plain(value: Any) -> Any:
    """Return an attribute as a number or a text, where it is one."""
    if isinstance(value, bytes):
        return value.decode("utf-8", "replace")
    if isinstance(value, np.ndarray) and value.size == 1:
        return to_plain(value.ravel()[0])
    if isinstance(value, np.datetime64):
        return str(value)
    return value.item() if isinstance(value, np.generic) else value
