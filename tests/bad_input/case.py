"""What a case of bad input is: a file to make, a command on it, and what is to be said of it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

T = np.arange(200) / 50
Y = 0.3 * np.exp(-0.1 * T) * np.cos(6 * T)
REFUSED, READ = 2, 0


def nothing(path: Path) -> None:
    """No file at all."""


@dataclass(frozen=True)
class Case:
    """A command that is refused, or that reads a damaged file rightly.

    arguments: of the command, FILE for the file's path; write: makes the file; said: a part of the one line on stderr;
    ends: exit statuses that are right.
    """

    name: str
    arguments: tuple[str, ...]
    file: str = "a.csv"
    write: Callable[[Path], object] = nothing
    said: str = ""
    ends: tuple[int, ...] = (REFUSED,)


def rows(
    path: Path, t: Callable[[int], object] = lambda i: T[i], y: Callable[[int], object] = lambda i: Y[i],
    n: int = T.size, head: str = "time,angle",
) -> None:  # fmt: skip
    """A table of times and values as text."""
    path.write_text("\n".join([head, *(f"{t(i)},{y(i)}" for i in range(n))]), encoding="utf-8")


def text(content: str) -> Callable[[Path], object]:
    """A writer of one text."""
    return lambda path: path.write_text(content, encoding="utf-8")


def raw(content: bytes) -> Callable[[Path], object]:
    """A writer of bytes."""
    return lambda path: path.write_bytes(content)
