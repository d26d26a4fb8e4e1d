"""The files of a run: nothing else in its folder is replaced or removed, and nothing through a link."""

from __future__ import annotations

import json
import os
import stat
from collections.abc import Iterable, Iterator
from contextlib import suppress
from pathlib import Path
from typing import IO

from bayesdamp.store.files import TEMPORARY, create, special_kind
from bayesdamp.types import InputError

MARK = ".bayesdamp"
"""The file that marks a folder as a run's."""
SIGNED = "bayesdamp run\n"
PLACES = ("cells", "figures", "posterior")
"""Folders of a run."""
LOCK = ".lock"
FILES = (LOCK, "damping_curves.csv", "report.html", "run.json", "verdict.json", "verdicts.csv")
CELL = "cell.json"
"""The first member of each cell's archive."""
_ZIP = 30
"""Bytes before a member's name in an archive."""
_ELSEWHERE = "choose another folder with --out"
_FOREIGN = f"where a run's own files belong; {_ELSEWHERE}, or remove it"


def claim(folder: Path, tables: Iterable[str] = ()) -> None:
    """Mark a folder as a run's, or check that it is one: by its mark, or by its run.json.

    Parameters
    ----------
    folder
        The run's folder, which need not exist.
    tables
        Names of further files that a run writes.

    Raises
    ------
    InputError
        The folder holds something of such a name that no run wrote, or a link where a run's files belong.
    OSError
        It cannot be written.
    """
    present = set(os.listdir(folder)) if os.path.lexists(folder) else set()
    if MARK not in present:
        taken = sorted(present & {*PLACES, *FILES, *tables})
        # A clone of a repository has a run's description without the mark.
        try:
            path = folder / "run.json"
            description = json.loads(path.read_bytes()) if is_regular(path) else None
        except (ValueError, RecursionError):
            description = None
        has_run = isinstance(description, dict) and {"name", "seed", "study"} <= description.keys()
        if taken and not has_run:
            what = f"holds {taken[0]!r}, which no run of bayesdamp wrote"
            raise InputError(f"{folder}: {what}; {_ELSEWHERE}, or move it away")
        with suppress(FileExistsError):
            create(folder / MARK, SIGNED.encode())
    if not _is_marked(folder):
        raise InputError(f"{folder / MARK}: is not the mark of a run; {_ELSEWHERE}, or remove it")
    for entry in (folder / name for name in sorted({*FILES, *tables} - {LOCK})):
        kind = special_kind(entry)
        if kind is not None:
            raise InputError(f"{entry}: is {kind}, {_FOREIGN}")
    for place in PLACES:
        for entry in _entries(folder / place):
            if entry.is_symlink():
                raise InputError(f"{entry}: is a link, {_FOREIGN}")


def _is_marked(folder: Path) -> bool:
    path = folder / MARK
    if not is_regular(path):
        return False
    with path.open("rb") as handle:
        return handle.read(len(SIGNED)) == SIGNED.encode()


def is_regular(path: Path) -> bool:
    """Return whether there is a file, and it is neither a link nor a device."""
    try:
        return stat.S_ISREG(path.lstat().st_mode)
    except OSError:
        return False


def _entries(place: Path) -> Iterator[Path]:
    """Iterate over one of a run's folders and all that is below it, but nothing beyond a link."""
    if not place.is_symlink() and not place.is_dir():
        return
    yield place
    for below, folders, files in os.walk(place, followlinks=False):
        yield from (Path(below, name) for name in (*folders, *files))


def sweep(folder: Path) -> None:
    """Remove the temporary files that a killed run left, which have a name of their own."""
    top = (folder / name for name in os.listdir(folder))
    for path in (*top, *(entry for place in PLACES for entry in _entries(folder / place))):
        if TEMPORARY.fullmatch(path.name) and is_regular(path):
            path.unlink(missing_ok=True)


def remove_cells(folder: Path) -> None:
    """Remove the cells of a run; other files among them stay."""
    cells = folder / "cells"
    entries = list(_entries(cells))
    if not _is_marked(folder) or any(path.is_symlink() for path in entries):
        return
    for path in entries:
        if path.suffix != ".npz" or not is_regular(path):
            continue
        # A cell's own name comes first in its file, also in one that is cut off.
        name = path.relative_to(cells).as_posix().removesuffix(".npz")
        beginning = f'{CELL}{{"name": {json.dumps(name)},'.encode()
        with path.open("rb") as handle:
            is_cell = handle.read(_ZIP + len(beginning))[_ZIP:] == beginning
        if is_cell:
            path.unlink(missing_ok=True)


def remove_listed(folder: Path, listed: Iterable[str]) -> None:
    """Remove the regular files of these names that are directly in a folder, unless the folder is a link."""
    if folder.is_symlink():
        return
    for name in listed:
        path = folder / name
        if path.name == name and is_regular(path):
            path.unlink(missing_ok=True)


def open_lock(folder: Path) -> IO[str]:
    """Open the lock's file to read and to write. Raises InputError where it is a link, a device or shared; OSError."""
    path = folder / LOCK
    if not os.path.lexists(path):
        path.touch()
    if not is_regular(path) or path.lstat().st_nlink > 1:
        raise InputError(f"{path}: is a link or not a regular file; {_ELSEWHERE}, or remove it")
    return os.fdopen(os.open(path, os.O_RDWR | os.O_APPEND | os.O_NOFOLLOW | os.O_CLOEXEC), "a+")
