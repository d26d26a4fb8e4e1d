"""The border to the terminal: one line that is short for whatever went wrong, and what the machine refused by name."""

from __future__ import annotations

import errno
import io
import os
import sys

LONGEST = 295
"""Characters of the one line on stderr."""
_HEAD = 180
_FULL = (errno.ENOSPC, errno.EDQUOT)
_STOPS = ("strict", "surrogateescape")
"""What a stream does with a character that it has not, where that is an error."""
_MEMORY = ("RESOURCE_EXHAUSTED", "Out of memory", "bad_alloc")


def one_line(text: object) -> str:
    """A text as one printable line; of a long one the middle is left out, so that the remedy at its end stays."""
    words = " ".join(str(text).split())
    line = "".join(c if c.isprintable() else c.encode("unicode_escape").decode("ascii") for c in words)
    if len(line) <= LONGEST:
        return line
    return f"{line[:_HEAD]}...{line[-(LONGEST - _HEAD - 3) :]}"


def refused_by_the_machine(error: BaseException) -> str | None:
    """What is said of a full disk, too little memory or a path that the system refuses; None of all else."""
    number = getattr(error, "errno", None)
    if (
        isinstance(error, MemoryError)
        or number == errno.ENOMEM
        or any(mark in str(error) for mark in _MEMORY)
    ):
        return (
            "too little memory for this; close other programs, give fewer --workers, or a part of the record"
        )
    if not isinstance(error, OSError) or error.errno is None:
        return None
    place = error.filename if isinstance(error.filename, str | bytes | os.PathLike) else None
    where = os.fsdecode(place) if place is not None else ""
    if error.errno in _FULL:
        return f"{where or 'the output'}: the disk is full; make room there, then run the same command again"
    if not where:
        return None
    return f"{where}: {(error.strerror or str(error)).lower()}; mend that, or give another path"


def present() -> None:
    """Give a process that was started without stdout or stderr ones that lead nowhere, before a file takes their
    place; let a stream replace what its encoding has not; and draw without a screen, whatever Matplotlib is told."""
    for name in ("stdout", "stderr"):
        stream = getattr(sys, name)
        if stream is None:
            setattr(sys, name, open(os.devnull, "w", encoding="utf-8"))  # noqa: SIM115 - until the process ends
        elif getattr(stream, "errors", "") in _STOPS and isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="replace")
    if not os.environ.get("COLUMNS", "1").strip("0"):
        del os.environ["COLUMNS"]  # a terminal of no width would be told nothing
    if "MPLBACKEND" in os.environ:
        os.environ["MPLBACKEND"] = "agg"


def say(line: str) -> None:
    """A line on stderr, or nowhere where nobody reads it."""
    try:
        print(line, file=sys.stderr, flush=True)
    except OSError:
        silence()


def silence() -> None:
    """Let what cannot be printed go nowhere, so that it is not tried again at the end: the output is closed or full."""
    for stream in (sys.stdout, sys.stderr):
        try:
            stream.flush()
        except OSError:
            nowhere = os.open(os.devnull, os.O_WRONLY)
            os.dup2(nowhere, stream.fileno())
            os.close(nowhere)
