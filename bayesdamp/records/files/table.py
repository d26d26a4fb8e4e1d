"""The layout of a table of numbers in a text file: separator, decimal mark, header."""

from __future__ import annotations

import csv
import re
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass

from bayesdamp.records.files.named_units import may_be_unit, unit_and_quantity
from bayesdamp.records.files.stamps import stamp

_NUMBER = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)([eEdD][+-]?\d+)?|[+-]?(nan|inf|infinity)", re.IGNORECASE)
_GROUPED = {  # thousands, as spreadsheets write them: 1.234,5 and 1,234.5
    ",": re.compile(r"[+-]?[1-9]\d{0,2}(\.\d{3})+,\d+"),
    ".": re.compile(r"[+-]?[1-9]\d{0,2}(,\d{3})+\.\d+"),
}
_FACT = re.compile(r"[^:=]+[:=]\s*\S.*")
_MONITOR = re.compile(r"\s*(\d{1,2}:\d\d:\d\d(?:[.,]\d+)?)\s*->\s*")
"""The time of day that a serial monitor writes before each line."""
BLANKS = " "
_GAPS = (r"\t|\s{2,}", r"\s+(?![(\[{])")
"""What parts names that have blanks of their own: wide gaps, or any but those before a unit in brackets."""
SEEN = 100
"""Lines in the middle of a text that show what a row of its table is like (conventional)."""
_MISSING = re.compile(r"n/?a|null|none|missing|invalid", re.IGNORECASE)
"""What loggers write where a number is missing."""
LONGEST = 400
"""Characters of a cell up to which it is looked at closely; longer numbers are of digits alone (conventional)."""


@dataclass(frozen=True)
class Layout:
    """How a text file writes its table.

    separator: one character, BLANKS for any run of blanks; decimal: "." or ","; columns: cells in a row;
    first: index of the first line of numbers; names: the header's names, stripped, or empty strings;
    units: those of a line below the names, as they stand there; groups: of several tables side by side, each column's.
    """

    separator: str
    decimal: str
    columns: int
    first: int
    names: tuple[str, ...]
    units: tuple[str, ...] = ()
    groups: tuple[str, ...] = ()

    def cells(self, line: str) -> list[str]:
        """The cells of a line, stripped."""
        return split(line, self.separator)


def split(line: str, separator: str) -> list[str]:
    """The cells of a line, stripped of blanks and quotes."""
    if separator == BLANKS:
        return [cell.strip("\"'") for cell in re.findall(r'"[^"]*"|\S+', line)]
    if '"' in line:
        return [cell.strip() for cell in next(csv.reader([line], delimiter=separator, skipinitialspace=True))]
    return [cell.strip() for cell in line.split(separator)]


def number(cell: str, decimal: str) -> float | None:
    """The number in a cell; a time of day, with a date or without, in s of its day (see `stamp`); else None."""
    if ":" in cell:
        found = stamp(cell)
        return None if found is None else found[1]
    if len(cell) > LONGEST:
        return float(cell) if cell.lstrip("+-").isdecimal() and cell[1:].isdecimal() else None
    other = "." if decimal == "," else ","
    if other in cell:
        if not _GROUPED[decimal].fullmatch(cell):
            return None
        cell = cell.replace(other, "")
    cell = cell.replace(",", ".")
    return float(cell.lower().replace("d", "e")) if _NUMBER.fullmatch(cell) else None


def without_arrows(lines: list[str]) -> list[str]:
    """Lines in which the time of day that a serial monitor wrote (`10:00:00.125 -> 3.5,7.1`) is a cell of its own."""
    marks = [_MONITOR.match(line) for line in lines]
    if 2 * sum(mark is not None for mark in marks) <= sum(bool(line.strip()) for line in lines):
        return lines
    rest = [line[mark.end() :] if mark else line for mark, line in zip(marks, lines, strict=True)]
    layout = find_layout(rest)
    if layout is None:
        return lines
    return [
        f"{mark[1]}{layout.separator}{line}" if mark else line for mark, line in zip(marks, rest, strict=True)
    ]


