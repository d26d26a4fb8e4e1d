"""Reading records: times and one recorded quantity each, out of a file of any format with a reader."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from bayesdamp.records.columns import LARGEST, LEAST, RecordColumns, choose_columns, separate_clocks
from bayesdamp.records.files.contents import Column, Contents
from bayesdamp.records.files.names import (
    DAY,
    SECONDS,
    seconds_of_unit,
    split_run,
    stated_unit,
    unit_of_column,
    unit_written,
)
from bayesdamp.records.opening import contents, file_error
from bayesdamp.records.record import RawRecord
from bayesdamp.types import InputError, Provenance

SLOWEST, FASTEST = 1e-9, 1e12
"""Sampling rates in Hz that a record can have: one in thirty years, a thousand in a nanosecond (conventional)."""

DATED = 1e4
"""Numbers of days from which on they are dates, and the first one's midnight is 0 s (conventional)."""

EPOCH = 1e8
"""Times in s, some three years, from which on they count from an epoch such as 1970 (conventional)."""
FROM_FIRST = "Times are counted from the first sample"
"""Begins the note on such times."""

ColumnName = str | int


def read_record(
    path: Path | str,
    *,
    time: ColumnName | None = None,
    value: ColumnName | None = None,
    rate: float | None = None,
    run: str | int | None = None,
    channel: str | None = None,
    time_unit: str | None = None,
) -> RawRecord:
    """Read one record of a file; as `read_records`, but InputError where there are several."""
    records = read_records(
        path,
        time=time,
        value=value,
        rate=rate,
        runs=None if run is None else str(run),
        channels=() if channel is None else (channel,),
        time_unit=time_unit,
    )
    if len(records) > 1:
        names = [f"run {r.run} {r.channel!r}" if r.run else repr(r.channel) for r in records]
        several = ", ".join(names[:8]) + (f" and {len(names) - 8} more" if len(names) > 8 else "")
        raise file_error(Path(path), f"holds {len(records)} records; give one's run or channel: {several}")
    return records[0]


def read_records(
    path: Path | str,
    *,
    time: ColumnName | None = None,
    value: ColumnName | None = None,
    rate: float | None = None,
    runs: str | None = None,
    channels: Sequence[str] = (),
    time_unit: str | None = None,
) -> list[RawRecord]:
    """Read the records of a file: one for each run and channel.

    Parameters
    ----------
    path
        Of the file.
    time, value
        A column's name, or its number from 1. In MATLAB, HDF5, NumPy and JSON files a name is a path with dots, such as
        `Theta1.signals.values`; a number at its end is a column of a matrix. A column that is not given is chosen where
        one choice makes sense, and a note says so: see `columns`.
    rate
        Sampling rate in Hz, in place of `time` and of what the file states.
    runs
        Such as `1,3-5`; all by default.
    channels
        As `value`, for several.
    time_unit
        Of the times; s where neither it nor the file states another.

    Raises
    ------
    InputError
        One line, for all that is wrong with the file or the request.
    """
    path = Path(path)
    if rate is not None and not (np.isfinite(rate) and SLOWEST <= rate <= FASTEST):
        right = f"a positive number of samples per second from {SLOWEST:g} to {FASTEST:g}"
        raise file_error(path, f"rate must be {right}, not {rate!r}")
    if rate is not None and time is not None:
        raise file_error(path, "give either time (a column) or rate (in Hz), not both")
    if time_unit is not None and time_unit.lower() not in SECONDS:
        valid = "s, ms, us, ns, ps, min, h, d"
        raise file_error(path, f"unknown unit of time {time_unit[:20]!r}; valid are {valid}")
    content = separate_clocks(contents(path))
    try:
        values = (*([value] if value is not None else []), *channels)
        chosen = choose_columns(content, time=time, values=values, rate=rate, runs=runs)
        return [_record(content, columns, path, time_unit, len(chosen) > 1) for columns in chosen]
    except InputError as error:
        raise file_error(path, error.what, error.arguments, error.likely) from None


