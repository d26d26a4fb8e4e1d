"""Reading records: times and one recorded quantity each, out of a file of any format there is a reader for."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from bayesdamp.provenance import Fact, Provenance
from bayesdamp.records.columns.choosing import LEAST, Series, series, with_own_clocks
from bayesdamp.records.columns.names import parted, seconds_of_unit, unit_said
from bayesdamp.records.columns.swings import LARGEST
from bayesdamp.records.files.contents import Column, Contents
from bayesdamp.records.files.facts import said_unit
from bayesdamp.records.files.named_units import SECONDS, unit_written
from bayesdamp.records.files.stamps import DAY
from bayesdamp.records.opening.opening import contents, fault
from bayesdamp.records.record import RawRecord
from bayesdamp.types import InputError

SLOWEST, FASTEST = 1e-9, 1e12
"""Sampling rates in Hz that a record can have: one in thirty years, a thousand in a nanosecond (conventional)."""

DATED = 1e4
"""Numbers of days from which on they are dates, and their first midnight is 0 s (conventional)."""

EPOCH = 1e8
"""Times in s, some three years, from which on they count from an epoch such as 1970 (conventional)."""
FROM_FIRST = "Times are counted from the first sample"
"""What is said of such times."""

_MEND = "mend it or leave the row out"
"""Of a cell that holds no number, whatever it says: NA, null and --- are no more than nan is."""

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
    """The one record in a file that is asked for; as `read_records`, but InputError where there are several."""
    found = read_records(
        path,
        time=time,
        value=value,
        rate=rate,
        runs=None if run is None else str(run),
        channels=() if channel is None else (channel,),
        time_unit=time_unit,
    )
    if len(found) > 1:
        raise fault(Path(path), f"holds {len(found)} records; give one's run or channel: {_several(found)}")
    return found[0]


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
    """The records in a file: one a run and channel.

    time, value: a column's name, or its number from 1; channels: the same for several values. In MATLAB, HDF5, NumPy
    and JSON files a name is a path with dots, such as `Theta1.signals.values`; a number at its end is a column of a
    matrix. What is not given is chosen where one choice makes sense, and a note says so: see `choosing`.
    rate: sampling rate in Hz; it stands in for `time` and for what the file says. runs: `1,3-5`; all by default.
    time_unit: of the times, s where neither it nor the file says another.
    Raises InputError, one line, for all that is wrong with the file or the request.
    """
    path = Path(path)
    if rate is not None and not (np.isfinite(rate) and SLOWEST <= rate <= FASTEST):
        right = f"a positive number of samples per second from {SLOWEST:g} to {FASTEST:g}"
        raise fault(path, f"rate must be {right}, not {rate!r}")
    if rate is not None and time is not None:
        raise fault(path, "give either time (a column) or rate (in Hz), not both")
    if time_unit is not None and time_unit.lower() not in SECONDS:
        raise fault(path, f"unknown unit of time {time_unit[:20]!r}; valid are s, ms, us, ns, ps, min, h, d")
    found = with_own_clocks(contents(path))
    try:
        values = (*([value] if value is not None else []), *channels)
        some = series(found, time=time, values=values, rate=rate, runs=runs)
        return [_record(found, one, path, time_unit, len(some) > 1) for one in some]
    except InputError as error:
        raise fault(path, error.what, error.arguments, error.likely) from None


def _several(found: Sequence[RawRecord]) -> str:
    names = [" ".join(filter(None, (f"run {r.run}" if r.run else "", repr(r.channel)))) for r in found]
    return ", ".join(names[:8]) + (f" and {len(names) - 8} more" if len(names) > 8 else "")


def _record(found: Contents, chosen: Series, path: Path, time_unit: str | None, several: bool) -> RawRecord:
    """The record of chosen columns. Raises InputError."""
    value, time = chosen.value, chosen.time
    if time is not None and time.values.size != value.values.size:
        raise InputError(
            f"{_typed(time, found)!r} has {time.values.size} samples, {_typed(value, found)!r} has {value.values.size}"
        )
    kept, notes = _complete(value, time, found)
    y, t = value.values[kept], None if time is None else time.values[kept]
    lines = np.arange(value.values.size) if found.lines is None else found.lines
    rows = lines[kept]
    if y.size < LEAST:
        raise InputError(f"{y.size} samples, a record needs at least {LEAST}")
    _usable(y)
    notes = [*notes, *found.notes, *chosen.why]
    if t is not None and time is not None:
        t = _in_seconds(t, time, time_unit, notes)
    rate = chosen.rate if t is None else None
    if rate is not None and not SLOWEST <= rate <= FASTEST:
        what = f"its sampling rate is {rate:g} Hz, which no instrument has; give it"
        raise InputError(what, arguments=["rate"])
    if rate is not None and value.start and value.rate == rate:
        t, rate = value.start + np.arange(y.size) / rate, None
    began = 0.0
    if t is not None and t[0] >= EPOCH:
        began = float(t[0])
        t = t - began
        notes.append(f"{FROM_FIRST} ({began:.15g} s).")
    unit, quantity = unit_said(value)
    if not unit and (said := said_unit(_facts_of(value, time, found))):
        written = unit_written(said)
        unit, quantity = written if written else (said[:20], quantity)
    said_by = ""  # who says the unit of the times
    if time is not None:
        stated = time.clock or seconds_of_unit(time) is not None
        said_by = "given" if time_unit is not None else "file" if stated else ""
    base, run = parted(value)
    provenance = Provenance(
        warnings=found.warnings,
        notes=tuple(notes),
        header_lines=(found.first_line or 1) - 1,
        facts=found.facts,
        time_column="" if time is None else time.label or f"column {_typed(time, found)}",
        value_column=value.label or f"column {_typed(value, found)}",
        time_unit=said_by,
        first_line=found.first_line,
        constant_columns=tuple(chosen.still),
        more={
            "file": path.name,
            "format": found.format,
            **found.layout,
            "incomplete_rows": int(value.values.size - kept.sum()),
        },
    )
    return RawRecord(
        t,
        y,
        rate,
        rows,
        provenance,
        run=run or chosen.run,
        channel=base if several or run else value.name,
        unit=unit,
        quantity=quantity,
        columns=(None if time is None else _typed(time, found), _typed(value, found)),
        repeat=bool(run or chosen.run),
        choice=chosen.choice,
        why=chosen.why,
        began=began,
    )


def _facts_of(value: Column, time: Column | None, found: Contents) -> dict[str, Fact]:
    """What a file says of values: all of it but what it says of the times where they have no neighbour but those, else
    what the structure or group that they lie in says where they have none in there."""
    if len(found.columns) <= 2:
        of_times = f"{time.name}." if time is not None and time.name else "\0"
        return {name: said for name, said in found.facts.items() if not name.startswith(of_times)}
    inside = f"{value.name.rpartition('.')[0]}."
    if inside == "." or sum(c.name.startswith(inside) for c in found.columns) > 2:
        return {}
    return {name: said for name, said in found.facts.items() if name.startswith(inside)}


def _complete(value: Column, time: Column | None, found: Contents) -> tuple[np.ndarray, list[str]]:
    """Return the rows that have a cell in each column, and notes on the others.

    Raises InputError for a cell without a finite number.
    """
    columns = [(what, c) for what, c in (("time", time), ("value", value)) if c is not None]
    kept = np.ones(value.values.size, bool)
    for _, column in columns:
        if column.empty is not None:
            kept &= ~column.empty
    if not kept.any():
        raise InputError("no row has a number in each of the columns asked for")
    bad = np.flatnonzero(kept & ~np.all([np.isfinite(c.values) for _, c in columns], axis=0))
    if bad.size:
        row = int(bad[0])
        what, column = next((what, c) for what, c in columns if not np.isfinite(c.values[row]))
        number = next(i for i, c in enumerate(found.columns, start=1) if c is column)
        wrong = (
            f"{column.words[row]!r} in column {number} is not a number"
            if row in column.words
            else f"the {what} is {column.values[row]}, not a finite number"
        )
        more = f" ({bad.size - 1} more like it)" if bad.size > 1 else ""
        place = f"sample {row} (from 0)"
        if found.first_line is not None and found.lines is not None:
            place = f"line {int(found.lines[row]) + found.first_line}"
        raise InputError(f"{place}: {wrong}; {_MEND}{more}")
    short = np.flatnonzero(~kept)
    if short.size == 0:
        return kept, []
    first, last = np.flatnonzero(kept)[[0, -1]]
    edge = int(np.sum((short < first) | (short > last)))
    parts = [f"{edge} at the ends"] if edge else []
    parts += [f"{short.size - edge} in between"] if short.size > edge else []
    many = f"{short.size} row{'s' if short.size != 1 else ''}"
    return kept, [f"{many} with an empty cell left out ({', '.join(parts)})."]


def _usable(y: np.ndarray) -> None:
    """Refuse values that nothing can be computed from. Raises InputError."""
    largest = float(np.abs(y).max())
    if largest > LARGEST:
        raise InputError(
            f"the values go up to {largest:.3g}, which is no measurement; is it the right column?"
        )
    span = float(np.ptp(y))
    if span == 0:
        raise InputError(f"the values are constant ({y[0]:g}), nothing oscillates; is it the right column?")
    if span < 1 / LARGEST:
        raise InputError(
            f"the values change by {span:.3g} at most, too little to compute with; give another unit"
        )


def _typed(column: Column, found: Contents) -> str | int:
    """Return what a user types for a column: its name, its number from 1 where it has none or shares it."""
    if column.name and sum(c.name == column.name for c in found.columns) == 1:
        return column.name
    return next(i for i, c in enumerate(found.columns, start=1) if c is column)


def _in_seconds(t: np.ndarray, time: Column, asked: str | None, notes: list[str]) -> np.ndarray:
    """Times in s where they, or the caller, are in another unit, which is noted. Raises InputError."""
    seconds = SECONDS[asked.lower()] if asked is not None else seconds_of_unit(time)
    if seconds not in (None, 1.0):
        said = (
            f"as asked, they are in {asked}" if asked is not None else f"their column is named {time.label!r}"
        )
        begin = math.floor(t[0]) if seconds == DAY and t[0] >= DATED else 0
        since = f" from day {begin} on" if begin else ""
        notes.append(f"Times are taken × {seconds:g}{since}: {said}.")
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
