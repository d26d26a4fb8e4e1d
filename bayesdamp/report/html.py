"""Fill the report's templates."""

from __future__ import annotations

from functools import cache
from pathlib import Path

from jinja2 import Environment, FileSystemLoader, StrictUndefined
from markupsafe import Markup

from bayesdamp.table import symbols


@cache
def _environment() -> Environment:
    loader = FileSystemLoader(Path(__file__).parent / "templates")
    found = Environment(
        loader=loader, autoescape=True, undefined=StrictUndefined, trim_blocks=True, lstrip_blocks=True
    )
    found.filters["symbols"] = symbols
    return found


def fill(template: str, **values: object) -> Markup:
    """A template with its values; text is escaped."""
    return Markup(_environment().get_template(template).render(values))


def folded(summary: str, *content: object, open_: bool = False) -> Markup:
    """Content behind a line that unfolds it."""
    return fill("folded.html", summary=summary, content=content, open_=open_)


def stack(*parts: object) -> Markup:
    """Return parts below each other; empty ones are left out."""
    return fill("stack.html", parts=parts)


def paragraph(text: object, look: str = "") -> Markup:
    """Return a text as a paragraph, escaped. look: its class in the style sheet."""
    return Markup("<p{}>{}</p>").format(Markup(f' class="{look}"') if look else "", text)
