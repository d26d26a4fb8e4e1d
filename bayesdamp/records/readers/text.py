"""Read text tables, such as CSV files, of loggers, phones and oscilloscopes.

Encoding, separator, decimal mark and header are detected from the text. Times of day and the formats of two makers of
oscilloscopes are supported.
"""

import codecs
import csv
import datetime
import re
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import accumulate
from pathlib import Path

import numpy as np

from bayesdamp.records.files.contents import (
    DAY,
    Column,
    Contents,
    Reader,
    header_facts,
    may_be_unit,
    trim_facts,
    unit_and_quantity,
)
from bayesdamp.types import Fact, InputError

LARGEST_TEXT = 2**29
"""Largest size of a text file in bytes; larger files are refused, because reading needs about ten times that memory
(conventional)."""
MOST_COLUMNS = 5000
"""Largest number of columns of a table; a table with more is refused, because it is probably transposed
(conventional)."""
_CONTROLS = bytes(set(range(32)) - {9, 10, 12, 13, 26, 27})
"""Control characters that do not occur in text files."""
_NUMBER = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)([eEdD][+-]?\d+)?|[+-]?(nan|inf|infinity)", re.IGNORECASE)
_GROUPED = {  # thousands, as spreadsheets write them: 1.234,5 and 1,234.5
    ",": re.compile(r"[+-]?[1-9]\d{0,2}(\.\d{3})+,\d+"),
    ".": re.compile(r"[+-]?[1-9]\d{0,2}(,\d{3})+\.\d+"),
}
_FACT = re.compile(r"[^:=]+[:=]\s*\S.*")
_MONITOR = re.compile(r"\s*(\d{1,2}:\d\d:\d\d(?:[.,]\d+)?)\s*->\s*")
"""Pattern of the time of day that a serial monitor writes before each line, such as `10:00:00.125 -> `."""
BLANKS = " "
"""Value of `Layout.separator` which means that the cells of a row are separated by any number of blanks."""
_GAPS = (r"\t|\s{2,}", r"\s+(?![(\[{])")
"""Patterns of the separators between names that contain blanks. The first is a tab or at least two blanks. The second
is any number of blanks, except before a unit in brackets."""
EXAMINED_LINES = 100
"""Number of lines in the middle of a text that are examined to decide whether the rows of the table begin with a number
(conventional)."""
_MISSING = re.compile(r"n/?a|null|none|missing|invalid", re.IGNORECASE)
"""Words that loggers write in place of a missing number. A row of the table may begin with one, but the cell does not
count as empty: a record that uses it is refused."""
LONGEST_CELL = 400
"""A cell with more characters than this counts as a number only if all of them are digits, after an optional sign
(conventional)."""
_DATES = (
    re.compile(r"(?P<y>\d{4})[-/](?P<m>\d{1,2})[-/](?P<d>\d{1,2})"),
    re.compile(r"(?P<d>\d{1,2})\.(?P<m>\d{1,2})\.(?P<y>\d{4})"),
)
_SLASHED = re.compile(r"(\d{1,2})/(\d{1,2})/(?:\d{4}|\d\d)[ ,]\s*")
"""Pattern of a date such as `5/3/2024`, whose order of day and month is ambiguous. Only the time of day after it is
used; a new day begins where the time of day falls back by almost a day."""
_TIME = re.compile(
    r"(\d{1,2}):(\d\d)(?::(\d\d(?:[.,]\d+)?))?\s*(AM|PM|Z|UTC|GMT|[+-]\d\d(?::?\d\d)?)?", re.IGNORECASE
)
SETTINGS_LINES = 64
"""Number of lines at the start of a text that are searched for an oscilloscope's settings (conventional)."""


class TextReader(Reader):
    """Reader of text tables; separator, decimal mark, header and encoding are detected."""

    format = "a text table"
    extensions = (".csv", ".tsv", ".txt", ".dat", ".asc", ".log")

    def claims(self, head: bytes, path: Path) -> bool:
        """Return whether the first bytes, `head`, are text; the path has no effect.

        Text contains no zero bytes (except in UTF-16) and at most 1 % control characters.
        """
        if head.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)):
            return True
        return b"\0" not in head and len(head) - len(head.translate(None, _CONTROLS)) <= 0.01 * len(head)

    def read(self, path: Path) -> Contents:
        """Return the table's columns. Raises InputError if the text is too large, or `parse_table` refuses it."""
        return parse_table(read_text(path).splitlines())


