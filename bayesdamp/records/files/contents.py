"""What a reader finds in a file: columns of numbers, and the facts that stand beside them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Protocol

import numpy as np

from bayesdamp.provenance import Fact
from bayesdamp.units import UNITS


@dataclass(frozen=True, eq=False)
class Column:
    """One column, array or channel of a file.

    name: what a user types for it, one of its kind in the file; empty where the file gives none. values: shape (n,),
    NaN where a cell is empty or holds no number.
    group: the sheet, group or variable that it belongs to: only columns of one group go with one another's times.
    run: which of several runs of the file it belongs to, empty where the file does not say.
    unit: as the file writes it apart from the name. quantity: "angle", "velocity", "acceleration", or empty.
    rate: its own sampling rate in Hz, start: the time of its first sample in s, where the file says so.
    clock: whether its cells are written as times of day. empty: cells without anything, shape (n,), or None for none.
    words: what stands in the cells that hold no number, by row.
    """

    name: str
    values: np.ndarray
    group: str = ""
    run: str = ""
    unit: str = ""
    quantity: str = ""
    rate: float | None = None
    start: float = 0.0
    clock: bool = False
    empty: np.ndarray | None = None
    words: Mapping[int, str] = field(default_factory=dict)

    def __post_init__(self) -> None:
        # Half a letter (a lone surrogate) can be in a name of JSON, HDF5 or MATLAB, and be printed nowhere.
        object.__setattr__(self, "name", self.name.encode("utf-8", "replace").decode("utf-8"))

    @property
    def label(self) -> str:
        """The name with its unit."""
        unit = UNITS[self.unit].of(self.quantity) if self.unit in UNITS and self.quantity else self.unit
        return f"{self.name} ({unit})" if self.name and unit else self.name


@dataclass(frozen=True, eq=False)
class Contents:
    """All that a file holds.

    format: what it is, in a word or two. facts: what it says beside its columns, as it is written there.
    first_line: line of a text file (from 1) that holds the first row of numbers; lines: the line of each row, from 0
    at that one. warnings: what a user has to know of it. channels: whether the format says of its columns that each is
    a sensor's channel. paired: whether values stand beside times of their own, so that each is a record.
    """

    format: str
    columns: tuple[Column, ...]
    facts: Mapping[str, Fact] = field(default_factory=dict)
    notes: tuple[str, ...] = ()
    layout: Mapping[str, object] = field(default_factory=dict)
    first_line: int | None = None
    lines: np.ndarray | None = None
    channels: bool = False
    paired: bool = False
    warnings: tuple[str, ...] = ()


class Reader(Protocol):
    """A plug-in: one file format. A module in `bayesdamp.records.readers` binds one to the name PLUGIN and imports the
    format's library only in `read`; a user's is derived from this class and has a `name`.

    format: the format's name with its article, as in "this is an Excel file". extensions: small letters with the dot.
    extra: the extra of this package that its library comes with, empty where it always does.
    """

    format: str
    extensions: tuple[str, ...]
    extra: str = ""

    def claims(self, head: bytes, path: Path) -> bool:
        """Whether the first bytes (up to HEAD of them) show the file to be of this format."""
        ...

    def read(self, path: Path) -> Contents:
        """What the file holds. Raises InputError, or whatever its library raises on a damaged file."""
        ...
