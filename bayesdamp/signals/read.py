"""Reading a record: one time column and one column of values out of a text, MATLAB or NumPy file."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from bayesdamp.signals.arrays import from_arrays
from bayesdamp.signals.named_units import seconds_in
from bayesdamp.signals.record import RawRecord
from bayesdamp.signals.text import from_text
from bayesdamp.types import InputError

LEAST = 10
"""Samples that a record must have."""

Column = str | int


def read_record(
    path: Path | str, *, time: Column | None = None, value: Column | None = None, rate: float | None = None
) -> RawRecord:
    """The record in a file.

    time, value: a column's name, or its number from 1. In MATLAB and .npz files a name is a path with dots,
    such as `Theta1.signals.values`; a number at its end is a column of a matrix. A file with one column needs
    no `value`. Times whose column is named after another unit, such as `t (ms)`, are taken in s.
    rate: sampling rate in Hz, for a file without times; it stands in for `time`.
    Text files (any other name than .mat, .npy and .npz): separator, decimal comma, byte-order mark and header
    lines are found. Raises InputError, one line, for all that is wrong with the file or the request.
    """
    path = Path(path)
    where = path.name
    if rate is not None and not (np.isfinite(rate) and rate > 0):
        raise InputError(f"{where}: rate must be a positive number of samples per second, not {rate!r}")
    if rate is not None and time is not None:
        raise InputError(f"{where}: give either time (a column) or rate (in Hz), not both")
    if not path.exists():
        raise InputError(f"{path}: no such file")
    if path.is_dir():
        raise InputError(f"{path}: is a folder, not a file")
    if path.stat().st_size == 0:
        raise InputError(f"{where}: the file is empty")
    load = from_arrays if path.suffix.lower() in (".mat", ".npy", ".npz") else from_text
    try:
        t, y, rows, provenance = load(path, time, value, rate is not None)
    except OSError as error:
        raise InputError(f"{where}: cannot be read ({error.strerror or error})") from None
    for what, column in (("time", t), ("value", y)):
        if column is not None and not np.all(np.isfinite(column)):
            bad = int(np.flatnonzero(~np.isfinite(column))[0])
            line = provenance.get("first_line")
            at = f"line {rows[bad] + line}" if isinstance(line, int) else f"sample {bad} (from 0)"
            raise InputError(f"{where}, {at}: the {what} is {column[bad]}, not a finite number")
    if y.size < LEAST:
        raise InputError(f"{where}: {y.size} samples, a record needs at least {LEAST}")
    if np.ptp(y) == 0:
        raise InputError(f"{where}: the values are constant ({y[0]:g}), nothing oscillates")
    return RawRecord(_in_seconds(t, provenance), y, rate, rows, provenance)


def _in_seconds(t: np.ndarray | None, provenance: dict[str, Any]) -> np.ndarray | None:
    """Times in s where their column is named after another unit, which is noted."""
    name = provenance["time_column"]
    seconds = seconds_in(name) if t is not None and isinstance(name, str) else None
    if t is None or seconds in (None, 1.0):
        return t
    provenance["notes"].append(f"Times are taken × {seconds:g}: their column is named {name!r}.")
    return t * seconds
