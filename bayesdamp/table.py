"""Tables of text, with renderers for a page, plain text and the terminal."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Self, TypeVar

from markupsafe import Markup, escape

if TYPE_CHECKING:
    from rich.table import Table as RichTable

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
