"""Text tables: CSV and its relatives, of loggers, phones and oscilloscopes."""

from __future__ import annotations

import codecs
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from bayesdamp.records.files.contents import Column, Contents, Reader
from bayesdamp.records.files.facts import header_facts
from bayesdamp.records.files.table import (
    BLANKS,
    Layout,
    find_layout,
    join_stamps,
    parse_number,
    parse_stamp,
    plain_oscilloscope,
    separate_monitor_times,
)
from bayesdamp.types import InputError

LARGEST = 2**29
"""Bytes of a text that is read; as lines it takes some ten times that (conventional)."""
MOST_COLUMNS = 5000
"""Columns beyond which a text is not a table of samples (conventional)."""
MOST_NOTES = 3
"""Lines left out that are noted one by one."""
_CONTROLS = bytes(set(range(32)) - {9, 10, 12, 13, 26, 27})
_WORD = 40
"""Characters that are kept of a cell without a number."""


class TextReader(Reader):
    """Text of loggers and phones; delimiter, decimal mark, header and encoding are detected."""

    format = "a text table"
    extensions = (".csv", ".tsv", ".txt", ".dat", ".asc", ".log")

    def claims(self, head: bytes, path: Path) -> bool:
        """Recognise text in a known encoding, without control characters."""
        if head.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)):
            return True
        controls = len(head) - len(head.translate(None, _CONTROLS))
        return b"\0" not in head and controls <= 0.01 * len(head)

    def read(self, path: Path) -> Contents:
        """Return the table's columns. Raises InputError for a text that is too large."""
        return parse_table(read_text(path).splitlines())


def read_text(path: Path, largest: int = LARGEST) -> str:
    """Read a text file in UTF-8, UTF-16 with a mark, or else Latin-1. Raises InputError for one that is too large."""
    if path.stat().st_size > largest:
        raise InputError(
            f"a text of more than {largest >> 20} MiB; give a part of it, or save it as .npy or HDF5"
        )
    data = path.read_bytes()
    if data.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)):
        return data.decode("utf-16", errors="replace")
    try:
        return data.decode("utf-8-sig")
    except UnicodeDecodeError:
        return data.decode("latin-1")


def parse_table(lines: list[str], format_name: str = "text") -> Contents:
    """Return the table in lines of text, whatever its separator. Raises InputError where there is none."""
    given = len(lines)
    scope = plain_oscilloscope(lines)
    lines, settings = scope if scope is not None else (separate_monitor_times(lines), {})
    layout = find_layout(lines)
    if layout is None:
        raise InputError("no rows of numbers were found; give a table with a row for each sample")
    if layout.columns > MOST_COLUMNS:
        raise InputError(
            f"has {layout.columns:,} columns; a record has a row for each sample: transpose the table"
        )
    body = lines[layout.first :]
    first = layout.first - (len(lines) - given)
    head = [(line, _named_columns(line, layout)) for line in lines[: layout.first]]
    warnings: list[str] = []
    most = max((names for _, names in head), default=0)
    if most > layout.columns and layout.separator != BLANKS:
        what = f"its head names {most} columns and its rows have {layout.columns}"
        warnings.append(f"{what}: names are taken from the left.")
    units = [unit.strip("()[] -") for unit in layout.units] or [""] * layout.columns
    groups = layout.groups or [""] * layout.columns
    names = [f"{g}.{n}" if g and n else n for g, n in zip(groups, layout.names, strict=True)]
    heads = list(zip(names, groups, units, strict=True))
    repeated: list[int] = []
    table = _numbers_only(body, layout)
    if table is not None:
        at = np.arange(len(table))
        columns = [
            Column(name, np.ascontiguousarray(table[:, i]), group=group, unit=unit)
            for i, (name, group, unit) in enumerate(heads)
        ]
    else:
        filled = [(i, layout.cells(line)) for i, line in enumerate(body) if line.strip()]
        header = [name for name in layout.names if name]
        repeated = [i for i, row in filled if header and [cell for cell in row if cell] == header]
        filled = [(i, row) for i, row in filled if i not in repeated]
        at = np.array([i for i, _ in filled])
        rows = [row for _, row in filled]
        columns = [make_column(rows, i, layout.decimal, *labels) for i, labels in enumerate(heads)]
        warnings += _uneven(rows, at + first + 1, layout.columns)
    while len(columns) > 1 and not columns[-1].name and not np.isfinite(columns[-1].values).any():
        columns.pop()  # a separator at the end of each line
    facts = settings or header_facts(line for line, names in head if not names)
    left_out = "repeats the names of the columns and is left out."
    notes = tuple(f"Line {first + 1 + i} {left_out}" for i in repeated[:MOST_NOTES])
    separator = "blanks" if layout.separator == BLANKS else layout.separator
    form = {"separator": separator, "decimal": layout.decimal}
    return Contents(format_name, tuple(columns), facts, notes, form, first + 1, at, warnings=tuple(warnings))


