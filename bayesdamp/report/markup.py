"""Build HTML from the report's templates, and tables in Markdown."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from pathlib import Path

from jinja2 import Environment, FileSystemLoader, StrictUndefined
from markupsafe import Markup

from bayesdamp.table import symbols

TEMPLATES = Path(__file__).parent / "templates"
ENVIRONMENT = Environment(
    loader=FileSystemLoader(TEMPLATES),
    autoescape=True,
    undefined=StrictUndefined,
    trim_blocks=True,
    lstrip_blocks=True,
)
ENVIRONMENT.filters["symbols"] = symbols


def fill(template: str, **values: object) -> Markup:
    """Fill a template with values; text is escaped."""
    return Markup(ENVIRONMENT.get_template(template).render(values))


def folded(summary: str, *content: object) -> Markup:
    """Hide content behind a line that opens it."""
    return fill("folded.html", summary=summary, content=content)


def stack(*parts: object) -> Markup:
    """Place parts below each other; empty ones are left out."""
    return fill("stack.html", parts=parts)


def paragraph(text: object, look: str = "") -> Markup:
    """Return a text as a paragraph, escaped. `look` is its class in the style sheet."""
    return Markup("<p{}>{}</p>").format(Markup(f' class="{look}"') if look else "", text)


def heading(text: str) -> Markup:
    """Return a text as a heading within a section, escaped."""
    return Markup("<h3>{}</h3>").format(text)


def markdown_table(headers: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """Return a Markdown table with a line for its headers and a line for each row.

    Vertical bars in cells are escaped.
    """
    lines = [headers, ["---"] * len(headers), *rows]
    return "\n".join("| " + " | ".join(cell.replace("|", "\\|") for cell in line) + " |" for line in lines)
