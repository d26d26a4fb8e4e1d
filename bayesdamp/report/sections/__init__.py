"""The parts of a report, one file each."""

from bayesdamp.plugins import Registry
from bayesdamp.report.results.run import Run
from bayesdamp.report.sections._layout import Section

SECTIONS: Registry[Section] = Registry("bayesdamp.report.sections", "section")


def in_order(run: Run) -> list[Section]:
    """Return the sections of a run's report, in their order."""
    found = (section for name in SECTIONS.names() if (section := SECTIONS.get(name)).applies(run))
    return sorted(found, key=lambda section: section.place(run))


__all__ = ["SECTIONS", "Section", "in_order"]