def _record(
    content: Contents, chosen: RecordColumns, path: Path, time_unit: str | None, several: bool
) -> RawRecord:
    """Return the record of chosen columns. Raises InputError."""
    value, time = chosen.value, chosen.time
    value_name, time_name = _selector(value, content), None if time is None else _selector(time, content)
    if time is not None and time.values.size != value.values.size:
        raise InputError(
            f"{time_name!r} has {time.values.size} samples, {value_name!r} has {value.values.size}"
        )
    complete, notes = _complete_rows(value, time, content)
    y, t = value.values[complete], None if time is None else time.values[complete]
    lines = np.arange(value.values.size) if content.lines is None else content.lines
    if y.size < LEAST:
        raise InputError(f"{y.size} samples, a record needs at least {LEAST}")
    _refuse_unusable(y)
    notes = [*notes, *content.notes, *chosen.why]
    if t is not None and time is not None:
        t = _in_seconds(t, time, time_unit, notes)
    rate = chosen.rate if t is None else None
    if rate is not None and not SLOWEST <= rate <= FASTEST:
        what = f"its sampling rate is {rate:g} Hz, which no instrument has; give the right one"
        raise InputError(what, arguments=["rate"])
    if rate is not None and value.start and value.rate == rate:
        t, rate = value.start + np.arange(y.size) / rate, None
    began = 0.0
    if t is not None and t[0] >= EPOCH:
        began = float(t[0])
        t = t - began
        notes.append(f"{FROM_FIRST} ({began:.15g} s).")
    unit, quantity = _stated_unit(value, time, content)
    unit_from = ""  # who states the unit of the times
    if time is not None and time_unit is not None:
        unit_from = "given"
    elif time is not None and (time.clock or seconds_of_unit(time) is not None):
        unit_from = "file"
    base, run = split_run(value)
    provenance = Provenance(
        warnings=content.warnings,
        notes=tuple(notes),
        header_lines=(content.first_line or 1) - 1,
        facts=content.facts,
        time_column="" if time is None else time.label or f"column {time_name}",
        value_column=value.label or f"column {value_name}",
        time_unit=unit_from,
        first_line=content.first_line,
        constant_columns=tuple(chosen.still),
        more={
            "file": path.name,
            "format": content.format,
            **content.layout,
            "incomplete_rows": int(value.values.size - complete.sum()),
        },
    )
    return RawRecord(
        t,
        y,
        rate,
        lines[complete],
        provenance,
        run=run or chosen.run,
        channel=base if several or run else value.name,
        unit=unit,
        quantity=quantity,
        columns=(time_name, value_name),
        repeat=bool(run or chosen.run),
        choice=chosen.choice,
        why=chosen.why,
        began=began,
    )


def _selector(column: Column, content: Contents) -> str | int:
    """Return what a user types for a column: its name, or its number from 1 where it has none or shares it."""
    if column.name and sum(c.name == column.name for c in content.columns) == 1:
        return column.name
    return next(i for i, c in enumerate(content.columns, start=1) if c is column)


def _stated_unit(value: Column, time: Column | None, content: Contents) -> tuple[str, str]:
    """Return the unit and the quantity that a file states for a column of values, each empty where it states none.

    They are those of the column; else those of the facts but those about the times, where there is no other column;
    else those of the structure or group that contains the column, where it contains no other column of values.
    """
    unit, quantity = unit_of_column(value)
    if unit:
        return unit, quantity
    facts, inside = content.facts, f"{value.name.rpartition('.')[0]}."
    if len(content.columns) <= 2:
        of_times = f"{time.name}." if time is not None and time.name else "\0"
        facts = {name: fact for name, fact in facts.items() if not name.startswith(of_times)}
    elif inside != "." and sum(c.name.startswith(inside) for c in content.columns) <= 2:
        facts = {name: fact for name, fact in facts.items() if name.startswith(inside)}
    else:
        facts = {}
    if written := stated_unit(facts):
        return unit_written(written) or (written[:20], quantity)
    return unit, quantity


