"""One signal after the other; many of them folded, so that the page stays short."""

from __future__ import annotations

from collections.abc import Callable

from markupsafe import Markup

from bayesdamp.report.html import fill, folded
from bayesdamp.report.results.run import Run

_OPEN = 4
_MOST = 4
"""Models of a signal that are drawn: what is less likely than so many others is in the tables."""


def drawn(run: Run, place: int) -> bool:
    """Whether to draw the model at this place of a signal's ranking: the likeliest of few signals, the best of many."""
    return place == 0 or (place < _MOST and len(run.signals) <= _OPEN)


def by_signal(
    run: Run, one: Callable[[str], Markup], wanted: list[str] | None = None, anchor: str = ""
) -> Markup:
    """The content of each signal under its name; from the fifth on behind a line that unfolds it.

    anchor: what the names of links to a signal begin with, where it may be linked to.
    """
    signals = run.signals if wanted is None else wanted
    parts: list[Markup] = []
    for i, signal in enumerate(signals):
        body = one(signal)
        heading = Markup("<h3>{}</h3>").format(signal) if len(signals) > 1 else Markup("")
        shown = heading + body if i < _OPEN else folded(signal, body)
        parts.append(Markup('<div id="{}">{}</div>').format(anchor + signal, shown) if anchor else shown)
    said = "With so many signals only the best model of each is drawn; the tables have all."
    note = Markup('<p class="small">{}</p>').format(said) if len(run.signals) > _OPEN else Markup("")
    return fill("stack.html", parts=[note, *parts])
