"""Convert nested data (variables, structs, cells, groups, lists) to columns and facts named by their paths."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from bayesdamp.records.files.contents import Column, Contents, sampling_rate, stated_unit, trim_facts
from bayesdamp.types import Fact, InputError

WIDEST_MATRIX = 64
"""A matrix is ignored if both of its dimensions are larger than this (conventional)."""
DEEPEST_LEVEL = 20
"""Data nested in a file more deeply than this many levels are ignored (conventional)."""
_NUMBERS = "fiub"
"""Kinds of NumPy data types (`dtype.kind`) that are numbers: float, integer, unsigned integer, Boolean."""


class Walk:
    """Collector that walks through nested data: vectors become columns, scalars and texts become facts.

    A NumPy array of one element is a fact too; arrays of dates or durations become seconds. Each column or fact is
    named by its path in the data, with dots: `run.angle`. A matrix gives one column for each index of its shorter
    dimension, from 1. If several elements of a list (a cell array, an array of structs) are arrays, mappings or lists
    that are not empty, each element is a run (one of several measurements), numbered from 1, unless the list is itself
    in a run.

    Attributes
    ----------
    columns
        Columns collected so far.
    facts
        Numbers and texts collected so far, by path.
    """

    def __init__(self) -> None:
        self.columns: list[Column] = []
        self.facts: dict[str, object] = {}

    def add(self, path: str, item: Any, run: str = "", depth: int = 0) -> None:
        """Collect all vectors and facts (numbers and texts) in an item of nested data.

        Parameters
        ----------
        path
            Path of the item; "" for the whole file.
        item
            A mapping, list, array, number or text. Other items, empty arrays, and keys that begin with "__" are
            ignored. So are matrices with both dimensions larger than WIDEST_MATRIX, and arrays of more than two
            dimensions.
        run
            Run (one of several measurements) to which the item belongs; "" for none.
        depth
            Number of levels above the item; items below DEEPEST_LEVEL are ignored.
        """
        if depth > DEEPEST_LEVEL:
            return
        if isinstance(item, Mapping):
            for key, below in item.items():
                if not str(key).startswith("__"):
                    self.add(join_path(path, key), below, run, depth + 1)
        elif isinstance(item, str | int | float | np.number) and not isinstance(item, bool):
            self.facts[path] = item.item() if isinstance(item, np.number) else item
        elif isinstance(item, list | tuple):
            self.add_list(path, item, run, depth)
        elif isinstance(item, np.ndarray) and item.dtype.names:
            for key in item.dtype.names:
                self.add(join_path(path, key), item[key], run, depth + 1)
        elif isinstance(item, np.ndarray) and item.dtype.kind == "O":
            items = [
                x.ravel()[0] if isinstance(x, np.ndarray) and x.dtype == object and x.size == 1 else x
                for x in item.ravel().tolist()
            ]
            self.add_list(path, items, run, depth)
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
            elif table.ndim == 2 and min(table.shape) <= WIDEST_MATRIX:
                table = table if table.shape[0] >= table.shape[1] else table.T
                for i in range(table.shape[1]):
                    self._add_vector(join_path(path, i + 1), table[:, i].astype(float), run)

    def add_list(self, path: str, items: Any, run: str, depth: int) -> None:
        """Collect a list: numbers as a vector, equally long rows of numbers as a matrix, other items separately.

        None in a list of numbers becomes NaN. path, run, depth: as in `add`.
        """
        numbers = [np.nan if x is None else x for x in items]
        rows = items if all(isinstance(x, list | tuple) for x in items) else []
        if items and all(isinstance(x, int | float) and not isinstance(x, bool) for x in numbers):
            self._add_vector(path, np.array([float(x) for x in numbers]), run)
        elif len(rows) > 1 and all(
            len(row) == len(rows[0]) and all(isinstance(x, int | float) for x in row) for row in rows
        ):
            self.add(path, np.array(rows, float), run, depth)
        else:
            nested = [x for x in items if isinstance(x, np.ndarray | Mapping | list | tuple)]
            filled = sum((x.size if isinstance(x, np.ndarray) else len(x)) > 0 for x in nested)
            for i, below in enumerate(items, start=1):
                self.add(join_path(path, i), below, run or (str(i) if filled > 1 else ""), depth + 1)

    def _add_vector(self, path: str, values: np.ndarray, run: str, unit: str = "") -> None:
        group = path.partition(".")[0] if "." in path else ""  # the top-level variable
        self.columns.append(Column(path or "1", values, group, run, unit))

    def contents(self, format_name: str) -> Contents:
        """Return the collected columns and facts. Raises InputError if there is no column.

        The number of facts and their lengths are limited (`trim_facts`). format_name: short name of the file's format,
        such as "JSON".
        """
        if not self.columns:
            raise InputError(
                "contains no numeric array that can be read as columns; save times and values as two plain arrays"
            )
        return Contents(format_name, tuple(self.columns), trim_facts(self.facts))


def unit_and_rate(attributes: Mapping[str, Fact]) -> dict[str, Any]:
    """Return the unit and the sampling rate that an array's attributes state, as keyword arguments of `Column`.

    The keys are `unit` ("" if none is stated) and `rate` in Hz (None if none is stated).
    """
    rate = sampling_rate(attributes)
    return {"unit": stated_unit(attributes), "rate": rate[0] if rate else None}


def to_seconds(times: np.ndarray) -> np.ndarray:
    """Convert datetimes or durations to seconds.

    Parameters
    ----------
    times
        Array of NumPy datetimes or durations, (n,).

    Returns
    -------
    np.ndarray
        Seconds, (n,); NaN where a time is missing. Datetimes count from midnight of the first day. Durations without a
        unit are returned as plain numbers.
    """
    if times.dtype.kind == "M":
        known = times[~np.isnat(times)]
        times = times - (known[0].astype("datetime64[D]") if known.size else np.datetime64(0, "D"))
    if np.issubdtype(times.dtype, np.timedelta64) and np.datetime_data(times.dtype)[0] == "generic":
        return times.astype(float)
    return np.asarray(times / np.timedelta64(1, "s"), float)


def join_path(path: str, key: object) -> str:
    """Return the path of the item `key` below a path, such as "run.2"; only the key if the path is "" (the file)."""
    return f"{path}.{key}" if path else str(key)


def to_plain(value: Any) -> Any:
    """Convert a NumPy scalar, one-element array or bytes to a plain number or text; return other values unchanged.

    A date becomes a text in ISO 8601.
    """
    if isinstance(value, bytes):
        return value.decode("utf-8", "replace")
    if isinstance(value, np.ndarray) and value.size == 1:
        return to_plain(value.ravel()[0])
    if isinstance(value, np.datetime64):
        return str(value)
    return value.item() if isinstance(value, np.generic) else value
