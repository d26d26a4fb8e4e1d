"""Files written in one step, as bytes or as JSON."""

from __future__ import annotations

import io
import json
import math
import os
import struct
import zipfile
import zlib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from bayesdamp.serial import split
from bayesdamp.store import folders
from bayesdamp.store.beside import beside
from bayesdamp.types import InputError

SCHEMA = 1
"""Version of the tables, written in run.json: it goes up when a column is renamed, removed, or means something else."""
BROKEN = (
    zipfile.BadZipFile, zlib.error, struct.error, OSError, EOFError, KeyError, ValueError, TypeError, AttributeError,
    NotImplementedError, RuntimeError, OverflowError, MemoryError,
)  # fmt: skip
"""What reading an archive raises that was not written here, or not to its end."""


def write_bytes(path: Path, content: bytes) -> None:
    """Replace a file in one step, and only once the content is on the disk. Creates the folders above it.

    Raises InputError where something else than a regular file has the name.
    """
    path = Path(path)
    folders.refuse_special(path)
    with beside(path, content) as partial:
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
    """Return an archive of values as JSON, its first member under that name, and of arrays."""
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w", compression) as archive:
        archive.writestr(first, json.dumps(split({**head, "arrays": list(arrays)})))
        for i, array in enumerate(arrays.values()):
            with archive.open(f"{i}.npy", "w") as member:
                np.lib.format.write_array(member, np.asarray(array), allow_pickle=False)  # type: ignore[arg-type]
    return buffer.getvalue()


def unpacked(path: Path, first: str) -> tuple[dict[str, Any], dict[str, np.ndarray]]:
    """Return what `packed` was given. Raises one of `BROKEN` for another file, or one that is cut off."""
    with zipfile.ZipFile(path) as archive:
        head = json.loads(archive.read(first))
        # each member is read whole: only then is its checksum compared
        return head, {
            label: np.lib.format.read_array(io.BytesIO(archive.read(f"{i}.npy")), allow_pickle=False)
            for i, label in enumerate(head["arrays"])
        }


def read_description(folder: Path) -> dict[str, Any]:
    """Return what run.json says of the run in a folder; any key may be missing.

    Raises InputError where there is none, where it is not JSON, and where another version of the tables wrote it.
    """
    path = folder / "run.json"
    if not path.is_file():
        raise InputError(f"{folder}: no run.json here; give the folder of a run, such as reports/<name>")
    try:
        found = json.loads(path.read_text(encoding="utf-8"))
    except (ValueError, OSError, RecursionError) as fault:
        raise InputError(f"{path}: cannot be read ({fault}); run the study again") from fault
    if not isinstance(found, dict):
        raise InputError(f"{path}: holds no description of a run; run the study again")
    if found.get("schema", SCHEMA) != SCHEMA:
        raise InputError(f"{path}: was written by another version of bayesdamp; run the study again")
    return found
