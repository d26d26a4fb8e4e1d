"""Limits on the size of files: a small one can claim to unpack to a very large one."""

from __future__ import annotations

import zipfile
from pathlib import Path

from bayesdamp.types import InputError

LARGEST = 2**31
"""Bytes of a file, and bytes that it may unpack to (conventional)."""


def refuse_large(size: float) -> None:
    """Raise InputError where data unpacks to more than LARGEST. size: in bytes."""
    if size > LARGEST:
        right = f"files of more than {LARGEST / 2**30:.3g} GiB are not read: give a part of it"
        raise InputError(f"unpacks to {size / 2**30:.3g} GiB; {right}")


def refuse_archive(path: Path) -> None:
    """Raise InputError where a zip archive is encrypted or too large, zipfile.BadZipFile where it is damaged."""
    with zipfile.ZipFile(path) as archive:
        members = archive.infolist()
    if any(member.flag_bits & 1 for member in members):
        raise InputError("is encrypted; save it without a password")
    refuse_large(sum(member.file_size for member in members))


def archive_names(path: Path) -> list[str] | None:
    """Return the names of a zip archive's members; None if it cannot be opened."""
    try:
        with zipfile.ZipFile(path) as archive:
            return archive.namelist()
    except (zipfile.BadZipFile, NotImplementedError, OSError):
        return None