def find_layout(lines: list[str]) -> Layout | None:
    """The layout of lines, or None where they hold no numbers."""
    filled = [line for line in lines if line.strip()]
    if not filled:
        return None
    sample = filled[len(filled) // 2 :][:: max(1, len(filled) // 120)]
    best: tuple[tuple[float, int], str, str, int] | None = None
    for separator, decimal in (";,", ";.", "\t,", "\t.", ",.", " ,", " ."):
        rows = [split(line, separator) for line in sample]
        columns = Counter(map(len, rows)).most_common(1)[0][0]
        rows = [row for row in rows if len(row) == columns]
        cells = [cell for row in rows for cell in row if cell]
        if not cells:
            continue
        share = (
            sum(number(cell, decimal) is not None for cell in cells) / len(cells) * len(rows) / len(sample)
        )
        score = (round(share, 2), columns)
        if share > 0 and (best is None or score > best[0]):
            best = (score, separator, decimal, columns)
    if best is None:
        return None
    _, separator, decimal, columns = best
    first = _first_row(lines, separator, decimal, columns)
    if first is None:
        return None
    blanks = " \r\n" if separator == "\t" else None  # a tab is an empty cell there
    top = [line.strip(blanks).lstrip("#% ") for line in lines[:first] if line.strip()]
    heads = [split(line, separator) for line in top]
    if separator != BLANKS and columns > 3:  # without the empty cells at its end
        heads[-2:] = [
            h + [""] * (columns - len(h)) if columns // 2 < len(h) < columns else h for h in heads[-2:]
        ]
    if (
        separator == ","
        and columns == 2
        and any(_named(cell) for h in heads for cell in h)
        and all(len(h) == 1 for h in heads)
    ):
        separator, decimal, columns = BLANKS, ",", 1
        first = _first_row(lines, separator, decimal, columns) or first
    full = [h for h in heads if len(h) == columns]
    names, units = _names(full, columns)
    if names is None and separator != BLANKS and columns > 1:  # a head may have more cells than the rows
        full = [h[:columns] for h in heads if len(h) >= columns]
        names, units = _names(full, columns)
    at = full.index(names) if names in full else 0
    groups = side_by_side(names or [], full[at - 1] if at > 0 else ())
    if columns == 1:
        single = [line.strip('"') for line in top if not _FACT.fullmatch(line)]
        single = [line for line in single if _named(line) and not re.search("[,;\\t]", line)]
        said = [line for line in single if unit_and_quantity(line) is not None]
        names = (said or single)[-1:] or None
    elif names is None and separator == BLANKS:
        wide = [[c.strip() for c in re.split(gap, line)] for line in top for gap in _GAPS]
        names = next((h for h in wide if len(h) == columns and all(map(_named, h))), None)
    return Layout(separator, decimal, columns, first, tuple(names or [""] * columns), tuple(units), groups)


def side_by_side(names: Sequence[str], above: Sequence[str] = ()) -> tuple[str, ...]:
    """For each column the table that it belongs to, empty where all of them are one table.

    names: those of the columns, of which the first of a table is that of its times; tables have the same names, and
    blank columns may stand between them. above: the cells of the line above the names, of which the first in a table is
    what it is called; where there is none, `part 1` and so on.
    """
    first = next((name for name in names if name), "")
    starts = [i for i, name in enumerate(names) if name == first]
    if len(starts) < 2:
        return ()
    ends = [*starts[1:], len(names)]
    blocks = [[name for name in names[a:b] if name] for a, b in zip(starts, ends, strict=True)]
    if (
        len(blocks[0]) < 2
        or any(block != blocks[0] for block in blocks)
        or len(set(blocks[0])) < len(blocks[0])
    ):
        return ()
    labels = [next((cell for cell in above[a:b] if cell), "") for a, b in zip(starts, ends, strict=True)]
    if len({label for label in labels if label}) < len(labels):
        labels = [f"part {i}" for i in range(1, len(labels) + 1)]
    groups = [""] * starts[0]
    for label, a, b in zip(labels, starts, ends, strict=True):
        groups += [label] * (b - a)
    return tuple(groups)


def _names(heads: list[list[str]], columns: int) -> tuple[list[str] | None, list[str]]:
    """Of the lines above the numbers that have their columns: the last of those with most names (None where none is a
    header), and the units that stand in a line below it.

    What an instrument says of itself ("Model,DSO") stands above and has as many cells.
    """
    units = heads[-1] if len(heads) > 1 and all(map(may_be_unit, heads[-1], heads[-2])) else []
    if units:
        heads = heads[:-1]
    heads = [
        h for h in heads if all(c.isdigit() or number(c, ".") is None for c in h)
    ]  # `delta t,1E-5` is a fact
    named = [sum(map(_named, h)) for h in heads]
    most = max(named, default=0)
    if most < max(1, columns // 2):
        return None, []
    return [h for h, many in zip(heads, named, strict=True) if many == most][-1], units


def _named(cell: str) -> bool:
    return bool(re.search(r"[^\W\d_]", cell)) and number(cell, ".") is None


def _first_row(lines: list[str], separator: str, decimal: str, columns: int) -> int | None:
    """The first of two lines in a row (or the last line) that hold numbers in the table's columns.

    A line such as `delta t,1E-5` belongs to the head where numbers begin the other lines. Rows right above the first
    one belong to the table where only cells beyond its columns make them longer.
    """
    middle = [split(line, separator) for line in lines[len(lines) // 2 :][:SEEN]]
    begins = sum(number(cells[0], decimal) is not None for cells in middle if cells)
    headed = 2 * begins > len(middle)
    good = []
    for line in lines:
        cells = split(line, separator)
        filled = [c for c in cells if c]
        numbers = sum(number(c, decimal) is not None for c in filled)
        worded = headed and columns > 1 and _named(cells[0]) and not _MISSING.fullmatch(cells[0])
        good.append(len(cells) == columns and numbers > 0 and 2 * numbers >= len(filled) and not worded)
        if len(good) > 1 and good[-1] and good[-2]:
            return _with_longer(lines, len(good) - 2, separator, decimal, columns)
    return good.index(True) if True in good else None


def _with_longer(lines: list[str], first: int, separator: str, decimal: str, columns: int) -> int:
    """Return the first row of a table, counted with rows above `first` that have more cells: numbers in its columns,
    and anything beyond."""
    while first > 0 and columns > 1:
        cells = split(lines[first - 1], separator)
        if len(cells) <= columns or any(number(c, decimal) is None for c in cells[:columns]):
            break
        first -= 1
    return first