def _complete_rows(value: Column, time: Column | None, content: Contents) -> tuple[np.ndarray, list[str]]:
    """Return which rows (n,) have a cell in each column, and notes on the others.

    Raises InputError for a cell without a finite number: text such as NA or null, or nan.
    """
    columns = [(what, c) for what, c in (("time", time), ("value", value)) if c is not None]
    complete = np.ones(value.values.size, bool)
    for _, column in columns:
        if column.empty is not None:
            complete &= ~column.empty
    if not complete.any():
        raise InputError("no row has a number in each of the columns asked for")
    bad = np.flatnonzero(complete & ~np.all([np.isfinite(c.values) for _, c in columns], axis=0))
    if bad.size:
        row = int(bad[0])
        what, column = next((what, c) for what, c in columns if not np.isfinite(c.values[row]))
        number = next(i for i, c in enumerate(content.columns, start=1) if c is column)
        wrong = f"the {what} is {column.values[row]}, not a finite number"
        if row in column.words:
            wrong = f"{column.words[row]!r} in column {number} is not a number"
        place = f"sample {row} (from 0)"
        if content.first_line is not None and content.lines is not None:
            place = f"line {int(content.lines[row]) + content.first_line}"
        more = f" ({bad.size - 1} more like it)" if bad.size > 1 else ""
        raise InputError(f"{place}: {wrong}; correct it or leave the row out{more}")
    short = np.flatnonzero(~complete)
    if short.size == 0:
        return complete, []
    first, last = np.flatnonzero(complete)[[0, -1]]
    edge = int(np.sum((short < first) | (short > last)))
    parts = [f"{edge} at the ends"] if edge else []
    parts += [f"{short.size - edge} in between"] if short.size > edge else []
    many = f"{short.size} row{'s' if short.size != 1 else ''}"
    return complete, [f"{many} with an empty cell left out ({', '.join(parts)})."]


def _refuse_unusable(y: np.ndarray) -> None:
    """Refuse values that nothing can be computed from. Raises InputError."""
    largest = float(np.abs(y).max())
    if largest > LARGEST:
        raise InputError(
            f"the values go up to {largest:.3g}, which is not a measurement; is it the right column?"
        )
    span = float(np.ptp(y))
    if span == 0:
        raise InputError(f"the values are constant ({y[0]:g}), nothing oscillates; is it the right column?")
    if span < 1 / LARGEST:
        raise InputError(
            f"the values change by {span:.3g} at most, too little to compute with; give another unit"
        )


def _in_seconds(t: np.ndarray, time: Column, given: str | None, notes: list[str]) -> np.ndarray:
    """Return times (n,) in s, with a note where the file or the caller states another unit. Raises InputError."""
    seconds = SECONDS[given.lower()] if given is not None else seconds_of_unit(time)
    if seconds not in (None, 1.0):
        why = (
            f"as asked, they are in {given}" if given is not None else f"their column is named {time.label!r}"
        )
        begin = math.floor(t[0]) if seconds == DAY and t[0] >= DATED else 0
        since = f" from day {begin} on" if begin else ""
        notes.append(f"Times are taken × {seconds:g}{since}: {why}.")
        t = (t - begin) * seconds
    span = float(np.abs(t).max())
    if not span < 1 / SLOWEST * 1e3:
        raise InputError(
            f"the times go up to {span:.3g} s; is {time.name!r} the right column, or in another unit?"
        )
    if 0 < float(np.ptp(t)) < t.size / FASTEST:
        raise InputError(
            f"the times span {np.ptp(t):.3g} s, which no instrument resolves; give their unit or the rate"
        )
    return t
