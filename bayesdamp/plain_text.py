"""Read small text files of the user."""

import errno
import stat
from pathlib import Path

from bayesdamp.types import InputError

MOST_BYTES = 2**24
"""Largest size in bytes of a file that is read; a larger one is refused (conventional)."""


def read_plain(path: Path, right: str) -> str:
    """Read a text file in UTF-8 and return its text, without a byte order mark.

    right: what the user should give instead of a wrong path, such as "a CSV file"; error messages say this. Raises
    InputError if the path is not a regular file in UTF-8 of at most `MOST_BYTES`, or cannot be read; the message does
    not name the path.
    """
    try:
        status = path.stat()
        if not stat.S_ISREG(status.st_mode) and not stat.S_ISDIR(status.st_mode):
            raise OSError(errno.EINVAL, "it is a device or a pipe, not a file")
        if status.st_size > MOST_BYTES:
            raise OSError(errno.EFBIG, f"it has more than {MOST_BYTES >> 20} MiB")
        return path.read_text(encoding="utf-8-sig")
    except FileNotFoundError:
        raise InputError(f"there is no such file; give {right}") from None
    except UnicodeDecodeError:
        raise InputError(f"it is not text in UTF-8; give {right}") from None
    except (OSError, ValueError) as error:
        what = getattr(error, "strerror", None) or str(error)
        raise InputError(f"it cannot be read: {what[:1].lower()}{what[1:]}; give {right}") from None


def at_home(path: Path) -> Path:
    """Return a path with a leading `~` or `~user` replaced by the home folder; unchanged if this is not known."""
    try:
        return path.expanduser()
    except RuntimeError:
        return path
