"""Read small text files of the user."""

from __future__ import annotations

import errno
import stat
from pathlib import Path

from bayesdamp.types import InputError

LARGEST = 2**24
"""Largest size of such a file in bytes (conventional)."""


def read_plain(path: Path, right: str) -> str:
    """Return the text of a file in UTF-8.

    right: what to give instead, for error messages. Raises InputError if it is not a regular file in UTF-8 of at most
    LARGEST bytes.
    """
    try:
        status = path.stat()
        if not stat.S_ISREG(status.st_mode) and not stat.S_ISDIR(status.st_mode):
            raise OSError(errno.EINVAL, "is a device or a pipe, not a file")
        if status.st_size > LARGEST:
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
    """Return a path with `~` expanded; unchanged if there is no such home folder."""
    try:
        return path.expanduser()
    except RuntimeError:
        return path
