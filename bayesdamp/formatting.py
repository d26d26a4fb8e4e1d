"""Format numbers, probabilities and durations as text."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Self, TypeVar

from markupsafe import Markup, escape

if TYPE_CHECKING:
    from rich.table import Table as RichTable

NONE = "–"
"""Text for a missing number."""
_RAISED = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")


def number(value: float | None, digits: int = 4) -> str:
    """Return a number to so many significant digits; a dash where there is none."""
    if value is None or math.isnan(value):
        return NONE
    if math.isinf(value):
        return "∞" if value > 0 else "−∞"
    if value == 0:
        return "0"
    power = _power(value, digits)
    if -4 <= power < 6:
        return _signed(f"{value:.{max(0, digits - 1 - power)}f}")
    return f"{_signed(f'{value / 10.0**power:.{digits - 1}f}')}{_times_ten(power)}"


def short(error: float) -> str:
    """Return an error in little space: two digits, below a ten-thousandth one digit and a power."""
    if not math.isfinite(error) or error == 0 or abs(error) >= 1e-4:
        return number(error, 2)
    return f"{error:.0e}".replace("e-0", "e-").replace("-", "−")


def fixed(value: float, places: int) -> str:
    """Return a number to so many decimals."""
    return _signed(f"{round(value, places) + 0.0:.{places}f}") if math.isfinite(value) else number(value)


def given(value: float) -> str:
    """Return a number that a user specified, without further digits."""
    return _signed(f"{value:.6g}") if 1e-4 <= abs(value) < 1e6 or value == 0 else number(value, 3)


NEGLIGIBLE = 1e-7
"""Share of a value below which its error is that of a record without noise, and omitted."""


def with_error(value: float | None, error: float | None) -> str:
    """Return value ± error, to two significant digits of the error; the value alone where that is missing or tiny."""
    if value is None or not math.isfinite(value) or error is None or not math.isfinite(error) or error <= 0:
        return number(value)
    if error < NEGLIGIBLE * abs(value):
        return number(value, 7)
    decimals = 1 - _power(error, 2)
    top = max(_power(value, 4), _power(error, 2)) if value else _power(error, 2)
    if -4 <= top < 6 and decimals <= 8:
        places = max(0, decimals)
        return f"{_signed(f'{value:.{places}f}')} ± {error:.{places}f}"
    places = max(0, top + decimals)
    tens = 10.0**top
    return f"{_signed(f'({value / tens:.{places}f} ± {error / tens:.{places}f})')}{_times_ten(top)}"


def nats(value: float | None, error: float = math.nan) -> str:
    """Return a logarithm of probability, to a hundredth at most, as no decision depends on more."""
    if value is None or not math.isfinite(value):
        return number(value)
    places = 2 if abs(value) < 100 or error < 0.5 else 1 if abs(value) < 1000 else 0
    shown = _signed(f"{value:.{places}f}")
    if not math.isfinite(error):
        return shown
    return f"{shown} ± {error:.2f}" if error >= 0.005 else f"{shown} ± < 0.01"


def interval(low: float | None, high: float | None) -> str:
    """Return [low, high] to two significant digits of the width."""
    if low is None or high is None or not (math.isfinite(low) and math.isfinite(high)):
        return NONE
    width = high - low
    if width <= 0:
        return f"[{number(low)}, {number(high)}]"
    places = max(0, 1 - _power(width / 4, 2))
    if places > 8 or max(abs(low), abs(high)) >= 1e6:
        return f"[{number(low, 4)}, {number(high, 4)}]"
    return f"[{_signed(f'{low:.{places}f}')}, {_signed(f'{high:.{places}f}')}]"


AGREE = 1e-6
"""Relative difference below which values are equal."""


def spread(values: Sequence[float]) -> str:
    """Return the least and the largest value; a single value where they agree."""
    low, high = min(values), max(values)
    agree = high - low <= AGREE * abs(high)
    return number(high, 6) if agree else f"{number(low, 5)} to {number(high, 5)}"


def probability(value: float | None) -> str:
    """Return a probability: two decimals, near 0 and 1 three, and a bound rather than 0 or 1."""
    if value is None or math.isnan(value):
        return NONE
    if value >= 0.9995:
        return "> 0.999"
    if value < 0.0005:
        return "< 0.001"
    return f"{value:.2f}" if 0.01 <= value <= 0.99 else f"{value:.3f}"


def duration(seconds: float | None) -> str:
    """Return a duration in ms, s, min or h."""
    if seconds is None or not math.isfinite(seconds):
        return NONE
    if seconds < 0.0995:
        return f"{1000 * seconds:.0f} ms"
    if seconds < 60:
        return f"{seconds:.1f} s" if seconds < 9.95 else f"{seconds:.0f} s"
    whole = round(seconds)
    if whole < 3600:
        return f"{whole // 60} min {whole % 60:02d} s"
    return f"{whole // 3600} h {whole % 3600 // 60:02d} min"


def listing(items: Iterable[str], last: str = "and") -> str:
    """Return "a, b and c"."""
    texts = list(items)
    return f"{', '.join(texts[:-1])} {last} {texts[-1]}" if len(texts) > 1 else "".join(texts)


def _power(value: float, digits: int) -> int:
    """Return the decimal exponent of a number once it is rounded to so many digits."""
    return int(f"{value:.{digits - 1}e}".split("e")[1])


def _signed(text: str) -> str:
    """Return text with a minus sign in place of each hyphen."""
    return text.replace("-", "−")


def _times_ten(power: int) -> str:
    return f" × 10{str(power).translate(_RAISED)}"


def compact(value: float, digits: int = 4) -> str:
    """Return a number to so many digits, as short as it can be; a dash where there is none."""
    return NONE if math.isnan(value) else f"{value:.{digits}g}"


FIXED, SMALL, LARGE = 8, 1e-3, 1e6
"""Places up to which a small number has no exponent, the size of small numbers, and the size from which a number may
have an exponent."""


def digits(value: float, width: float) -> str:
    """Return a value with as many digits as its interval's width allows."""
    if not width > 0 or value == 0:
        return f"{value:.3g}"
    places = 1 - math.floor(math.log10(width))
    if abs(value) >= LARGE or (places > FIXED and abs(value) < SMALL):
        return f"{value:.{min(max(places + math.floor(math.log10(abs(value))) + 1, 1), 15)}g}"
    places = max(0, places)
    return f"{value:.{min(places, 15)}f}"


