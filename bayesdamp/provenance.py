"""The provenance of a record: how it was read, and what was done to it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, fields
from typing import Any, Self

from bayesdamp.serial import join

Fact = str | float


@dataclass(frozen=True)
class FreeDecay:
    """A free decay in a record: start and stop in s of the record's own times."""

    start: float
    stop: float


@dataclass(frozen=True)
class Provenance:
    """How a record was read, and what was done to it.

    warnings: sentences that a user must know; notes: sentences on what was done; header_lines: how many were skipped.
    facts: metadata in the file. time_column, value_column: labels in the file; time_unit: the source of the unit of the
    times, "given", "file", or empty; first_line: line of the file (from 1) with the first row of numbers;
    constant_columns: columns that were left out. unit: of the record, a name in UNITS. start, stop: of the part that is
    used, in s of the record's own times; offset: what was subtracted from all values (unit of the signal's y); decays:
    all free decays of the record, with the one that is used. more: numbers and words for run.json alone.
    """

    warnings: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()
    header_lines: int = 0
    facts: Mapping[str, Fact] = field(default_factory=dict)
    time_column: str = ""
    value_column: str = ""
    time_unit: str = ""
    first_line: int | None = None
    constant_columns: tuple[str, ...] = ()
    unit: str = ""
    start: float = 0.0
    stop: float | None = None
    offset: float = 0.0
    decays: tuple[FreeDecay, ...] = ()
    more: Mapping[str, Any] = field(default_factory=dict)

    @property
    def sentences(self) -> tuple[str, ...]:
        """Return the sentences for the user: warnings, the number of header lines, notes."""
        head = self.header_lines
        lines = [f"Beware: {text}" for text in self.warnings]
        lines += [f"{head} header line{'s' if head != 1 else ''} skipped."] if head else []
        return (*lines, *self.notes)

    def to_dict(self) -> dict[str, Any]:
        """Return it as in run.json, without empty fields; `of` is the inverse."""
        values = asdict(self)
        always = {name: list(values.pop(name)) for name in ("warnings", "notes")}
        more = values.pop("more")
        return {**more, **{n: v for n, v in values.items() if v not in ((), {}, "", None)}, **always}

    @classmethod
    def of(cls, given: Mapping[str, Any]) -> Self:
        """Return the provenance of which `to_dict` made this, also after it was a file."""
        own = {f.name for f in fields(cls)} - {"more"}
        values = {name: value for name, value in given.items() if name in own and value is not None}
        more = {name: value for name, value in given.items() if name not in own}
        return join(cls, {**values, "more": more})
