"""Small text files of the user: read whole, and only where they are plain files."""

from __future__ import annotations

import errno
import stat
from pathlib import Path

LARGEST = 2**24
"""Bytes of such a file (conventional)."""


def read_plain(path: Path) -> str:
    """A file's text in UTF-8.

    Raises OSError for all that is no plain file, is larger than LARGEST or has a name that no file has, and
    UnicodeDecodeError.
    """
    try:
        found = path.stat()
    except ValueError as error:
        raise OSError(errno.EINVAL, str(error)) from None
    if not stat.S_ISREG(found.st_mode) and not stat.S_ISDIR(found.st_mode):
        raise OSError(errno.EINVAL, "is a device or a pipe, no file")
    if found.st_size > LARGEST:
        raise OSError(errno.EFBIG, f"has more than {LARGEST >> 20} MiB")
    return path.read_text(encoding="utf-8-sig")


def at_home(path: Path) -> Path:
    """A path whose `~` is written out, or as it is where there is no such home."""
    try:
        return path.expanduser()
    except RuntimeError:
        return path
