"""Small text files of the user: read whole, and only where they are plain files."""

from __future__ import annotations

import errno
import stat
from pathlib import Path

from bayesdamp.types import InputError

LARGEST = 2**24
"""Bytes of such a file (conventional)."""


def read_plain(path: Path, right: str) -> str:
    """Return a file's text in UTF-8.

    right: what to give in its place where it cannot be read. Raises InputError for all that is not a plain file in
    UTF-8, is larger than LARGEST or has a name that no file has.
    """
    try:
        found = path.stat()
        if not stat.S_ISREG(found.st_mode) and not stat.S_ISDIR(found.st_mode):
            raise OSError(errno.EINVAL, "is a device or a pipe, no file")
        if found.st_size > LARGEST:
            raise OSError(errno.EFBIG, f"has more than {LARGEST >> 20} MiB")
        return path.read_text(encoding="utf-8-sig")
    except FileNotFoundError:
        raise InputError(f"there is no such file; give {right}") from None
    except UnicodeDecodeError:
        raise InputError(f"is not text in UTF-8; give {right}") from None
    except (OSError, ValueError) as error:
        what = getattr(error, "strerror", None) or str(error)
        raise InputError(f"cannot be read: {what.lower()}; give {right}") from None


def at_home(path: Path) -> Path:
    """A path whose `~` is written out, or as it is where there is no such home."""
    try:
        return path.expanduser()
    except RuntimeError:
        return path
