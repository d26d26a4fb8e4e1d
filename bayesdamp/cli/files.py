"""Check the files and folders that a command reads or writes.

A command overwrites a file only if an earlier run of the same command wrote it.
"""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path

from bayesdamp.store.files import refuse_special
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


def check_replaceable(path: Path, first_line: str) -> None:
    """Raise InputError if a path exists but is not a regular file that begins with `first_line`."""
    refuse_special(path)
    if path.exists():
        with path.open("rb") as handle:
            head = handle.read(len(first_line))
        if head != first_line.encode():
            what = "already exists and was not made by bayesdamp"
            raise InputError(f"--out {path}: {what}; give another name, or remove it")
