"""How a record was read, and what was done to it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, fields
from typing import Any, Self

Fact = str | float


@dataclass(frozen=True)
class FreeDecay:
    """One of the free decays of a record: start and stop in s of the record's own times."""

    start: float
    stop: float


@dataclass(frozen=True)
class Provenance:
    """How a record was read, and what was done to it.

    warnings: sentences that a user has to know of; notes: sentences on what was done; header_lines: how many were
    skipped. facts: what the file says beside its numbers. time_column, value_column: labels in the file; time_unit: who
    says the unit of the times, "given", "file", or nobody; first_line: line of the file (from 1) with the first row of
    numbers; constant_columns: what was left out. unit: of UNITS, in which the record came. start, stop: of what was
    kept, s of the record's own times; offset: what was taken off all values (unit of the signal's y); decays: all free
    decays of the record, the one that was kept among them. more: numbers and words that only run.json takes.
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
    def said(self) -> tuple[str, ...]:
        """What a user reads: warnings, how many header lines the file has, notes."""
        head = self.header_lines
        some = [f"Beware: {text}" for text in self.warnings]
        some += [f"{head} header line{'s' if head != 1 else ''} skipped."] if head else []
        return (*some, *self.notes)

    def to_dict(self) -> dict[str, Any]:
        """As run.json holds it: what is said of a record, `more` among it; `of` is the inverse."""
        found = asdict(self)
        always = {name: list(found.pop(name)) for name in ("warnings", "notes")}
        more = found.pop("more")
        return {**more, **{n: v for n, v in found.items() if v not in ((), {}, "", None)}, **always}

    @classmethod
    def of(cls, given: Mapping[str, Any]) -> Self:
        """The inverse of `to_dict`, after a file too."""
        own = {f.name for f in fields(cls)} - {"more"}
        found = {name: value for name, value in given.items() if name in own and value is not None}
        found |= {name: tuple(found.get(name, ())) for name in ("warnings", "notes", "constant_columns")}
        found["decays"] = tuple(FreeDecay(**decay) for decay in found.get("decays", ()))
        return cls(**found, more={name: value for name, value in given.items() if name not in own})
