"""Files that are written in one step, as bytes, JSON or archives: what fails leaves nothing behind."""

from __future__ import annotations

import errno
import io
import json
import math
import os
import re
import stat
import struct
import uuid
import zipfile
import zlib
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

import numpy as np

from bayesdamp.serial import split
from bayesdamp.types import InputError

SCHEMA = 1
"""Version of the tables, written in run.json: it goes up when a column is renamed, removed, or means something else."""
BROKEN = (
    zipfile.BadZipFile, zlib.error, struct.error, OSError, EOFError, KeyError, ValueError, TypeError, AttributeError,
    NotImplementedError, RuntimeError, OverflowError, MemoryError,
)  # fmt: skip
"""Exceptions that reading an archive raises when the file is damaged, cut off, or was not written here."""
TEMPORARY = re.compile(r"\.bayesdamp-[0-9a-f]{32}\.tmp")
_NO_ROOM = frozenset({errno.ENOSPC, errno.EDQUOT, errno.EFBIG, errno.EROFS})


def temporary_path(path: Path) -> Path:
    """Return a name in the same folder, under which a file is written before it is moved to its own name."""
    return path.with_name(f".bayesdamp-{uuid.uuid4().hex}.tmp")


def no_room(error: BaseException) -> bool:
    """Return whether the disk accepts no more data: a fault of the machine, not of a file or a computation."""
    return isinstance(error, OSError) and error.errno in _NO_ROOM


@contextmanager
def name_in_errors(path: Path) -> Iterator[None]:
    """Make an OSError name this file: on a full disk it names no file, or the temporary one."""
    try:
        yield
    except OSError as error:
        if error.errno is None:
            raise
        raise OSError(error.errno, error.strerror, str(path)) from error


@contextmanager
def _write_temporary(path: Path, content: bytes) -> Iterator[Path]:
    """Write the content under a temporary name, which the caller moves. On failure that file is removed again."""
    partial = temporary_path(path)
    try:
        with name_in_errors(path):
            path.parent.mkdir(parents=True, exist_ok=True)
            with partial.open("xb") as handle:
                handle.write(content)
                handle.flush()
                os.fsync(handle.fileno())
            yield partial
    except BaseException:
        with suppress(OSError):
            partial.unlink(missing_ok=True)
        raise


def create(path: Path, content: bytes) -> None:
    """Write a new file in one step. Raises FileExistsError where there is one already; OSError."""
    with _write_temporary(path, content) as partial:
        try:
            os.link(partial, path)
        except FileExistsError:
            raise
        except OSError:  # a disk without hard links
            if os.path.lexists(path):
                raise FileExistsError(errno.EEXIST, os.strerror(errno.EEXIST), str(path)) from None
            os.replace(partial, path)
        else:
            partial.unlink()


def special_kind(path: Path) -> str | None:
    """Return what a path is if it is not a regular file; None for a regular file, and where there is nothing."""
    try:
        mode = path.lstat().st_mode
    except FileNotFoundError:
        return None
    if stat.S_ISREG(mode):
        return None
    if stat.S_ISLNK(mode):
        return "a link"
    return "a folder" if stat.S_ISDIR(mode) else "a device"


def refuse_special(path: Path) -> None:
    """Refuse to replace anything but a regular file. Raises InputError."""
    kind = special_kind(path)
    if kind is not None:
        raise InputError(f"{path}: is {kind} and is not replaced; give a regular file or a new file's name")


def write_bytes(path: Path, content: bytes) -> None:
    """Replace a file in one step, once the content is on the disk. Creates the folders above it.

    Raises InputError where the name belongs to something other than a regular file.
    """
    path = Path(path)
    refuse_special(path)
    with _write_temporary(path, content) as partial:
        os.replace(partial, path)


def save_bytes(path: str | Path, content: bytes) -> Path:
    """Write a file for a user as `write_bytes` does, and return its path. Raises InputError where that fails."""
    path = Path(path)
    try:
        write_bytes(path, content)
    except OSError as error:
        raise InputError(f"{path}: cannot be written ({error.strerror or error})") from None
    return path


def write_json(path: Path, obj: object) -> None:
    """Write strict, indented JSON in one step; nan becomes null, infinities the words "inf" and "-inf"."""
    text = json.dumps(_strict(split(obj)), indent=2, ensure_ascii=False, allow_nan=False)
    write_bytes(path, (text + "\n").encode())


def _strict(value: object) -> object:
    if isinstance(value, dict):
        return {k: _strict(v) for k, v in value.items()}
    if isinstance(value, list):
        return [_strict(v) for v in value]
    if isinstance(value, float) and not math.isfinite(value):
        return None if math.isnan(value) else str(value)
    return value


def packed(
    first: str,
    head: Mapping[str, object],
    arrays: Mapping[str, np.ndarray],
    compression: int = zipfile.ZIP_STORED,
) -> bytes:
    """Return an archive of arrays, whose first member (named `first`) holds the values of `head` as JSON."""
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w", compression) as archive:
        archive.writestr(first, json.dumps(split({**head, "arrays": list(arrays)})))
        for i, array in enumerate(arrays.values()):
            with archive.open(f"{i}.npy", "w") as member:
                np.lib.format.write_array(member, np.asarray(array), allow_pickle=False)  # type: ignore[arg-type]
    return buffer.getvalue()


def unpacked(path: Path, first: str, *, arrays: bool = True) -> tuple[dict[str, Any], dict[str, np.ndarray]]:
    """Return the values and, unless they are not wanted, the arrays of an archive.

    Raises one of `BROKEN` for another file, or one that is cut off.
    """
    with zipfile.ZipFile(path) as archive:
        head = json.loads(archive.read(first))
        if not arrays:
            return head, {}
        # each member is read whole: only then is its checksum compared
        return head, {
            label: np.lib.format.read_array(io.BytesIO(archive.read(f"{i}.npy")), allow_pickle=False)
            for i, label in enumerate(head["arrays"])
        }


def read_description(folder: Path) -> dict[str, Any]:
    """Return the content of the run.json in a run's folder; any key may be missing.

    Raises InputError where there is no such file, where it is not JSON, and where another version of the tables wrote
    it.
    """
    path = folder / "run.json"
    if not path.is_file():
        raise InputError(f"{folder}: no run.json here; give the folder of a run, such as reports/<name>")
    try:
        description = json.loads(path.read_text(encoding="utf-8"))
    except (ValueError, OSError, RecursionError) as fault:
        raise InputError(f"{path}: cannot be read ({fault}); run the study again") from fault
    if not isinstance(description, dict):
        raise InputError(f"{path}: does not describe a run; run the study again")
    if description.get("schema", SCHEMA) != SCHEMA:
        raise InputError(f"{path}: was written by another version of bayesdamp; run the study again")
    return description
