"""Print errors as one short line, and name what the machine refuses."""

from __future__ import annotations

import errno
import io
import os
import sys

LONGEST = 295
"""Characters of the line on stderr."""
_HEAD = 180
_FULL = (errno.ENOSPC, errno.EDQUOT)
_STOPS = ("strict", "surrogateescape")
"""Error handlers of a stream that fail for a character which its encoding lacks."""
_MEMORY = ("RESOURCE_EXHAUSTED", "Out of memory", "bad_alloc")


def one_line(text: object) -> str:
    """Return a text as one printable line, without the middle of a long one, so that the remedy at its end stays."""
    words = " ".join(str(text).split())
    line = "".join(c if c.isprintable() else c.encode("unicode_escape").decode("ascii") for c in words)
    if len(line) <= LONGEST:
        return line
    return f"{line[:_HEAD]}...{line[-(LONGEST - _HEAD - 3) :]}"


def machine_refusal(error: BaseException) -> str | None:
    """Return a line on a full disk, too little memory or a path that the system refuses; None for other errors."""
    number = getattr(error, "errno", None)
    if (
        isinstance(error, MemoryError)
        or number == errno.ENOMEM
        or any(mark in str(error) for mark in _MEMORY)
    ):
        return (
            "too little memory for this; close other programs, use fewer --workers, or a part of the record"
        )
    if not isinstance(error, OSError) or error.errno is None:
        return None
    place = error.filename if isinstance(error.filename, str | bytes | os.PathLike) else None
    where = os.fsdecode(place) if place is not None else ""
    if error.errno in _FULL:
        return f"{where or 'the output'}: the disk is full; make room there, then run the same command again"
    if not where:
        return None
    return f"{where}: {(error.strerror or str(error)).lower()}; correct that, or give another path"


def prepare_streams() -> None:
    """Prepare stdout, stderr and drawing for every environment.

    A process that was started without stdout or stderr gets ones that lead nowhere, before a file takes their place.
    Streams replace characters that their encoding lacks. Matplotlib draws without a screen.
    """
    for name in ("stdout", "stderr"):
        stream = getattr(sys, name)
        if stream is None:
            setattr(sys, name, open(os.devnull, "w", encoding="utf-8"))  # noqa: SIM115 - until the process ends
        elif getattr(stream, "errors", "") in _STOPS and isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="replace")
    if not os.environ.get("COLUMNS", "1").strip("0"):
        del os.environ["COLUMNS"]  # nothing would be printed on a terminal without a width
    if "MPLBACKEND" in os.environ:
        os.environ["MPLBACKEND"] = "agg"


def print_error(line: str) -> None:
    """Print a line on stderr, or nowhere where nobody reads it."""
    try:
        print(line, file=sys.stderr, flush=True)
    except OSError:
        discard_output()


def discard_output() -> None:
    """Discard what a closed or full output cannot take, so that the process does not try it again at its end."""
    for stream in (sys.stdout, sys.stderr):
        try:
            stream.flush()
        except OSError:
            nowhere = os.open(os.devnull, os.O_WRONLY)
            os.dup2(nowhere, stream.fileno())
            os.close(nowhere)
