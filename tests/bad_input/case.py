"""A case of bad input: a file, a command on it, and its error message."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from tests.records import tables

T, Y = tables.T[:200], tables.Y[:200]
REFUSED, READ = 2, 0


def nothing(path: Path) -> None:
    """Write no file."""


@dataclass(frozen=True)
class Case:
    """A command that is refused, or that reads an unusual file.

    arguments: of the command, FILE for the file's path; write: makes the file; line: a part of the line on stderr;
    statuses: allowed exit statuses.
    """

    name: str
    arguments: tuple[str, ...]
    file: str = "a.csv"
    write: Callable[[Path], object] = nothing
    line: str = ""
    statuses: tuple[int, ...] = (REFUSED,)


def rows(
    path: Path, t: Callable[[int], object] = lambda i: T[i], y: Callable[[int], object] = lambda i: Y[i],
    n: int = T.size, head: str = "time,angle",
) -> None:  # fmt: skip
    """Write a table of times and values as text."""
    path.write_text("\n".join([head, *(f"{t(i)},{y(i)}" for i in range(n))]), encoding="utf-8")


def text(content: str) -> Callable[[Path], object]:
    """Return a function that writes this text."""
    return lambda path: path.write_text(content, encoding="utf-8")


def raw(content: bytes) -> Callable[[Path], object]:
    """Return a function that writes these bytes."""
    return lambda path: path.write_bytes(content)