def rounded(percent: float) -> str:
    """Return an uncertain percentage: whole, below ten to one digit."""
    return f"{percent:.0f}" if percent >= 9.5 else f"{percent:.1g}"


def with_interval(value: float, low: float, high: float, unit: str = "", scale: float = 1.0) -> str:
    """Return `0.65 % (0.64 to 0.66)`; a dash where there is no value, and no interval where it has no ends."""
    if not math.isfinite(value):
        return NONE
    if not (math.isfinite(low) and math.isfinite(high)):
        return f"{value * scale:.3g}{unit}, within no bounds"
    width = (high - low) * scale
    shown = [digits(x * scale, width / 2) for x in (value, low, high)]
    return f"{shown[0]}{unit} ({shown[1]} to {shown[2]})"


def by_ten(text: str) -> str:
    """Return text with `3.57 × 10⁷` in place of `3.57e+07`."""
    return re.sub(r"e([+-]\d+)\b", lambda match: _times_ten(int(match[1])), text)


T = TypeVar("T")
LONG = 24
"""Letters above which a cell of text may wrap."""


class TableLine(tuple[str, ...]):
    """A row of a table, with its kind: "" or "best", "quiet" (refused, not applicable), "alert"."""

    kind: str

    def __new__(cls, cells: Iterable[str], kind: str = "") -> Self:
        """Return a line of these cells."""
        line = super().__new__(cls, cells)
        line.kind = kind
        return line


