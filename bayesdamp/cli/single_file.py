"""The single files that commands write: what is there already stays, unless it is one of ours of that kind."""

from __future__ import annotations

import errno
import os
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from bayesdamp.types import InputError

SIMULATED = "# simulated by bayesdamp"
"""First line of a simulated record."""
PAGE = '<meta name="generator" content="bayesdamp look">'
"""In the head of a page of `bayesdamp look`."""
_HEAD = 4096
"""Bytes of a file in which it says what it is."""


def is_simulated(head: str) -> bool:
    """Whether a file that begins so is a record of `bayesdamp simulate`."""
    return head.startswith(f"{SIMULATED}\n")


def is_page(head: str) -> bool:
    """Whether it is a page of `bayesdamp look`."""
    return head.startswith("<!doctype html>") and PAGE in head.partition("</style>")[0]


def is_claims(head: str) -> bool:
    """Whether it is the page of `bayesdamp claims`."""
    return head.startswith("# The paper's claims, measured\n") and "\nMade by `bayesdamp claims`." in head


@dataclass(frozen=True)
class SingleFile:
    """A file that a command writes.

    ours: whether one that begins so was made by the same command, and may be replaced. option: by which it was named.
    inputs: files that the command reads.
    """

    path: Path
    ours: Callable[[str], bool]
    option: str
    inputs: tuple[Path, ...] = ()

    def check(self) -> None:
        """Refuse what may not or cannot be written, before anything is computed for it. Raises InputError."""
        from bayesdamp.store.folders import refuse_special

        try:
            above = next(filter(os.path.lexists, self.path.absolute().parents), None)  # `/` has none
            if above is not None and not above.is_dir():
                raise NotADirectoryError(errno.ENOTDIR, f"{above} is no folder")
            refuse_special(self.path)
        except OSError as error:
            raise self._refused(error) from None
        except InputError as error:
            raise InputError(f"{self.option} {error}") from None
        if any(_same(self.path, one) for one in self.inputs):
            raise InputError(f"{self.option} {self.path}: is read by this command; give another name")
        if os.path.lexists(self.path) and not self.ours(_head(self.path)):
            raise self._taken()

    def write(self, text: str) -> None:
        """Write it in one step, all of it or nothing. Raises InputError; OSError where the disk is full."""
        from bayesdamp.store.beside import create, no_room
        from bayesdamp.store.files import write_bytes

        self.check()
        write = write_bytes if os.path.lexists(self.path) else create
        try:
            write(self.path, text.encode(errors="replace"))
        except FileExistsError:
            raise self._taken() from None
        except OSError as error:
            if no_room(error):
                raise
            raise self._refused(error) from None

    def _taken(self) -> InputError:
        what = "is there already and was not made by bayesdamp"
        return InputError(f"{self.option} {self.path}: {what}: give another name, or remove it")

    def _refused(self, error: OSError) -> InputError:
        what = error.strerror or str(error)
        what = what if error.errno == errno.ENOTDIR else what.lower()
        return InputError(f"{self.option} {self.path}: cannot be written: {what}; give a new file's name")


def _same(one: Path, other: Path) -> bool:
    try:
        return one.samefile(other)
    except OSError:
        return False


def _head(path: Path) -> str:
    try:
        with path.open("rb") as handle:
            return handle.read(_HEAD).decode("utf-8", "replace")
    except OSError:
        return ""
