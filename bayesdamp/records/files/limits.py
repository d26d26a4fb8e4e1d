"""How much a file may hold: a small one can claim to be a very large one."""

from __future__ import annotations

import zipfile
from pathlib import Path

from bayesdamp.types import InputError

LARGEST = 2**31
"""Bytes of a file, and bytes that it may unpack to (conventional)."""


def allowed(size: float) -> None:
    """Refuse what is larger than LARGEST once unpacked. size: in bytes. Raises InputError."""
    if size > LARGEST:
        right = f"more than {LARGEST / 2**30:.3g} GiB are not read: give a part of it"
        raise InputError(f"unpacks to {size / 2**30:.3g} GiB; {right}")


def allowed_archive(path: Path) -> None:
    """Refuse a zip archive that is encrypted or unpacks to too much. Raises InputError and zipfile.BadZipFile."""
    with zipfile.ZipFile(path) as archive:
        members = archive.infolist()
    if any(member.flag_bits & 1 for member in members):
        raise InputError("is encrypted; save it without a password")
    allowed(sum(member.file_size for member in members))


def archive_names(path: Path) -> list[str] | None:
    """Return the names of a zip archive's members; None if it cannot be opened."""
    try:
        with zipfile.ZipFile(path) as archive:
            return archive.namelist()
    except (zipfile.BadZipFile, NotImplementedError, OSError):
        return None
