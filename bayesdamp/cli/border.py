"""Print errors as one short line, explain errors of the operating system, and prepare the output streams."""

import errno
import io
import os
import sys

LONGEST_ERROR = 295
"""Largest number of characters of an error line; of a longer line the middle is left out (conventional: three lines of
a terminal)."""
_HEAD_LENGTH = 180
"""Number of characters from the beginning of an error that remain if its middle is left out."""
_DISK_FULL = (errno.ENOSPC, errno.EDQUOT)
"""Error numbers of a full disk."""
_STRICT_HANDLERS = ("strict", "surrogateescape")
"""Error handlers of a stream that raise an exception for a character that the stream cannot encode."""
_MEMORY_TEXTS = ("RESOURCE_EXHAUSTED", "Out of memory", "bad_alloc")
"""Texts by which libraries report too little memory."""


def printable(text: str) -> str:
    """Return a text as one printable line, in which unprintable characters are escaped."""
    return "".join(c if c.isprintable() else c.encode("unicode_escape").decode("ascii") for c in text)


def one_line(text: object) -> str:
    """Return a text as one printable line of at most `LONGEST_ERROR` characters.

    White space becomes single spaces, and other unprintable characters are escaped. The middle of a longer text is
    replaced by "...", because the end of an error usually contains the remedy. `text` is converted by `str`.
    """
    line = printable(" ".join(str(text).split()))
    if len(line) <= LONGEST_ERROR:
        return line
    return f"{line[:_HEAD_LENGTH]}...{line[-(LONGEST_ERROR - _HEAD_LENGTH - 3) :]}"


def machine_refusal(error: BaseException) -> str | None:
    """Return a line that explains an error of the machine, and what the user can do; None for other errors.

    Errors of the machine are too little memory, a full disk, and an OSError with the path of a file.
    """
    if (
        isinstance(error, MemoryError)
        or getattr(error, "errno", None) == errno.ENOMEM
        or any(mark in str(error) for mark in _MEMORY_TEXTS)
    ):
        return "not enough memory; close other programs, use fewer --workers, or use a part of the record"
    if not isinstance(error, OSError) or error.errno is None:
        return None
    where = os.fsdecode(error.filename) if isinstance(error.filename, str | bytes | os.PathLike) else ""
    if error.errno in _DISK_FULL:
        return f"{where or 'the output'}: the disk is full; make room there, then run the same command again"
    if not where:
        return None
    return f"{where}: {(error.strerror or str(error)).lower()}; correct that, or give another path"


def prepare_streams() -> None:
    """Prepare stdout, stderr and drawing for every environment.

    If the process was started without stdout or stderr, they are opened on the null device; otherwise the next opened
    file would get their file descriptors. Streams replace characters that they cannot encode. If the environment
    variable MPLBACKEND is set, it becomes "agg", with which Matplotlib needs no screen. COLUMNS is deleted if it is 0
    or empty.
    """
    for name in ("stdout", "stderr"):
        stream = getattr(sys, name)
        if stream is None:
            setattr(sys, name, open(os.devnull, "w", encoding="utf-8"))  # noqa: SIM115 - until the process ends
        elif getattr(stream, "errors", "") in _STRICT_HANDLERS and isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="replace")
    if not os.environ.get("COLUMNS", "1").strip("0"):
        del os.environ["COLUMNS"]  # Rich would print nothing on a terminal of width 0
    if "MPLBACKEND" in os.environ:
        os.environ["MPLBACKEND"] = "agg"


def print_error(line: str) -> None:
    """Print a line on stderr; if stderr is closed, discard the line."""
    try:
        print(line, file=sys.stderr, flush=True)
    except OSError:
        discard_output()


def discard_output() -> None:
    """Flush stdout and stderr, and redirect a stream for which this fails to the null device.

    Python would otherwise try to write the buffered output again at exit.
    """
    for stream in (sys.stdout, sys.stderr):
        try:
            stream.flush()
        except OSError:
            nowhere = os.open(os.devnull, os.O_WRONLY)
            os.dup2(nowhere, stream.fileno())
            os.close(nowhere)
