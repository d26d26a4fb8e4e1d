"""Format numbers, probabilities and durations as text."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Self, TypeVar

from markupsafe import Markup, escape

if TYPE_CHECKING:
    import pandas as pd
    from rich.table import Table as RichTable

NONE = "–"
"""Text for a missing number."""
SUPERSCRIPTS = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")
"""Table for `str.translate` that replaces digits and the minus sign by superscripts."""


def number(value: float | None, digits: int = 4) -> str:
    """Return a number as text with `digits` significant digits; with a power of ten below 1e-4 and from 1e6 on.

    Below 1e6 all digits before the decimal point are written: 123456 with four digits is "123456". 0 gives "0", None
    and NaN give a dash, infinity gives ∞ or −∞.
    """
    if value is None or math.isnan(value):
        return NONE
    if math.isinf(value):
        return "∞" if value > 0 else "−∞"
    if value == 0:
        return "0"
    power = _power(value, digits)
    form = f".{max(0, digits - 1 - power)}f" if -4 <= power < 6 else f".{digits - 1}e"
    return _typeset(f"{value:{form}}")


def fixed_decimals(value: float, places: int) -> str:
    """Return a number as text with `places` decimals; NaN gives a dash, infinity gives ∞ or −∞."""
    return _typeset(f"{round(value, places) + 0.0:.{places}f}") if math.isfinite(value) else number(value)


MOST_DECIMALS, SMALL_NUMBER, LARGE_NUMBER = 8, 1e-3, 1e6
"""Limits of the function `digits` if it gets an uncertainty. It may write a number with a power of ten if the absolute
value is at least `LARGE_NUMBER`, or if it is below `SMALL_NUMBER` and needs more than `MOST_DECIMALS` decimals. It
writes other numbers with decimals only."""


def digits(value: float, width: float = math.nan, n: int = 4) -> str:
    """Return a value as text, rounded to the second significant digit of its uncertainty `width`.

    If the width is 10 or more, a value below `LARGE_NUMBER` is rounded to a whole number. If the width is missing (NaN)
    or not positive, or the value is 0, the text has at most `n` significant digits, is as short as possible, and has a
    power of ten only below 1e-4 and from 1e9 on. A NaN value gives a dash, infinity gives ∞ or −∞. The width must not
    be infinite.
    """
    if not math.isfinite(value):
        return number(value)
    if not width > 0 or value == 0:
        return _typeset(f"{float(f'{value:.{n}g}'):.9g}")
    places = 1 - math.floor(math.log10(width))
    if abs(value) >= LARGE_NUMBER or (places > MOST_DECIMALS and abs(value) < SMALL_NUMBER):
        return _typeset(f"{value:.{min(max(places + math.floor(math.log10(abs(value))) + 1, 1), 15)}g}")
    return fixed_decimals(value, min(max(0, places), 15))


NEGLIGIBLE_ERROR = 1e-7
"""`with_error` does not show an error below this fraction of the value. Records without noise have such errors."""


def with_error(value: float | None, error: float | None) -> str:
    """Return the text "value ± error", both rounded to the second significant digit of the error.

    The text is the value alone if the error is missing, not finite or not positive (four significant digits), or if it
    is below `NEGLIGIBLE_ERROR` times the value (seven significant digits). A missing value gives a dash, an infinite
    one ∞ or −∞.
    """
    if value is None or not math.isfinite(value) or error is None or not math.isfinite(error) or error <= 0:
        return number(value)
    if error < NEGLIGIBLE_ERROR * abs(value):
        return number(value, 7)
    return f"{digits(value, error)} ± {digits(error, error)}"


def nats(value: float | None, error: float = math.nan) -> str:
    """Return a log probability (nats) as text with at most two decimals, and ± error if the error is finite.

    If its absolute value is 100 or more, it has one decimal, and from 1000 on none, because no decision needs more. If
    the error is below 0.5, it always has two decimals; an error below 0.005 is written as "< 0.01". A missing or NaN
    value gives a dash, an infinite one ∞ or −∞.
    """
    if value is None or not math.isfinite(value):
        return number(value)
    places = 2 if abs(value) < 100 or error < 0.5 else 1 if abs(value) < 1000 else 0
    shown = _typeset(f"{value:.{places}f}")
    if not math.isfinite(error):
        return shown
    return f"{shown} ± {error:.2f}" if error >= 0.005 else f"{shown} ± < 0.01"


def interval(low: float, high: float) -> str:
    """Return the text "[low, high]", rounded to the second significant digit of a quarter of the interval's width.

    It is a dash if an end is not finite.
    """
    if not (math.isfinite(low) and math.isfinite(high)):
        return NONE
    width = (high - low) / 4
    return f"[{digits(low, width)}, {digits(high, width)}]"


EQUAL_FRACTION = 1e-6
"""`spread` shows a single number if its values differ by at most this fraction of the largest."""


def spread(values: Sequence[float]) -> str:
    """Return the range of values as text, such as "0.1 to 0.2"; the largest value alone if they are equal.

    They count as equal if their range is at most `EQUAL_FRACTION` times the largest value.
    """
    low, high = min(values), max(values)
    agree = high - low <= EQUAL_FRACTION * abs(high)
    return number(high, 6) if agree else f"{number(low, 5)} to {number(high, 5)}"


def probability(value: float | None) -> str:
    """Return a probability with two decimals; below 0.01 and above 0.99 with three.

    "< 0.001" is written below 0.0005, "> 0.999" from 0.9995 on, and a dash for None and NaN.
    """
    if value is None or math.isnan(value):
        return NONE
    if value >= 0.9995:
        return "> 0.999"
    if value < 0.0005:
        return "< 0.001"
    return f"{value:.2f}" if 0.01 <= value <= 0.99 else f"{value:.3f}"


def duration(seconds: float | None) -> str:
    """Return a duration in ms (below 0.1 s), s, min and s, or h and min; a dash for None, NaN and infinity."""
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
    """Return the items as one text such as "a, b and c"; "" if there are none.

    last: the word before the last item, instead of "and".
    """
    texts = list(items)
    return f"{', '.join(texts[:-1])} {last} {texts[-1]}" if len(texts) > 1 else "".join(texts)


def _power(value: float, digits: int) -> int:
    """Return the decimal exponent of a number after rounding to `digits` significant digits."""
    return int(f"{value:.{digits - 1}e}".split("e")[1])


def _typeset(text: str) -> str:
    """Return a formatted number with the sign − and superscripts: "-3.5e+07" becomes "−3.5 × 10⁷"."""
    mantissa, _, power = text.partition("e")
    tens = f" × 10{str(int(power)).translate(SUPERSCRIPTS)}" if power else ""
    return mantissa.replace("-", "−") + tens


def percentage(fraction: float) -> str:
    """Return a fraction in per cent as text, without the sign %.

    It has up to two significant digits below 10 %, and is an integer from 10 % on. NaN gives a dash.
    """
    return f"{100 * fraction:.0f}" if 100 * fraction >= 9.95 else digits(100 * fraction, n=2)


def time_span(start: float, stop: float) -> str:
    """Return a range of times in s, such as `36000 to 36014.99 s`, rounded to a thousandth of its length or finer."""
    digits = max(0, 3 - math.floor(math.log10(stop - start))) if stop > start else 4
    return f"{round(start, digits):.12g} to {round(stop, digits):.12g} s"


def with_interval(value: float, low: float, high: float, unit: str = "", scale: float = 1.0) -> str:
    """Return a value with its interval as text, such as `0.65 % (0.64 to 0.66)`; a dash if the value is not finite.

    unit: text after the value. scale: factor by which the three numbers are multiplied. They are rounded to the second
    significant digit of half the interval's width. If an end of the interval is not finite, the text is the value and
    "interval unbounded".
    """
    if not math.isfinite(value):
        return NONE
    if not (math.isfinite(low) and math.isfinite(high)):
        return f"{digits(value * scale, n=3)}{unit}, interval unbounded"
    shown = [digits(x * scale, (high - low) * scale / 2) for x in (value, low, high)]
    return f"{shown[0]}{unit} ({shown[1]} to {shown[2]})"


T = TypeVar("T")
LONG_CELL = 24
"""A text cell of an HTML table with more characters than this may be broken into several lines."""


class TableLine(tuple[str, ...]):
    """A row of a table, a tuple of its cells.

    kind: the style of the row in HTML: "" (usual), "best" (the best result), "quiet" (for a method that was refused or
    is not applicable) or "alert" (a warning).
    """

    kind: str

    def __new__(cls, cells: Iterable[str], kind: str = "") -> Self:
        """Return a row with these cells."""
        line = super().__new__(cls, cells)
        line.kind = kind
        return line


@dataclass(frozen=True)
class Table:
    """A table of text cells, which can be shown as HTML, plain text or on the terminal.

    headers, lines: cells of the header, and of each row; a row that is a `TableLine` has a style in HTML. caption: text
    above the table. left: indices of the columns that contain text (aligned to the left); the others contain numbers.
    notes: sentences below the table.
    """

    headers: Sequence[str] = ()
    lines: Sequence[Sequence[str]] = ()
    left: Iterable[int] = (0,)
    caption: str = ""
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
        """Make a table with one line for each of the objects in `rows`.

        columns: for each header, the function that returns the text of the cell for an object. kind: function that
        returns the style of the line for an object, the `kind` of `TableLine`.
        """
        lines = [TableLine((cell(row) for cell in columns.values()), kind(row)) for row in rows]
        return cls(list(columns), lines, left, caption)

    def __html__(self) -> str:
        """Return the table as HTML; a table without lines is shown as its caption and notes.

        Text that is not `Markup` is escaped. In caption and cells, indices of symbols such as μc become subscripts.
        """
        text = set(self.left)
        head = "".join(f"<th{_look(i in text)}>{symbols(h)}</th>" for i, h in enumerate(self.headers))
        body = []
        for line in self.lines:
            kind = getattr(line, "kind", "")
            cells = (f"<td{_look(i in text, cell)}>{symbols(cell)}</td>" for i, cell in enumerate(line))
            body.append(f"<tr{f' class={chr(34)}{kind}{chr(34)}' if kind else ''}>{''.join(cells)}</tr>\n")
        caption = f'<p class="caption">{symbols(self.caption)}</p>\n' if self.caption else ""
        grid = f"<table><thead><tr>{head}</tr></thead><tbody>\n{''.join(body)}</tbody></table>"
        notes = "".join(f"<p>{escape(note)}</p>" for note in self.notes)
        return f'<div class="table">{caption}<div class="scroll">{grid if body else ""}</div>{notes}</div>'

    def text(self) -> str:
        """Return the table as plain text: caption, header, lines and notes; without lines, only caption and notes."""
        grid = [self.headers, *self.lines] if self.lines else []
        text, widths = set(self.left), [max(map(len, column)) for column in zip(*grid, strict=True)]
        lines = []
        for row in grid:
            columns = enumerate(zip(row, widths, strict=True))
            cells = [cell.ljust(w) if i in text else cell.rjust(w) for i, (cell, w) in columns]
            lines.append("  ".join(cells).rstrip())
        return "\n".join([self.caption, *lines, *self.notes])

    def rich(self, **look: object) -> RichTable:
        """Return the headers and lines for the terminal, without caption and notes.

        look: options of `rich.table.Table`.
        """
        from rich.table import Table as RichTable

        table = RichTable(*self.headers, **look)  # type: ignore[arg-type]
        for line in self.lines:
            table.add_row(*line)
        return table


def _look(is_text: bool, cell: str = "") -> str:
    """Return the HTML class attribute of a table cell: "" for a number, `t` for text, `t w` for text that may wrap.

    is_text: whether the column contains text. cell: content of the cell; it may wrap if it has more than `LONG_CELL`
    characters.
    """
    if not is_text:
        return ""
    return ' class="t w"' if len(Markup(cell).striptags()) > LONG_CELL else ' class="t"'


def symbols(text: str) -> Markup:
    """Return text as HTML, in which the indices of μc, μq, μk, μp, θs, θe, F_damp and F_rest are subscripts.

    The text is escaped, unless it is `Markup` already.
    """
    shown = str(escape(text))
    for letters in ("μc", "μq", "μk", "μp", "θs", "θe"):
        shown = shown.replace(letters, f"{letters[0]}<sub>{letters[1]}</sub>")
    return Markup(shown.replace("F_damp", "F<sub>damp</sub>").replace("F_rest", "F<sub>rest</sub>"))


def data_frame(
    rows: Mapping[str, Any] | Iterable[Any],
    columns: Iterable[str] | None = None,
    index: Iterable[str] | None = None,
) -> pd.DataFrame:
    """Return rows of values as a data frame of pandas, which is imported only when it is needed.

    Parameters
    ----------
    rows
        Rows, each a sequence of values or a mapping from columns to values; or one mapping from columns to their
        values.
    columns, index
        Names of columns and of rows; by default the columns are those in `rows`, and the rows are numbered from 0.
    """
    import pandas as pd

    names, lines = (None if given is None else list(given) for given in (columns, index))
    return pd.DataFrame(rows if isinstance(rows, Mapping) else list(rows), lines, names)


def markdown_table(headers: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """Return a Markdown table; vertical bars in cells are escaped."""
    lines = [headers, ["---"] * len(headers), *rows]
    return "\n".join("| " + " | ".join(cell.replace("|", "\\|") for cell in line) + " |" for line in lines)


def show(value: object) -> str:
    """Return a value as text for an error message, written as in a study file, shortened to at most 60 characters."""
    try:
        text = str(value).lower() if isinstance(value, bool) else repr(value)
    except ValueError:  # Python does not convert integers of more than 4,300 digits
        text = "a number with thousands of digits"
    return text if len(text) <= 60 else f"{text[:57]}..."
