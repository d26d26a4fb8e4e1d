"""What a reader returns for a file: its columns of numbers and the facts that it states. Limits on its size."""

from __future__ import annotations

import zipfile
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Protocol

import numpy as np

from bayesdamp.types import Fact, InputError
from bayesdamp.units import UNITS

LARGEST = 2**31
"""Bytes of a file, and bytes that it may unpack to (conventional)."""


@dataclass(frozen=True, eq=False)
class Column:
    """One column, array or channel of a file.

    Parameters
    ----------
    name
        What a user types to select the column, unique in the file; empty where the file gives no name.
    values
        Shape (n,), NaN where a cell is empty or does not hold a number.
    group
        The sheet, group or variable that it belongs to: a column uses only the times of its own group.
    run
        The run that it belongs to in a file of several; empty where the file does not say.
    unit
        As the file writes it outside the name.
    quantity
        "angle", "velocity", "acceleration", or empty.
    rate
        The column's own sampling rate in Hz, where the file states one.
    start
        Time of the first sample in s, where the file states one.
    clock
        Whether the cells are written as times of day.
    empty
        Which cells are empty, shape (n,); None where none is.
    words
        The text of the cells that do not hold a number, by row.
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
        # Half a letter (a lone surrogate) can occur in a name of JSON, HDF5 or MATLAB, and cannot be printed.
        object.__setattr__(self, "name", self.name.encode("utf-8", "replace").decode("utf-8"))

    @property
    def label(self) -> str:
        """The name with its unit."""
        unit = UNITS[self.unit].of(self.quantity) if self.unit in UNITS and self.quantity else self.unit
        return f"{self.name} ({unit})" if self.name and unit else self.name


@dataclass(frozen=True, eq=False)
class Contents:
    """All that a file contains.

    Parameters
    ----------
    format
        The format's name in a word or two.
    columns
        In the order of the file.
    facts
        What the file states outside its columns, as it is written there.
    notes
        Sentences on what the reader did.
    layout
        How a text is laid out, for run.json.
    first_line
        Line of a text file (from 1) with the first row of numbers.
    lines
        Line of each row, counted from 0 at `first_line`, shape (n,).
    channels
        Whether the format declares each column to be a sensor's channel.
    paired
        Whether columns of values have times of their own, so that each is a record.
    warnings
        Sentences that a user has to know.
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
    """A plug-in that reads one file format.

    A module in `bayesdamp.records.readers` binds a reader to the name PLUGIN and imports the format's library only in
    `read`. A user's reader derives from this class and has a `name`.

    format: the format's name with its article, as in "this is an Excel file". extensions: in small letters, with the
    dot. extra: the extra of this package that installs its library, empty where the library is always installed.
    """

    format: str
    extensions: tuple[str, ...]
    extra: str = ""

    def claims(self, head: bytes, path: Path) -> bool:
        """Return whether the first bytes, up to 64 KiB, show that the file is of this format."""
        ...

    def read(self, path: Path) -> Contents:
        """Return what the file contains. Raises InputError, or whatever its library raises on a damaged file."""
        ...


def refuse_large(size: float) -> None:
    """Raise InputError where data unpacks to more than LARGEST. size: in bytes."""
    if size > LARGEST:
        right = f"files of more than {LARGEST / 2**30:.3g} GiB are not read: give a part of it"
        raise InputError(f"unpacks to {size / 2**30:.3g} GiB; {right}")


def refuse_archive(path: Path) -> None:
    """Raise InputError where a zip archive is encrypted or too large, zipfile.BadZipFile where it is damaged."""
    with zipfile.ZipFile(path) as archive:
        members = archive.infolist()
    if any(member.flag_bits & 1 for member in members):
        raise InputError("is encrypted; save it without a password")
    refuse_large(sum(member.file_size for member in members))


def archive_names(path: Path) -> list[str] | None:
    """Return the names of a zip archive's members; None if it cannot be opened."""
    try:
        with zipfile.ZipFile(path) as archive:
            return archive.namelist()
    except (zipfile.BadZipFile, NotImplementedError, OSError):
        return None
