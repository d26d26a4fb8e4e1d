"""What a section of the report is."""

from __future__ import annotations

from abc import ABC, abstractmethod

from bayesdamp.report.results.run import Run


class Section(ABC):
    """One part of the report. It renders what the run holds and says what the run does not hold."""

    order: int
    """Sections are shown in the order of this number."""
    name: str
    """Anchor in the report; the name of the section's file."""
    title: str

    @abstractmethod
    def applies(self, run: Run) -> bool:
        """Whether the report of this run has the section."""

    @abstractmethod
    def render(self, run: Run) -> str:
        """The section's HTML, without its heading."""
