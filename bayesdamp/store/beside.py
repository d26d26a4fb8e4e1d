"""Content that is written beside its place and then moved there whole; what fails leaves nothing behind."""

from __future__ import annotations

import errno
import os
import re
import uuid
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

TEMPORARY = re.compile(r"\.bayesdamp-[0-9a-f]{32}\.tmp")
_NO_ROOM = frozenset({errno.ENOSPC, errno.EDQUOT, errno.EFBIG, errno.EROFS})


def temporary(path: Path) -> Path:
    """A name beside a file under which it is written before it is moved to its own."""
    return path.with_name(f".bayesdamp-{uuid.uuid4().hex}.tmp")


def no_room(error: BaseException) -> bool:
    """Whether the disk takes nothing more, whatever it is: the machine's fault, and that of no file or computation."""
    return isinstance(error, OSError) and error.errno in _NO_ROOM


@contextmanager
def beside(path: Path, content: bytes) -> Iterator[Path]:
    """The content on the disk under a name beside its own, for the caller to move.

    Creates the folders above it. On failure the name is gone again; an OSError names `path`.
    """
    partial = temporary(path)
    try:
        with naming(path):
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


@contextmanager
def naming(path: Path) -> Iterator[None]:
    """Let an OSError name the file that was meant: of a full disk it names none, or that beside."""
    try:
        yield
    except OSError as error:
        if error.errno is None:
            raise
        raise OSError(error.errno, error.strerror, str(path)) from error


def create(path: Path, content: bytes) -> None:
    """Write a file that is not there, in one step. Raises FileExistsError where one is; OSError."""
    with beside(path, content) as partial:
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
