"""Define what a reader returns for a file (columns of numbers and facts), the reader interface, and size limits."""

from __future__ import annotations

import zipfile
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Protocol

import numpy as np

from bayesdamp.types import Fact, InputError
from bayesdamp.units import UNITS

LARGEST_FILE = 2**31
"""Largest size of a file in bytes, also after unpacking; larger files are refused (conventional)."""


@dataclass(frozen=True, eq=False)
class Column:
    """One column, array or channel of a file.

    Parameters
    ----------
    name
        Name with which a user selects the column; "" if the file gives no name.
    values
        Values, shape (n,); NaN where a cell is empty or has no number.
    group
        Sheet, group or variable that contains the column. A column uses only the times of its own group.
    run
        Label of the run; "" if the file does not state it.
    unit
        Unit as the file writes it, if it is stated outside the name; else "".
    quantity
        "angle", "velocity", "acceleration", or "" if it is not stated.
    rate
        Sampling rate of the column in Hz; None if the file states none.
    start
        Time of the first sample in s; 0 if the file states none.
    clock
        Whether the cells are written as times of day.
    empty
        Mask of the empty cells, shape (n,); None if there are none.
    words
        Start of the text of each filled cell that has no number, by row from 0.
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
        # Names in JSON, HDF5 or MATLAB files can contain lone surrogates, which cannot be printed.
        object.__setattr__(self, "name", self.name.encode("utf-8", "replace").decode("utf-8"))

    @property
    def label(self) -> str:
        """Return the name with its unit in brackets, or the name alone if no unit is stated outside of it."""
        unit = UNITS[self.unit].of(self.quantity) if self.unit in UNITS and self.quantity else self.unit
        return f"{self.name} ({unit})" if self.name and unit else self.name


@dataclass(frozen=True, eq=False)
class Contents:
    """All that a file contains.

    Parameters
    ----------
    format
        Short name of the format.
    columns
        Columns in the order of the file.
    facts
        Numbers and texts that the file states outside its columns, by name.
    notes
        Sentences on what the reader did.
    first_line
        Line number (from 1) of the first row of numbers in a text file.
    lines
        Line of each row, shape (n,), counted from 0 at `first_line`.
    channels
        Whether the format declares each column to be a sensor's channel.
    paired
        Whether columns of values have their own times, so that each is a record.
    warnings
        Sentences that the user must see.
    """

    format: str
    columns: tuple[Column, ...]
    facts: Mapping[str, Fact] = field(default_factory=dict)
    notes: tuple[str, ...] = ()
    first_line: int | None = None
    lines: np.ndarray | None = None
    channels: bool = False
    paired: bool = False
    warnings: tuple[str, ...] = ()


class Reader(Protocol):
    """A plug-in that reads one file format.

    A module in `bayesdamp.records.readers` assigns a reader to the name PLUGIN and imports the library of the format
    only in `read`. A user's reader derives from this class and has a `name`.

    format: name of the format with its article, as in "this is an Excel file". extensions: file extensions in small
    letters, with the dot. extra: the extra of this package that installs the library; "" if it is always installed.
    foreign: whether `read` uses a compiled library, which a damaged file may crash: it then runs in a child process.
    """

    format: str
    extensions: tuple[str, ...]
    extra: str = ""
    foreign: bool = False

    def claims(self, head: bytes, path: Path) -> bool:
        """Return whether the file is of this format.

        This is decided by its first bytes, `head` (up to 64 KiB), and by its path if they are not enough.
        """
        ...

    def read(self, path: Path) -> Contents:
        """Return the contents of the file. May raise any exception for a damaged file; `opening` reports it."""
        ...


def refuse_large(size: float) -> None:
    """Raise InputError if `size`, the unpacked size in bytes, is more than LARGEST_FILE."""
    if size > LARGEST_FILE:
        right = f"files of more than {LARGEST_FILE / 2**30:.3g} GiB are not read: give a part of it"
        raise InputError(f"unpacks to {size / 2**30:.3g} GiB; {right}")


def refuse_archive(path: Path) -> None:
    """Raise InputError if a zip archive is encrypted or unpacks to more than LARGEST_FILE bytes.

    Raises zipfile.BadZipFile if it is damaged.
    """
    with zipfile.ZipFile(path) as archive:
        members = archive.infolist()
    if any(member.flag_bits & 1 for member in members):
        raise InputError("is encrypted; save it without a password")
    refuse_large(sum(member.file_size for member in members))


def archive_names(path: Path) -> list[str] | None:
    """Return the names of a zip archive's members; None if it cannot be opened or is not a zip archive."""
    try:
        with zipfile.ZipFile(path) as archive:
            return archive.namelist()
    except (zipfile.BadZipFile, NotImplementedError, OSError):
        return None
