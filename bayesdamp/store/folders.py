"""Which files are a run's own: nothing else is ever replaced or removed, and nothing through a link."""

from __future__ import annotations

import json
import os
import stat
from collections.abc import Iterable, Iterator
from contextlib import suppress
from pathlib import Path
from typing import IO

from bayesdamp.store.beside import TEMPORARY, create
from bayesdamp.types import InputError

MARK = ".bayesdamp"
"""The file by which a folder is known as a run's."""
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


def claim(folder: Path, tables: Iterable[str] = ()) -> None:
    """Make a folder a run's, or know it as one: by its mark, or by its run.json.

    tables: names of further files that a run writes. Raises InputError where the folder holds something of such a name
    that no run wrote, or a link where a run's files belong; OSError where it cannot be written.
    """
    present = set(os.listdir(folder)) if os.path.lexists(folder) else set()
    if MARK not in present:
        taken = sorted(present & {*PLACES, *FILES, *tables})
        if taken and not _has_run(folder):
            what = f"holds {taken[0]!r}, which no run of bayesdamp wrote"
            raise InputError(f"{folder}: {what}; {_ELSEWHERE}, or move it away")
        with suppress(FileExistsError):
            create(folder / MARK, SIGNED.encode())
    if not _signed(folder / MARK):
        raise InputError(f"{folder / MARK}: is not the mark of a run; {_ELSEWHERE}, or remove it")
    for entry in (folder / name for name in sorted({*FILES, *tables} - {LOCK})):
        if (what := _special(entry)) is not None:
            raise InputError(
                f"{entry}: is {what}, where a run's own files belong; {_ELSEWHERE}, or remove it"
            )
    for place in PLACES:
        for entry in _entries(folder / place):
            if entry.is_symlink():
                raise InputError(
                    f"{entry}: is a link, where a run's own files belong; {_ELSEWHERE}, or remove it"
                )


def _signed(path: Path) -> bool:
    if not regular(path):
        return False
    with path.open("rb") as handle:
        return handle.read(len(SIGNED)) == SIGNED.encode()


def _has_run(folder: Path) -> bool:
    """Whether the folder holds a run's description, as a clone of a repository does, without the mark."""
    about = folder / "run.json"
    try:
        found = json.loads(about.read_bytes()) if regular(about) else None
    except (ValueError, RecursionError):
        return False
    return isinstance(found, dict) and {"name", "seed", "study"} <= found.keys()


def regular(path: Path) -> bool:
    """Whether there is a file, and it is neither a link nor a device."""
    try:
        return stat.S_ISREG(path.lstat().st_mode)
    except OSError:
        return False


def _entries(place: Path) -> Iterator[Path]:
    """A run's place with all that is below it; nothing beyond a link."""
    if not place.is_symlink() and not place.is_dir():
        return
    yield place
    for below, folders, files in os.walk(place, followlinks=False):
        yield from (Path(below, name) for name in (*folders, *files))


def sweep(folder: Path) -> None:
    """Remove what a killed run left half-written, known by its name."""
    top = (folder / name for name in os.listdir(folder))
    for path in (*top, *(entry for place in PLACES for entry in _entries(folder / place))):
        if TEMPORARY.fullmatch(path.name) and regular(path):
            path.unlink(missing_ok=True)


def remove_cells(folder: Path) -> None:
    """Remove the cells of a run; what else lies among them stays."""
    cells = folder / "cells"
    found = list(_entries(cells))
    if not _signed(folder / MARK) or any(path.is_symlink() for path in found):
        return
    for path in found:
        if path.suffix == ".npz" and _is_cell_of(cells, path):
            path.unlink(missing_ok=True)


def _is_cell_of(cells: Path, path: Path) -> bool:
    """Whether a file is the cell of its own name, also one that is cut off: both come first in it."""
    name = path.relative_to(cells).as_posix().removesuffix(".npz")
    begins = f'{CELL}{{"name": {json.dumps(name)},'.encode()
    if not regular(path):
        return False
    with path.open("rb") as handle:
        return handle.read(_ZIP + len(begins))[_ZIP:] == begins


def remove_listed(folder: Path, listed: Iterable[str]) -> None:
    """Remove files of these names from a folder that is no link; only regular ones, and none below or above it."""
    if folder.is_symlink():
        return
    for name in listed:
        path = folder / name
        if path.name == name and regular(path):
            path.unlink(missing_ok=True)


def open_lock(folder: Path) -> IO[str]:
    """The lock's file, to read and to write. Raises InputError where it is a link, a device or shared; OSError."""
    path = folder / LOCK
    if not os.path.lexists(path):
        path.touch()
    if not regular(path) or path.lstat().st_nlink > 1:
        raise InputError(f"{path}: is a link or no regular file; {_ELSEWHERE}, or remove it")
    return os.fdopen(os.open(path, os.O_RDWR | os.O_APPEND | os.O_NOFOLLOW | os.O_CLOEXEC), "a+")


def refuse_special(path: Path) -> None:
    """Refuse to replace what is no regular file. Raises InputError."""
    what = _special(path)
    if what is not None:
        raise InputError(f"{path}: is {what} and is not replaced; give a regular file or a new file's name")


def _special(path: Path) -> str | None:
    """What something is that is no regular file; None of one, and where there is nothing."""
    try:
        mode = path.lstat().st_mode
    except FileNotFoundError:
        return None
    if stat.S_ISREG(mode):
        return None
    kinds = ((stat.S_ISLNK, "a link"), (stat.S_ISDIR, "a folder"))
    return next((said for test, said in kinds if test(mode)), "a device")
