"""A small plot of a record in the terminal, in braille dots: two columns and four rows of them a character."""

from __future__ import annotations

import numpy as np
from rich.text import Text

_DOTS = np.array([[0x01, 0x08], [0x02, 0x10], [0x04, 0x20], [0x40, 0x80]])
"""Bits of the Unicode braille patterns, by row and column of the dot."""


def dots(t: np.ndarray, y: np.ndarray, columns: int, rows: int) -> list[str]:
    """The curve y (n,) over t (n,) as rows of so many braille characters: all that each column of dots spans."""
    wide, high = 2 * columns, 4 * rows
    span, low, size = float(t[-1] - t[0]), float(y.min()), float(np.ptp(y))
    at = np.minimum(((t - t[0]) / span * wide).astype(int), wide - 1) if span > 0 else np.zeros(t.size, int)
    level = np.minimum(((y - low) / size * high).astype(int), high - 1) if size > 0 else np.zeros(t.size, int)
    canvas = np.zeros((high, wide), bool)
    last: int | None = None
    for x in range(wide):
        held = level[at == x]
        if held.size == 0:
            continue
        bottom, top = int(held.min()), int(held.max())
        if last is not None:  # joined to the column before it
            bottom, top = min(bottom, max(last, bottom)), max(top, min(last, top))
            bottom = min(bottom, last + 1) if last < bottom else bottom
            top = max(top, last - 1) if last > top else top
        canvas[high - 1 - top : high - bottom, x] = True
        last = int(held[-1])
    bits = (canvas.reshape(rows, 4, columns, 2) * _DOTS[None, :, None, :]).sum(axis=(1, 3))
    return ["".join(chr(0x2800 + int(b)) for b in row) for row in bits]


def plot(
    t: np.ndarray, y: np.ndarray, kept: tuple[float, float] | None, columns: int = 72, rows: int = 10
) -> Text:
    """The record with its free decay, from kept[0] to kept[1] on t (s), bright, and a line that says the scales."""
    span = float(t[-1] - t[0]) or 1.0
    edges = [int((k - t[0]) / span * columns) for k in kept] if kept else [0, -1]
    text = Text()
    for line in dots(t, y, columns, rows):
        for i, character in enumerate(line):
            text.append(character, "cyan" if edges[0] <= i <= edges[1] else "bright_black")
        text.append("\n")
    if kept:
        ruler = "".join("─" if edges[0] <= i <= edges[1] else " " for i in range(columns))
        text.append(f"{ruler}\n", "cyan")
    text.append(f"{t[0]:.4g} s to {t[-1]:.4g} s, {y.min():.4g} to {y.max():.4g}")
    return text