@dataclass(frozen=True)
class Layout:
    """The layout of a table in a text file.

    Attributes
    ----------
    separator
        Character between cells; BLANKS means any number of blanks.
    decimal
        Decimal mark, "." or ",".
    columns
        Number of cells in a row.
    first
        Index (from 0) of the first line of numbers.
    names
        Names of the columns; empty strings if there is no header.
    units
        Units in the line below the names, as written; empty if there is no such line.
    """

    separator: str
    decimal: str
    columns: int
    first: int
    names: tuple[str, ...]
    units: tuple[str, ...] = ()


def split_cells(line: str, separator: str) -> list[str]:
    """Return the cells of a line, without blanks and quotes around them.

    separator: a character, or BLANKS for any number of blanks; within double quotes it does not separate.
    """
    if separator == BLANKS:
        return [cell.strip("\"'") for cell in re.findall(r'"[^"]*"|\S+', line)]
    if '"' in line:
        return [cell.strip() for cell in next(csv.reader([line], delimiter=separator, skipinitialspace=True))]
    return [cell.strip() for cell in line.split(separator)]


def parse_number(cell: str, decimal: str) -> float | None:
    """Return the number in a cell.

    Parameters
    ----------
    cell
        Text without blanks at its ends.
    decimal
        Decimal mark, "." or ",". The other character may separate thousands if decimals follow: 1,234.5, but not 1,234.

    Returns
    -------
    float or None
        The number, which may be NaN or infinite if the cell contains `nan` or `inf`. For a time of day, the seconds
        since midnight (see `parse_stamp`). None for other text.
    """
    if ":" in cell:
        stamp = parse_stamp(cell)
        return None if stamp is None else stamp[1]
    if len(cell) > LONGEST_CELL:
        return float(cell) if cell.lstrip("+-").isdecimal() and cell[1:].isdecimal() else None
    other = "." if decimal == "," else ","
    if other in cell:
        if not _GROUPED[decimal].fullmatch(cell):
            return None
        cell = cell.replace(other, "")
    cell = cell.replace(",", ".")
    return float(cell.lower().replace("d", "e")) if _NUMBER.fullmatch(cell) else None


def parse_stamp(cell: str) -> tuple[int | None, float] | None:
    """Return the day and the seconds since midnight of a cell that contains a time of day, with or without a date.

    Examples are `2024-05-03T10:00:00.25Z`, `03.05.2024 10:00:00`, `5/3/2024 1:00:00 PM` and `10:00:00.25`.

    Returns
    -------
    tuple[int | None, float] | None
        The day is counted from the year 1. It is None if there is no date, and for a date with slashes, because its
        order of day and month is ambiguous. If the cell has a day and a time zone, day and seconds are in UTC; without
        a day, the time zone is ignored. The result is None if the cell is not a valid time (`99:99`), or has neither a
        date nor seconds.
    """
    date, rest = 0, cell  # 0 means no date
    if slashed := _SLASHED.match(cell):
        low, high = sorted((int(slashed[1]), int(slashed[2])))
        if not (1 <= low <= 12 and high <= 31):
            return None
        rest = cell[slashed.end() :]
    elif dated := next(filter(None, (pattern.match(cell) for pattern in _DATES)), None):
        try:
            date = datetime.date(int(dated["y"]), int(dated["m"]), int(dated["d"])).toordinal()
        except ValueError:
            return None
        if cell[dated.end() : dated.end() + 1] not in ("T", "t", " "):
            return None
        rest = cell[dated.end() + 1 :].strip()
    parts = _TIME.fullmatch(rest)
    if parts is None:
        return None
    hours, minutes, seconds = int(parts[1]), int(parts[2]), float((parts[3] or "0").replace(",", "."))
    zone = (parts[4] or "").upper()
    if zone in ("AM", "PM"):
        if not 1 <= hours <= 12:
            return None
        hours = hours % 12 + 12 * (zone == "PM")
    if minutes > 59 or seconds >= 61 or (hours > 24 if date or slashed else parts[3] is None):
        return None
    total = 3600.0 * hours + 60.0 * minutes + seconds
    if not date:
        return None, total
    if zone[:1] in ("+", "-"):
        digits = zone[1:].replace(":", "").ljust(4, "0")
        if int(digits[:2]) > 14 or int(digits[2:]) > 59:
            return None
        offset = 3600 * int(digits[:2]) + 60 * int(digits[2:])
        total += offset if zone[0] == "-" else -offset
    days, total = divmod(total, DAY)
    return date + int(days), total


