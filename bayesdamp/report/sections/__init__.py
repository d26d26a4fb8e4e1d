"""The parts of a report, one file each."""

from bayesdamp.plugins import Registry
from bayesdamp.report.sections._section import Section

SECTIONS: Registry[Section] = Registry("bayesdamp.report.sections", "section")


def in_order() -> list[Section]:
    """All sections, in the order of the report."""
    return sorted((SECTIONS.get(name) for name in SECTIONS.names()), key=lambda section: section.order)


__all__ = ["SECTIONS", "Section", "in_order"]
