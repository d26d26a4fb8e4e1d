"""A decay, and tables of text, for tests."""

from collections.abc import Iterable
from pathlib import Path

import numpy as np

T = np.arange(600) / 50
Y = 0.3 * np.exp(-0.1 * T) * np.cos(6 * T)


def write_lines(path: Path, lines: Iterable[str], encoding: str = "utf-8") -> Path:
    path.write_text("\n".join(lines) + "\n", encoding=encoding)
    return path


def write_table(path: Path, head: str, *columns: np.ndarray) -> Path:
    """Write columns with all their digits below a head of one or more lines, or without a head if it is empty."""
    rows = [",".join(map(str, row)) for row in zip(*(c.tolist() for c in columns), strict=True)]
    path.write_text("\n".join([head, *rows] if head else rows), encoding="utf-8")
    return path