def join_stamps(days: list[int | None], of_day: np.ndarray) -> np.ndarray:
    """Convert days and seconds since midnight to continuous times in s.

    Parameters
    ----------
    days
        Day of each time, counted from any date, or None for a time without a date; n values.
    of_day
        Seconds since midnight, (n,).

    Returns
    -------
    np.ndarray
        Times in s from midnight of the first day, (n,). If any date is missing, the days are not used: a new day begins
        where the time of day falls by more than 80000 s.
    """
    if None not in days:
        return of_day + DAY * (np.array(days, float) - float(days[0] or 0))
    t = of_day.copy()
    known = np.flatnonzero(np.isfinite(t))
    falls = np.diff(t[known]) < -80000.0
    t[known] += DAY * np.concatenate([np.zeros(min(known.size, 1)), np.cumsum(falls)])
    return t


def separate_monitor_times(lines: list[str]) -> list[str]:
    """Make the time of day that a serial monitor writes before each line (`10:00:00.125 -> 3.5,7.1`) a separate cell.

    Return the changed lines. The lines are unchanged unless most of them begin with such a time and the rest is a
    table.
    """
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


def _choose_separator(lines: list[str]) -> tuple[str, str, int] | None:
    """Return the separator, decimal mark and number of columns that fit the lines best; None if no cell is a number.

    Up to about 120 filled lines of the second half of the text are examined. A separator and decimal mark fit best if
    they have the largest product of two fractions: of the lines, those with the most frequent number of columns; of the
    filled cells in these lines, those that are numbers. If products are equal (to 0.01), the one with more columns is
    chosen, and then the first of `;` tab `,` blank (with "," before "."; with the separator `,`, "." is before "," of
    quoted cells).
    """
    filled = [line for line in lines if line.strip()]
    if not filled:
        return None
    sample = filled[len(filled) // 2 :][:: max(1, len(filled) // 120)]
    options: list[tuple[tuple[float, int], tuple[str, str, int]]] = []
    for separator, decimal in (";,", ";.", "\t,", "\t.", ",.", ",,", " ,", " ."):
        rows = [split_cells(line, separator) for line in sample]
        columns = Counter(map(len, rows)).most_common(1)[0][0]
        rows = [row for row in rows if len(row) == columns]
        cells = [cell for row in rows for cell in row if cell]
        numbers = sum(parse_number(cell, decimal) is not None for cell in cells)
        if numbers > 0:
            score = (round(numbers / len(cells) * len(rows) / len(sample), 2), columns)
            options.append((score, (separator, decimal, columns)))
    return max(options, key=lambda option: option[0], default=(None, None))[1]


def find_layout(lines: list[str]) -> Layout | None:
    """Return the layout of the table in lines of text; None if there are no numbers."""
    best = _choose_separator(lines)
    if best is None:
        return None
    separator, decimal, columns = best
    first = _first_row(lines, separator, decimal, columns)
    if first is None:
        return None
    blanks = " \r\n" if separator == "\t" else None  # do not strip tabs, which are empty cells
    top = [line.strip(blanks).lstrip("#% ") for line in lines[:first] if line.strip()]
    heads = [split_cells(line, separator) for line in top]
    if separator != BLANKS and columns > 3:  # add empty cells that are missing at the end of a header
        heads[-2:] = [
            h + [""] * (columns - len(h)) if columns // 2 < len(h) < columns else h for h in heads[-2:]
        ]
    worded = any(_has_letters(cell) for h in heads for cell in h)
    if separator == "," and columns == 2 and worded and all(len(h) == 1 for h in heads):
        separator, decimal, columns = BLANKS, ",", 1  # it is one column with decimal commas
        first = _first_row(lines, separator, decimal, columns) or first
    full = [h for h in heads if len(h) == columns]
    names, units = _choose_names(full, columns)
    if names is None and separator != BLANKS and columns > 1:  # the header may have more cells than the rows
        full = [h[:columns] for h in heads if len(h) >= columns]
        names, units = _choose_names(full, columns)
    if columns == 1:
        single = [line.strip('"') for line in top if not _FACT.fullmatch(line)]
        single = [line for line in single if _has_letters(line) and not re.search("[,;\\t]", line)]
        with_unit = [line for line in single if unit_and_quantity(line) is not None]
        names = (with_unit or single)[-1:] or None
    elif names is None and separator == BLANKS:
        wide = [[c.strip() for c in re.split(gap, line)] for line in top for gap in _GAPS]
        names = next((h for h in wide if len(h) == columns and all(map(_has_letters, h))), None)
    return Layout(separator, decimal, columns, first, tuple(names or [""] * columns), tuple(units))


def _choose_names(heads: list[list[str]], columns: int) -> tuple[list[str] | None, list[str]]:
    """Return the header (names of the columns) among the lines above the numbers, and the units in the line below it.

    The header is the line with the most names; of several, the last one, because facts about the instrument
    ("Model,DSO") are above it and may have as many cells. It is None, and the units are empty, if no line has names in
    half of the columns. heads: cells of each line above the numbers. columns: number of columns.
    """
    units = heads[-1] if len(heads) > 1 and all(map(may_be_unit, heads[-1], heads[-2])) else []
    if units:
        heads = heads[:-1]
    # A line with a number, such as `delta t,1E-5`, is a fact, not a header.
    heads = [h for h in heads if all(c.isdigit() or parse_number(c, ".") is None for c in h)]
    named = [sum(map(_has_letters, h)) for h in heads]
    most = max(named, default=0)
    if most < max(1, columns // 2):
        return None, []
    return [h for h, many in zip(heads, named, strict=True) if many == most][-1], units


def _has_letters(cell: str) -> bool:
    return bool(re.search(r"[^\W\d_]", cell)) and all(parse_number(cell, mark) is None for mark in ".,")


def _first_row(lines: list[str], separator: str, decimal: str, columns: int) -> int | None:
    """Return the index (from 0) of the first row of numbers; None if there is none.

    It is the first of two successive lines with the right number of columns and mostly numbers (without such a pair,
    the first single line). If most lines begin with a number, a line that begins with a word, such as `delta t,1E-5`,
    is not a row. If the lines just above have more cells than the table has columns, and begin with numbers for all
    columns, the first row is the first of them.
    """
    middle = [split_cells(line, separator) for line in lines[len(lines) // 2 :][:EXAMINED_LINES]]
    begins = sum(parse_number(cells[0], decimal) is not None for cells in middle if cells)
    headed = 2 * begins > len(middle)
    good: list[bool] = []
    for line in lines:
        cells = split_cells(line, separator)
        filled = [c for c in cells if c]
        numbers = sum(parse_number(c, decimal) is not None for c in filled)
        worded = headed and columns > 1 and _has_letters(cells[0]) and not _MISSING.fullmatch(cells[0])
        good.append(len(cells) == columns and numbers > 0 and 2 * numbers >= len(filled) and not worded)
        if len(good) > 1 and good[-1] and good[-2]:
            break
    else:
        return good.index(True) if True in good else None
    first = len(good) - 2
    while first > 0 and columns > 1:
        cells = split_cells(lines[first - 1], separator)
        if len(cells) <= columns or any(parse_number(c, decimal) is None for c in cells[:columns]):
            break
        first -= 1
    return first


def plain_oscilloscope(lines: list[str]) -> tuple[list[str], dict[str, Fact]] | None:
    """Convert an oscilloscope's file to a plain table with one line of names, and return it with the settings.

    Two formats are converted. Tektronix TDS oscilloscopes write the settings in the cells to the left of the first
    samples. Rigol oscilloscopes number the samples, and write start and increment of the time in the header.

    Parameters
    ----------
    lines
        Lines of the file.

    Returns
    -------
    tuple or None
        The lines of the table (for Tektronix after an additional line of names), and the settings as numbers or texts
        by name. None if the file is not from such an oscilloscope.
    """
    head = [split_cells(line, ",") for line in lines[:SETTINGS_LINES]]
    if len(head) < 3:
        return None
    if head[0][0] == "X" and head[1][0] == "Sequence" and "Start" in head[0]:
        start = head[0].index("Start")
        settings = [parse_number(cell, ".") for cell in head[1][start : start + 2]]
        if len(settings) < 2 or None in settings:
            return None
        first, step = float(head[1][start]), float(head[1][start + 1])
        names = [_with_unit(*pair) for pair in zip(head[0][1:start], head[1][1:start], strict=True)]
        rows = []
        for line in lines[2:]:
            cells = split_cells(line, ",")
            at = parse_number(cells[0], ".")
            rows.append("" if at is None else ",".join([repr(first + step * at), *cells[1:start]]))
        return ["", ",".join(["Time (s)", *names]), *rows], trim_facts({"Start": first, "Increment": step})
    names = [row[0] for row in head]
    beside = [parse_number(cell, ".") for cell in head[0][3:5]]
    if "Record Length" in names and "Sample Interval" in names and None not in beside and head[0][4:]:
        facts = {row[0]: " ".join(filter(None, row[1:3])) for row in head if row[0]}
        across, along = facts.get("Vertical Units", ""), facts.get("Horizontal Units", "s")
        title = f"{_with_unit('Time', along)},{_with_unit(facts.get('Source', 'CH1'), across)}"
        return [title, *(",".join(split_cells(line, ",")[3:5]) for line in lines)], trim_facts(facts)
    return None


def _with_unit(name: str, unit: str) -> str:
    return f"{name} ({unit})" if unit else name


def read_text(path: Path, largest: int = LARGEST_TEXT) -> str:
    """Return the text of a file, in UTF-8, UTF-16 or else Latin-1.

    Raises InputError if it is larger than `largest` bytes.
    """
    if path.stat().st_size > largest:
        raise InputError(
            f"the file has more than {largest >> 20} MiB of text; split it, or save it as .npy or HDF5"
        )
    data = path.read_bytes()
    if data.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)):
        return data.decode("utf-16", errors="replace")
    try:
        return data.decode("utf-8-sig")
    except UnicodeDecodeError:
        return data.decode("latin-1")


def parse_table(lines: list[str], format_name: str = "text") -> Contents:
    """Detect the layout of a text table, and return its contents.

    Parameters
    ----------
    lines
        Lines of the text.
    format_name
        Name of the format in the contents.

    Returns
    -------
    Contents
        The columns, and the facts above them. Rows that repeat the header are left out, and uneven rows give a warning.
        If tables with the same header are side by side below labels, the columns of each are a group.

    Raises
    ------
    InputError
        If there are no rows of numbers, or too many columns.
    """
    given = len(lines)
    scope = plain_oscilloscope(lines)
    lines, settings = scope if scope is not None else (separate_monitor_times(lines), {})
    layout = find_layout(lines)
    if layout is None:
        raise InputError("no rows of numbers were found; give a table with a row for each sample")
    if layout.columns > MOST_COLUMNS:
        raise InputError(f"has {layout.columns:,} columns; give a row for each sample: transpose the table")
    body = lines[layout.first :]
    first = layout.first - (len(lines) - given)
    header = [name for name in layout.names if name]
    # Each line above the rows, and how many columns it names (0 if it is not a header).
    head: list[tuple[str, int]] = []
    for line in lines[: layout.first]:
        cells = [cell for cell in split_cells(line.strip().lstrip("#% "), layout.separator) if cell]
        longer = len(header) > 1 and cells[: len(header)] == header
        head.append((line, max(len(cells), 1) if longer or cells == header else 0))
    warnings: list[str] = []
    most = max((names for _, names in head), default=0)
    if most > layout.columns and layout.separator != BLANKS:
        what = f"its header names {most} columns, but its rows have {layout.columns}"
        warnings.append(f"{what}: the first {layout.columns} names are used.")
    units = [unit.strip("()[] -") for unit in layout.units] or [""] * layout.columns
    # Tables side by side have the same names of columns; the line above has a label over the first one of each.
    below = max((i for i, (_, names) in enumerate(head) if names), default=0)
    cells = split_cells(head[below - 1][0].lstrip("#% "), layout.separator) if below else []
    labels, names = [*cells, *layout.columns * [""]][: layout.columns], layout.names
    starts = [name == names[0] for name in names]
    if names[0] and sum(starts) > 1 and list(map(bool, labels)) == starts:
        groups = list(accumulate(labels, lambda left, label: label or left))
        names = [f"{group}.{name}" if name else "" for group, name in zip(groups, names, strict=True)]
        head[below - 1] = (head[below - 1][0], layout.columns)
    else:
        groups = [""] * layout.columns
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
        filled = [(i, split_cells(line, layout.separator)) for i, line in enumerate(body) if line.strip()]
        repeated = [i for i, row in filled if header and [cell for cell in row if cell] == header]
        filled = [(i, row) for i, row in filled if i not in repeated]
        at = np.array([i for i, _ in filled])
        rows = [row for _, row in filled]
        columns = [make_column(rows, i, layout.decimal, *labels) for i, labels in enumerate(heads)]
        warnings += _uneven_warning(rows, at + first + 1, layout.columns)
    while len(columns) > 1 and not columns[-1].name and not np.isfinite(columns[-1].values).any():
        columns.pop()  # an empty column, from a separator at the end of each line
    last = next((line for line, _ in reversed(head) if line.strip()), "").lstrip("#% ")
    named = split_cells(last, layout.separator)
    if layout.separator != BLANKS and 1 < len(named) < len(columns) and all(map(_has_letters, named)):
        what = f"its header names {len(named)} columns, but its rows have {len(columns)}"
        warnings.append(
            f"{what}: check which column is which, and whether decimal commas were read as separators of cells."
        )
    facts = settings or header_facts(line for line, names in head if not names)
    left_out = "repeats the names of the columns and is left out."
    notes = tuple(f"Line {first + 1 + i} {left_out}" for i in repeated[:3])
    return Contents(format_name, tuple(columns), facts, notes, first + 1, at, warnings=tuple(warnings))


def _uneven_warning(rows: list[list[str]], lines: np.ndarray, columns: int) -> tuple[str, ...]:
    """Return a warning if rows have more or fewer cells than the table has columns; else an empty tuple.

    rows: cells of each row. lines: line numbers of the rows, (n,). columns: number of columns. Additional empty cells
    at the end of a row are not counted. Short rows at the end of the table are allowed, because columns may have
    different lengths.
    """
    many = [max((i for i, cell in enumerate(row, 1) if cell or i <= columns), default=0) for row in rows]
    whole = max((i for i, count in enumerate(many) if count >= columns), default=0)
    odd = [i for i, count in enumerate(many) if count > columns or (count < columns and i < whole)]
    if not odd:
        return ()
    first = f"line {lines[odd[0]]} has {many[odd[0]]} cell{'s' if many[odd[0]] != 1 else ''}"
    more = f" (and {len(odd) - 1} more are uneven)" if len(odd) > 1 else ""
    what = "rows without a value in the columns of the record are left out, and additional cells are not read"
    return (f"{first} where the table has {columns}{more}: {what}.",)


def _numbers_only(body: list[str], layout: Layout) -> np.ndarray | None:
    """Return the table as an array (rows, columns) if NumPy can convert all its cells at once; else None.

    body: lines from the first row of numbers on. Blank lines are allowed only at the end.
    """
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
    """Return one column of a table of text cells, with the cells converted to numbers.

    Parameters
    ----------
    rows
        Cells of each row; cells at the end of a row may be missing.
    index
        Index of the column in a row, from 0.
    decimal
        Decimal mark, "." or ",".
    name, group, unit
        Name, group and unit of the column, as in `Column`.

    Returns
    -------
    Column
        Its values are NaN in cells without a number. The first 40 characters of these cells, unless empty, are in
        `words`. Times of day become seconds from midnight of the first day.
    """
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
            words[i] = cell[:40]
    if clock:
        timed = list(days)
        values[timed] = join_stamps(list(days.values()), values[timed])
    empty = np.array([not cell for cell in cells])
    return Column(name, values, group=group, unit=unit, clock=clock, empty=empty, words=words)


PLUGIN = TextReader()