def _uneven(rows: list[list[str]], lines: np.ndarray, columns: int) -> tuple[str, ...]:
    """Return a sentence on rows whose number of cells differs from the table's columns; empty where there is none.

    rows: the cells of each; lines: numbers of their lines, (n,). Empty cells at the end of a row are not counted beyond
    the columns, and rows that are short until the table ends are columns of another length.
    """
    many = [max((i for i, cell in enumerate(row, 1) if cell or i <= columns), default=0) for row in rows]
    whole = max((i for i, count in enumerate(many) if count >= columns), default=0)
    odd = [i for i, count in enumerate(many) if count > columns or (count < columns and i < whole)]
    if not odd:
        return ()
    first = f"line {lines[odd[0]]} has {many[odd[0]]} cell{'s' if many[odd[0]] != 1 else ''}"
    more = f" (and {len(odd) - 1} more are uneven)" if len(odd) > 1 else ""
    what = "rows without a cell of the record are left out, and cells beyond the table are not read"
    return (f"{first} where the table has {columns}{more}: {what}.",)


def _named_columns(line: str, layout: Layout) -> int:
    """Return how many columns a line above the table names, or how many tables side by side; 0 for other lines."""
    cells = [cell for cell in layout.cells(line.strip().lstrip("#% ")) if cell]
    names = [name for name in layout.names if name]
    longer = len(names) > 1 and cells[: len(names)] == names
    return max(len(cells), 1) if longer or cells in (names, list(dict.fromkeys(layout.groups))) else 0


def _numbers_only(body: list[str], layout: Layout) -> np.ndarray | None:
    """Return the table (rows, columns) where each cell holds a number and no line is blank, else None."""
    while body and not body[-1].strip():
        body = body[:-1]
    if not all(map(str.strip, body)) or '"' in body[0]:
        return None
    if layout.decimal == ",":
        if any("." in line for line in body):
            return None
        body = [line.replace(",", ".") for line in body]
    try:
        delimiter = None if layout.separator == BLANKS else layout.separator
        table = np.loadtxt(body, delimiter=delimiter, comments=None, ndmin=2)
    except ValueError:
        return None
    return table if table.shape == (len(body), layout.columns) else None


def make_column(
    rows: Sequence[Sequence[str]], index: int, decimal: str, name: str, group: str = "", unit: str = ""
) -> Column:
    """Return the column at an index of rows of cells, which may lack cells at their ends."""
    cells = [row[index] if index < len(row) else "" for row in rows]
    values = np.full(len(cells), np.nan)
    days: dict[int, int | None] = {}
    words: dict[int, str] = {}
    clock = False
    for i, cell in enumerate(cells):
        number = parse_number(cell, decimal) if cell else None
        if number is not None:
            values[i], days[i] = number, None
            if ":" in cell:
                clock, stamp = True, parse_stamp(cell)
                days[i] = stamp[0] if stamp else None
        elif cell:
            words[i] = cell[:_WORD]
    if clock:
        timed = list(days)
        values[timed] = join_stamps(list(days.values()), values[timed])
    empty = np.array([not cell for cell in cells])
    return Column(name, values, group=group, unit=unit, clock=clock, empty=empty, words=words)


PLUGIN = TextReader()
