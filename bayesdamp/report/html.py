"""Templates and tables."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path

from jinja2 import Environment, FileSystemLoader, StrictUndefined
from markupsafe import Markup, escape

from bayesdamp.report import words


@dataclass(frozen=True)
class Line:
    """One row of a table. kind: "" or "best", "quiet" (refused, not applicable), "alert"."""

    cells: Sequence[str]
    kind: str = ""


@dataclass(frozen=True)
class Table:
    """headers; lines; left: indices of the columns of text (the others are numbers, set to the right).

    groups, foot: of a line above the headers and one below all others, which stays there when the table is sorted: each
    cell with the number of columns that it spans.
    """

    headers: Sequence[str]
    lines: Sequence[Line]
    left: frozenset[int] = field(default_factory=lambda: frozenset({0}))
    caption: str = ""
    groups: Sequence[tuple[str, int]] = ()
    foot: Sequence[tuple[str, int]] = ()

    def __html__(self) -> str:
        return fill("table.html", table=self)


@cache
def _environment() -> Environment:
    loader = FileSystemLoader(Path(__file__).parent / "templates")
    found = Environment(
        loader=loader, autoescape=True, undefined=StrictUndefined, trim_blocks=True, lstrip_blocks=True
    )
    found.filters["symbols"] = symbols
    found.filters["model"] = words.model
    found.filters["law"] = words.law
    found.filters["method"] = words.method
    found.filters["duration"] = words.duration
    found.filters["listing"] = words.listing
    return found


def symbols(text: str) -> Markup:
    """Escaped text in which the index of a symbol is set below the line."""
    shown = str(escape(text))
    for letters in ("μc", "μq", "μk", "μp", "θs", "θe"):
        shown = shown.replace(letters, f"{letters[0]}<sub>{letters[1]}</sub>")
    return Markup(shown.replace("F_damp", "F<sub>damp</sub>").replace("F_rest", "F<sub>rest</sub>"))


def fill(template: str, **values: object) -> Markup:
    """A template with its values; text is escaped."""
    return Markup(_environment().get_template(template).render(values))


def folded(summary: str, *content: object, open_: bool = False) -> Markup:
    """Content behind a line that unfolds it."""
    return fill("folded.html", summary=summary, content=content, open_=open_)
