"""The single files that commands write: what is there already stays, unless it is one of ours of that kind."""

from __future__ import annotations

import errno
import os
import re
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

from bayesdamp.types import InputError

FIRST_LINE = "# simulated by bayesdamp\n"
"""First line of a simulated record."""
GENERATOR = '<meta name="generator" content="bayesdamp look">'
"""In the head of a page of `bayesdamp look`."""
SIMULATED = re.compile(FIRST_LINE)
LOOK_PAGE = re.compile(rf"<!doctype html>(?:(?!</style>).)*{re.escape(GENERATOR)}", re.DOTALL)
CLAIMS_PAGE = re.compile(r"# The paper's claims, measured\n.*\nMade by `bayesdamp claims`\.", re.DOTALL)
"""How files begin that `bayesdamp simulate`, `look` and `claims` have written."""
_HEAD = 4096
"""Bytes of a file in which it says what it is."""


@dataclass(frozen=True)
class SingleFile:
    """A file that a command writes.

    ours: how one begins that was made by the same command, and may be replaced. option: by which it was named. inputs:
    files that the command reads.
    """

    path: Path
    ours: re.Pattern[str]
    option: str
    inputs: tuple[Path, ...] = ()

    def check(self) -> None:
        """Refuse what may not or cannot be written, before anything is computed for it. Raises InputError."""
        from bayesdamp.store.files import refuse_special

        try:
            above = next(filter(os.path.lexists, self.path.absolute().parents), None)  # `/` has none
            if above is not None and not above.is_dir():
                raise NotADirectoryError(errno.ENOTDIR, f"{above} is no folder")
            refuse_special(self.path)
        except OSError as error:
            raise self._refused(error) from None
        except InputError as error:
            raise InputError(f"{self.option} {error}") from None
        for other in self.inputs:
            with suppress(OSError):
                if self.path.samefile(other):
                    raise InputError(f"{self.option} {self.path}: is read by this command; give another name")
        if os.path.lexists(self.path):
            head = ""
            with suppress(OSError), self.path.open("rb") as handle:
                head = handle.read(_HEAD).decode("utf-8", "replace")
            if self.ours.match(head) is None:
                raise self._taken()

    def write(self, text: str) -> None:
        """Write it in one step, all of it or nothing. Raises InputError; OSError where the disk is full."""
        from bayesdamp.store.files import create, no_room, write_bytes

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
