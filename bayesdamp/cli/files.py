"""Check the files and folders that a command reads or writes.

A command overwrites a file only if an earlier run of the same command wrote it.
"""

from __future__ import annotations

import errno
import os
import re
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

from bayesdamp.store.files import create, is_disk_full, refuse_special, write_bytes
from bayesdamp.types import InputError


def check_folder(out: Path | None, name: str) -> Path:
    """Return the folder of a run: `out`, or reports/`name` if `out` is None. The folder is not created.

    Raises
    ------
    InputError
        If the path, or the nearest folder above it that exists, is not a folder, or if the operating system refuses the
        path.
    """
    folder, where = Path("reports") / name, "the results would be written to"
    right = "give another folder with --out"
    if out is not None:
        folder, where, right = out, "--out: is", "it must be a folder, or a new name"
    where = f"{where} {str(folder)!r}"
    try:
        os.lstat(folder)
    except (FileNotFoundError, NotADirectoryError):
        pass
    except OSError as error:
        what = (error.strerror or str(error)).lower()
        raise InputError(f"{where}, {what}; {right}") from None
    present = next(place for place in (folder, *folder.absolute().parents) if os.path.lexists(place))
    if not present.is_dir():
        raise InputError(f"{where}, and {present} is not a folder; {right}")
    return folder


def check_names(paths: Sequence[Path]) -> None:
    """Raise InputError if a file name is not valid UTF-8, because run.json must contain the names of its inputs."""
    for path in paths:
        try:
            str(path).encode()
        except UnicodeEncodeError:
            raise InputError(f"{path}: the file name is not valid UTF-8; rename the file") from None


FIRST_LINE = "# simulated by bayesdamp\n"
"""First line of a simulated record."""
SIMULATED = re.compile(FIRST_LINE)
CLAIMS_PAGE = re.compile(r"# The paper's claims, measured\n.*\nMade by `bayesdamp claims`\.", re.DOTALL)
"""`SIMULATED` and `CLAIMS_PAGE` are patterns that match the beginning of a file that `bayesdamp simulate` or `claims`
has written. Such a file may be overwritten by the same command."""
_HEAD_BYTES = 4096
"""Number of bytes at the beginning of a file that are compared with its pattern, such as `SIMULATED`."""


@dataclass(frozen=True)
class SingleFile:
    """A file that a command writes.

    Attributes
    ----------
    path
        Path of the file.
    ours
        Pattern for the beginning of a file that the same command wrote, and that may be replaced.
    option
        The option with which the user names the file, for errors.
    inputs
        Files that the command reads, which must not be replaced.
    """

    path: Path
    ours: re.Pattern[str]
    option: str
    inputs: tuple[Path, ...] = ()

    def check(self) -> None:
        """Raise InputError if the file must not or cannot be written; to be called before anything is computed.

        It must not be written if it is an input or not a regular file, or if it exists and `ours` does not match it.
        """
        try:
            above = next(filter(os.path.lexists, self.path.absolute().parents), None)  # `/` has none
            if above is not None and not above.is_dir():
                raise NotADirectoryError(errno.ENOTDIR, f"{above} is not a folder")
            refuse_special(self.path)
        except OSError as error:
            raise self._refused(error) from None
        except InputError as error:
            raise InputError(f"{self.option} {error}") from None
        for other in self.inputs:
            with suppress(OSError):
                if self.path.samefile(other):
                    raise InputError(
                        f"{self.option} {self.path}: is an input of this command; give another name"
                    )
        if os.path.lexists(self.path):
            head = ""
            with suppress(OSError), self.path.open("rb") as handle:
                head = handle.read(_HEAD_BYTES).decode("utf-8", "replace")
            if self.ours.match(head) is None:
                raise self._taken()

    def write(self, text: str) -> None:
        """Check the file (`check`) and write it. An interrupted write leaves no incomplete file.

        Raises
        ------
        InputError
            If the file is an input or was not written by this command, or if it cannot be written.
        OSError
            If the disk is full.
        """
        self.check()
        write = write_bytes if os.path.lexists(self.path) else create
        try:
            write(self.path, text.encode(errors="replace"))
        except FileExistsError:
            raise self._taken() from None
        except OSError as error:
            if is_disk_full(error):
                raise
            raise self._refused(error) from None

    def _taken(self) -> InputError:
        """Return the error for a file that exists and that the command did not write."""
        what = "already exists and was not made by bayesdamp"
        return InputError(f"{self.option} {self.path}: {what}; give another name, or remove it")

    def _refused(self, error: OSError) -> InputError:
        """Return the error for a file that the operating system does not let us write."""
        what = error.strerror or str(error)
        what = what if error.errno == errno.ENOTDIR else what.lower()
        return InputError(f"{self.option} {self.path}: cannot be written: {what}; give a new file's name")