@dataclass(frozen=True)
class Table:
    """Headers and lines of text.

    left: indices of the columns of text; the others are numbers, aligned to the right. groups: cells of a line above
    the headers, each with the number of columns that it spans. foot: the same below all lines, where it stays when the
    table is sorted. notes: sentences below the table.
    """

    headers: Sequence[str] = ()
    lines: Sequence[Sequence[str]] = ()
    left: Iterable[int] = (0,)
    caption: str = ""
    groups: Sequence[tuple[str, int]] = ()
    foot: Sequence[tuple[str, int]] = ()
    notes: Sequence[str] = ()

    @classmethod
    def of(
        cls,
        rows: Iterable[T],
        columns: Mapping[str, Callable[[T], str]],
        left: Iterable[int] = (0,),
        caption: str = "",
        kind: Callable[[T], str] = lambda _: "",
    ) -> Self:
        """Build a table with a line for each row. columns: headers, with the functions that return a row's cell."""
        lines = [TableLine((cell(row) for cell in columns.values()), kind(row)) for row in rows]
        return cls(list(columns), lines, left, caption)

    def __html__(self) -> str:
        """Return the table as HTML: the text is escaped and the index of a symbol is a subscript."""
        text = set(self.left)
        groups = "".join(f'<th class="g" colspan="{n}">{symbols(cell)}</th>' for cell, n in self.groups)
        head = "".join(f"<th{_look(i in text)}>{symbols(h)}</th>" for i, h in enumerate(self.headers))
        head = f"{f'<tr>{groups}</tr>' if groups else ''}<tr>{head}</tr>"
        body = []
        for line in self.lines:
            kind = getattr(line, "kind", "")
            cells = (f"<td{_look(i in text, cell)}>{symbols(cell)}</td>" for i, cell in enumerate(line))
            body.append(f"<tr{f' class={chr(34)}{kind}{chr(34)}' if kind else ''}>{''.join(cells)}</tr>\n")
        foot = "".join(
            f'<td class="{"g" if i else "t"}" colspan="{n}">{symbols(cell)}</td>'
            for i, (cell, n) in enumerate(self.foot)
        )
        foot = f'<tfoot><tr class="best">{foot}</tr></tfoot>' if foot else ""
        caption = f'<p class="caption">{symbols(self.caption)}</p>\n' if self.caption else ""
        grid = f"<table><thead>{head}</thead><tbody>\n{''.join(body)}</tbody>{foot}</table>" if body else ""
        notes = "".join(f"<p>{escape(note)}</p>" for note in self.notes)
        return f'<div class="table">{caption}<div class="scroll">{grid}</div>{notes}</div>'

    def text(self) -> str:
        """Return the table in lines of plain text."""
        grid = [self.headers, *self.lines] if self.lines else []
        text, widths = set(self.left), [max(map(len, column)) for column in zip(*grid, strict=True)]
        lines = []
        for row in grid:
            columns = enumerate(zip(row, widths, strict=True))
            cells = [cell.ljust(w) if i in text else cell.rjust(w) for i, (cell, w) in columns]
            lines.append("  ".join(cells).rstrip())
        return "\n".join([self.caption, *lines, *self.notes])

    def rich(self, **look: object) -> RichTable:
        """Return the table for the terminal. look: options of rich's table."""
        from rich.table import Table as RichTable

        table = RichTable(*self.headers, **look)  # type: ignore[arg-type]
        for line in self.lines:
            table.add_row(*line)
        return table


def _look(is_text: bool, cell: str = "") -> str:
    """Return the attribute for the class of a cell of text; a long one may wrap."""
    if not is_text:
        return ""
    return ' class="t w"' if len(Markup(cell).striptags()) > LONG else ' class="t"'


def symbols(text: str) -> Markup:
    """Return escaped text in which the index of a symbol is a subscript."""
    shown = str(escape(text))
    for letters in ("μc", "μq", "μk", "μp", "θs", "θe"):
        shown = shown.replace(letters, f"{letters[0]}<sub>{letters[1]}</sub>")
    return Markup(shown.replace("F_damp", "F<sub>damp</sub>").replace("F_rest", "F<sub>rest</sub>"))


def markdown_table(headers: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """Return a Markdown table with a line for its headers and a line for each row.

    Vertical bars in cells are escaped.
    """
    lines = [headers, ["---"] * len(headers), *rows]
    return "\n".join("| " + " | ".join(cell.replace("|", "\\|") for cell in line) + " |" for line in lines)
