"""Text tables: CSV and its relatives."""

from __future__ import annotations

import codecs
from pathlib import Path

import numpy as np

from bayesdamp.plugins import nearest
from bayesdamp.signals.table import BLANKS, Layout, find_layout
from bayesdamp.types import InputError

Loaded = tuple[np.ndarray | None, np.ndarray, np.ndarray, dict[str, object]]


def from_text(path: Path, time: str | int | None, value: str | int | None, no_time: bool) -> Loaded:
    """(times or None, values, row of each, provenance) of a text file; raises InputError."""
    where = path.name
    lines = decoded(path.read_bytes(), where).splitlines()
    layout = find_layout(lines)
    if layout is None:
        raise InputError(f"{where}: no rows of numbers were found")
    columns = _chosen(layout, time, value, no_time, where)
    notes: list[str] = []
    rows: list[list[float]] = []
    at: list[int] = []
    short: list[int] = []
    for i, line in enumerate(lines[layout.first :]):
        if not line.strip():
            continue
        cells = layout.cells(line)
        wanted = [cells[c] if c < len(cells) else "" for c in columns]
        if "" in wanted:
            short.append(i)
            continue
        numbers = [layout.number(cell) for cell in wanted]
        if None in numbers:
            cell = wanted[numbers.index(None)]
            name = columns[numbers.index(None)] + 1
            raise InputError(
                f"{where}, line {layout.first + i + 1}: {cell[:40]!r} in column {name} is not a number"
            )
        rows.append([x for x in numbers if x is not None])
        at.append(i)
    if not rows:
        raise InputError(f"{where}: no row has a number in each of the columns asked for")
    table = np.array(rows)
    if short:
        edge = sum(i < at[0] or i > at[-1] for i in short)
        parts = [f"{edge} at the ends"] if edge else []
        parts += [f"{len(short) - edge} in between"] if len(short) > edge else []
        notes.append(f"{_rows(len(short))} with an empty cell left out ({', '.join(parts)}).")
    if layout.first:
        notes.append(f"{layout.first} header line{'s' if layout.first > 1 else ''} skipped.")
    t = None if no_time else _past_midnight(table[:, 0])
    names = [layout.label(c) or f"column {c + 1}" for c in columns]
    provenance: dict[str, object] = {
        "file": where,
        "format": "text",
        "separator": "blanks" if layout.separator == BLANKS else layout.separator,
        "decimal": layout.decimal,
        "first_line": layout.first + 1,
        "time_column": None if no_time else names[0],
        "value_column": names[-1],
        "incomplete_rows": len(short),
        "notes": notes,
    }
    return t, table[:, -1], np.array(at), provenance


def _rows(count: int) -> str:
    return f"{count} row{'s' if count != 1 else ''}"


def decoded(data: bytes, where: str) -> str:
    if data.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)):
        return data.decode("utf-16", errors="replace")
    if b"\0" in data[:4096]:
        raise InputError(f"{where}: a binary file; readable are text tables, .mat, .npy and .npz")
    try:
        return data.decode("utf-8-sig")
    except UnicodeDecodeError:
        return data.decode("latin-1")


def _chosen(
    layout: Layout, time: str | int | None, value: str | int | None, no_time: bool, where: str
) -> list[int]:
    """Indices of the columns asked for: [time, value], or [value] where there is no time."""
    count, names = layout.columns, list(layout.names)
    listed = ", ".join(repr(n) for n in names if n) if any(names) else f"1 to {count} (they have no names)"
    if time is None and not no_time:
        raise InputError(
            f"{where}: no time given: name the time column or give rate in Hz; columns are {listed}"
        )
    first = [] if no_time or time is None else [_index(layout, time, where, listed)]
    if value is not None:
        return [*first, _index(layout, value, where, listed)]
    left = [i for i in range(count) if i not in first]
    if len(left) != 1:
        raise InputError(f"{where}: name the column of the recorded quantity; columns are {listed}")
    return [*first, left[0]]


def _index(layout: Layout, column: str | int, where: str, listed: str) -> int:
    """The index from 0 of a column given by name, or by number from 1."""
    name = str(column).strip()
    names = list(layout.names)
    if isinstance(column, str) and name in names:
        if names.count(name) > 1:
            raise InputError(
                f"{where}: {names.count(name)} columns are named {name!r}; give the column's number"
            )
        return names.index(name)
    if name.isdigit():
        if 1 <= int(name) <= layout.columns:
            return int(name) - 1
        raise InputError(f"{where}: there is no column {name}, the file has {layout.columns}")
    valid = [n for n in names if n]
    hint = nearest(name, valid) if valid else f"; columns are {listed}"
    raise InputError(f"{where}: unknown column {name!r}{hint}")


def _past_midnight(t: np.ndarray) -> np.ndarray:
    """Times of day that go on past midnight; others as they are."""
    falls = np.diff(t) < -80000.0
    return t + 86400.0 * np.concatenate([[0], np.cumsum(falls)]) if falls.any() else t
