"""Sections that show one signal after the other; many signals are folded, so that the page stays short."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Callable, Sequence

from markupsafe import Markup

from bayesdamp.report import words
from bayesdamp.report.html import folded, paragraph, stack
from bayesdamp.report.results.run import Run
from bayesdamp.report.sections._section import Section

_OPEN = 4
_MOST = 4
"""Models of a signal that are drawn: what is less likely than so many others is in the tables."""


class SignalSection(Section):
    """A section with a part for each signal that it applies to."""

    lead = ""
    """A sentence or two before the signals."""

    @abstractmethod
    def shows(self, run: Run, signal: str) -> bool:
        """Return whether the section has something on a signal."""

    @abstractmethod
    def part(self, run: Run, signal: str) -> Markup:
        """Return the content on a signal."""

    def applies(self, run: Run) -> bool:
        """Return whether the section has something on any signal."""
        return any(self.shows(run, signal) for signal in run.signals)

    def render(self, run: Run) -> Markup:
        """Return the lead and the content on each signal."""
        wanted = [signal for signal in run.signals if self.shows(run, signal)]
        return stack(self.lead and paragraph(self.lead), by_signal(run, self.part, wanted))


def drawn(run: Run, place: int) -> bool:
    """Whether to draw the model at this place of a signal's ranking: the likeliest of few signals, the best of many."""
    return place == 0 or (place < _MOST and len(run.signals) <= _OPEN)


def by_signal(
    run: Run, part: Callable[[Run, str], Markup], wanted: list[str] | None = None, anchor: str = ""
) -> Markup:
    """The content of each signal under its name; from the fifth on behind a line that unfolds it.

    anchor: what the names of links to a signal begin with, where it may be linked to.
    """
    signals = run.signals if wanted is None else wanted
    parts: list[Markup] = []
    for i, signal in enumerate(signals):
        body = part(run, signal)
        heading = Markup("<h3>{}</h3>").format(signal) if len(signals) > 1 else Markup("")
        shown = heading + body if i < _OPEN else folded(signal, body)
        parts.append(Markup('<div id="{}">{}</div>').format(anchor + signal, shown) if anchor else shown)
    note = "With so many signals only the best model of each is drawn; the tables have all."
    return stack(paragraph(note, "small") if len(run.signals) > _OPEN else "", *parts)


def by_model(models: Sequence[tuple[str, Sequence[object]]], lead: str = "", behind: str = "") -> Markup:
    """Return the content on each model: the first open under its name, the others behind a line that unfolds them.

    lead: words before the name; behind: words after the first name.
    """
    parts: list[Markup] = []
    for model, content in models:
        name = f"{lead}{words.model(model)}"
        name = name[:1].upper() + name[1:]
        first = Markup("<h4>{}</h4>").format(name + behind) + stack(*content)
        parts.append(folded(name, *content) if parts else first)
    return stack(*parts)
