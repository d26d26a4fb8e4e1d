"""A short table, as text and as HTML: how every result prints."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from html import escape


@dataclass(frozen=True)
class Table:
    """A title, rows of cells under the columns' names, and sentences below them."""

    title: str
    columns: tuple[str, ...] = ()
    rows: tuple[tuple[str, ...], ...] = ()
    notes: tuple[str, ...] = ()

    def text(self) -> str:
        """In lines, the first column to the left and the others to the right."""
        grid = [self.columns, *self.rows] if self.rows else []
        widths = [max(len(row[i]) for row in grid) for i in range(len(self.columns))] if grid else []
        lines = [_line(row, widths) for row in grid]
        return "\n".join([self.title, *lines, *self.notes])

    def html(self) -> str:
        """As a table of HTML."""
        head = "".join(f"<th>{escape(c)}</th>" for c in self.columns)
        body = "".join(f"<tr>{''.join(f'<td>{escape(c)}</td>' for c in row)}</tr>" for row in self.rows)
        grid = f"<table><thead><tr>{head}</tr></thead><tbody>{body}</tbody></table>" if self.rows else ""
        below = "".join(f"<p>{escape(note)}</p>" for note in self.notes)
        return f"<p><strong>{escape(self.title)}</strong></p>{grid}{below}"


def _line(row: Sequence[str], widths: Sequence[int]) -> str:
    cells = [c.ljust(w) if i == 0 else c.rjust(w) for i, (c, w) in enumerate(zip(row, widths, strict=True))]
    return "  ".join(cells).rstrip()


def number(value: float, digits: int = 4) -> str:
    """A number in a table; a dash where there is none."""
    return "–" if math.isnan(value) else f"{value:.{digits}g}"


def said(outcome: str, notes: Sequence[str] = ()) -> tuple[str, ...]:
    """The sentences below a table: the outcome, where it is more than `ok`, and notes."""
    return (*([f"Outcome: {outcome}"] if outcome != "ok" else []), *notes)
