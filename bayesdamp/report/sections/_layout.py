"""What a section of the report is, and how sections show several signals and models."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence

from markupsafe import Markup

from bayesdamp.report import words
from bayesdamp.report.html import folded, paragraph, stack
from bayesdamp.report.results.answers import only_answered
from bayesdamp.report.results.run import Run

_OPEN = 4
_MOST = 4
"""Models of a signal that are drawn: what is less likely than so many others is in the tables."""


class Section(ABC):
    """One part of the report. It renders what the run holds and says what the run does not hold."""

    order: int
    """Sections are shown in the order of this number."""
    name: str
    """Anchor in the report; of a section of the package the name of its file."""
    title: str

    def __init_subclass__(cls) -> None:
        """Name a section of the package by its file."""
        package, _, file = cls.__module__.rpartition(".")
        if package == __package__ and not file.startswith("_"):
            cls.name = file

    def applies(self, run: Run) -> bool:
        """Return whether the report of this run has the section: by default every report."""
        return True

    @abstractmethod
    def render(self, run: Run) -> str:
        """Return the section's HTML, without its heading."""

    def place(self, run: Run) -> int:
        """Return the number that orders the sections of this run's report."""
        return self.order


class SignalSection(Section):
    """A section with a part for each signal that it applies to."""

    lead: str | Markup = ""
    """A sentence or two before the signals."""
    nothing = ""
    """What is said of a study that went beyond answers and has this for no signal; empty to leave the section out."""

    @abstractmethod
    def shows(self, run: Run, signal: str) -> bool:
        """Return whether the section has something on a signal."""

    @abstractmethod
    def part(self, run: Run, signal: str) -> Markup:
        """Return the content on a signal."""

    def applies(self, run: Run) -> bool:
        """Return whether the section has something on any signal, or has to say that it has not."""
        shown = any(self.shows(run, signal) for signal in run.signals)
        return shown or bool(self.nothing and run.signals and not only_answered(run))

    def render(self, run: Run) -> Markup:
        """Return the lead and the content on each signal."""
        wanted = [signal for signal in run.signals if self.shows(run, signal)]
        if not wanted and self.nothing:
            return paragraph(self.nothing)
        return stack(self.lead and paragraph(self.lead), by_signal(run, self.part, wanted))


def drawn(run: Run, place: int) -> bool:
    """Return whether to draw the model at this place of a ranking: the likeliest of few signals, the best of many."""
    return place == 0 or (place < _MOST and len(run.signals) <= _OPEN)


def by_signal(
    run: Run, part: Callable[[Run, str], Markup], wanted: Sequence[str], anchor: str = ""
) -> Markup:
    """Return the content of each signal under its name; from the fifth on behind a line that unfolds it.

    anchor: what the names of links to a signal begin with, where it may be linked to.
    """
    parts: list[Markup] = []
    for i, signal in enumerate(wanted):
        body = part(run, signal)
        heading = Markup("<h3>{}</h3>").format(signal) if len(wanted) > 1 else Markup("")
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
