"""Text tables: CSV and its relatives, of loggers, phones and oscilloscopes."""

from __future__ import annotations

import codecs
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from bayesdamp.records.files import oscilloscope
from bayesdamp.records.files.contents import Column, Contents, Reader
from bayesdamp.records.files.facts import header_facts
from bayesdamp.records.files.stamps import seconds, stamp
from bayesdamp.records.files.table import BLANKS, Layout, find_layout, number, without_arrows
from bayesdamp.types import InputError

LARGEST = 2**29
"""Bytes of a text that is read; as lines it takes some ten times that (conventional)."""
_CONTROLS = bytes(set(range(32)) - {9, 10, 12, 13, 26, 27})
_WORD = 40
"""Characters of a cell without a number that are kept."""


class TextReader(Reader):
    """Text of loggers and phones: delimiter, decimal mark, header and encoding are found."""

    format = "a text table"
    extensions = (".csv", ".tsv", ".txt", ".dat", ".asc", ".log")

    def claims(self, head: bytes, path: Path) -> bool:
        """Text in an encoding that is known, without control characters."""
        if head.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)):
            return True
        controls = len(head) - len(head.translate(None, _CONTROLS))
        return b"\0" not in head and controls <= 0.01 * len(head)

    def read(self, path: Path) -> Contents:
        """The table's columns. Raises InputError for a text that is too large."""
        return from_lines(text_of(path).splitlines())


def text_of(path: Path, largest: int = LARGEST) -> str:
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


MOST_COLUMNS = 5000
"""Columns beyond which a text is no table of samples (conventional)."""


MOST_NOTES = 3
"""Lines left out that are named."""


def from_lines(lines: list[str], form: str = "text") -> Contents:
    """The table in lines of text, whatever its separator. Raises InputError where there is none."""
    given = len(lines)
    scope = oscilloscope.plain(lines)
    lines, settings = scope if scope is not None else (without_arrows(lines), {})
    layout = find_layout(lines)
    if layout is None:
        raise InputError("no rows of numbers were found; give a table with a row for each sample")
    body = lines[layout.first :]
    if layout.columns > MOST_COLUMNS:
        raise InputError(
            f"has {layout.columns:,} columns; a record has a row for each sample: give a table that is turned round"
        )
    first = layout.first - (len(lines) - given)
    head = [(line, _named_columns(line, layout)) for line in lines[: layout.first]]
    warnings: list[str] = []
    most = max((names for _, names in head), default=0)
    if most > layout.columns and layout.separator != BLANKS:
        what = f"its head names {most} columns and its rows have {layout.columns}"
        warnings.append(f"{what}: names are taken from the left.")
    table, again = _plain(body, layout), []
    if table is not None:
        at = np.arange(len(table))
        columns = [
            Column(name, np.ascontiguousarray(table[:, i]), group=group, unit=unit)
            for i, (name, group, unit) in enumerate(_heads(layout))
        ]
    else:
        filled = [(i, layout.cells(line)) for i, line in enumerate(body) if line.strip()]
        names = [name for name in layout.names if name]
        again = [i for i, row in filled if names and [cell for cell in row if cell] == names]
        filled = [(i, row) for i, row in filled if i not in again]
        at = np.array([i for i, _ in filled])
        rows = [row for _, row in filled]
        columns = [column_of(rows, i, layout.decimal, *head) for i, head in enumerate(_heads(layout))]
        warnings += _uneven(rows, at + first + 1, layout.columns)
    while len(columns) > 1 and not columns[-1].name and not np.isfinite(columns[-1].values).any():
        columns.pop()  # a separator at the end of each line
    return Contents(
        form,
        tuple(columns),
        settings or header_facts(line for line, names in head if not names),
        tuple(
            f"Line {first + 1 + i} repeats the names of the columns and is left out."
            for i in again[:MOST_NOTES]
        ),
        {
            "separator": "blanks" if layout.separator == BLANKS else layout.separator,
            "decimal": layout.decimal,
        },
        first + 1,
        at,
        warnings=tuple(warnings),
    )


def _uneven(rows: list[list[str]], lines: np.ndarray, columns: int) -> tuple[str, ...]:
    """Say which rows have another number of cells than the table's columns; empty where none has.

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
    what = "a row that lacks one of the record's is left out, and what is beyond them is not read"
    return (f"{first} where the table has {columns}{more}: {what}.",)


def _named_columns(line: str, layout: Layout) -> int:
    """Return how many columns a line above the table names, or how many tables side by side; 0 for other lines."""
    cells = [cell for cell in layout.cells(line.strip().lstrip("#% ")) if cell]
    names = [name for name in layout.names if name]
    longer = len(names) > 1 and cells[: len(names)] == names
    return max(len(cells), 1) if longer or cells in (names, list(dict.fromkeys(layout.groups))) else 0


def _heads(layout: Layout) -> list[tuple[str, str, str]]:
    """Name, group and unit of each column."""
    units = [u.strip("()[] -") for u in layout.units] or [""] * layout.columns
    groups = layout.groups or [""] * layout.columns
    names = [f"{g}.{n}" if g and n else n for g, n in zip(groups, layout.names, strict=True)]
    return list(zip(names, groups, units, strict=True))


def _plain(body: list[str], layout: Layout) -> np.ndarray | None:
    """The table where every cell of it holds a number and no line is blank, else None."""
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


def column_of(
    rows: Sequence[Sequence[str]], index: int, decimal: str, name: str, group: str = "", unit: str = ""
) -> Column:
    """Return the column at an index of rows of cells, which may lack cells at their ends."""
    cells = [row[index] if index < len(row) else "" for row in rows]
    values = np.full(len(cells), np.nan)
    days: list[int | None] = [None] * len(cells)
    words: dict[int, str] = {}
    clock = False
    for i, cell in enumerate(cells):
        if not cell:
            continue
        found = number(cell, decimal)
        if found is None:
            words[i] = cell[:_WORD]
            continue
        values[i] = found
        if ":" in cell:
            clock, said = True, stamp(cell)
            days[i] = said[0] if said else None
    if clock:
        timed = [i for i, cell in enumerate(cells) if cell and i not in words]
        values[timed] = seconds([days[i] for i in timed], values[timed])
    empty = np.array([not cell for cell in cells])
    return Column(name, values, group=group, unit=unit, clock=clock, empty=empty, words=words)


PLUGIN = TextReader()
