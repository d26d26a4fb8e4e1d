"""What several figures draw alike: panels in as many rows as they need, what lies beyond an axis."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from bayesdamp.report.style import QUIET, WIDTH

ABREAST = 4
"""Panels in a row; more would be too narrow for their labels."""
NARROW = 4.3
"""Width of a figure for a phone, in inches."""

HOLE = 20.0
"""Usual gaps between samples from which there is a hole."""


def broken(t: np.ndarray, y: np.ndarray, sampled: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """A line through t and y, (n,), that is broken where the times `sampled` (m,) of a record have a hole."""
    gaps = np.diff(sampled)
    begins = sampled[:-1][gaps > HOLE * np.median(gaps)] if gaps.size else sampled[:0]
    places = np.searchsorted(t, begins, side="right")
    return np.insert(t, places, begins), np.insert(np.asarray(y, float), places, np.nan)


def panels(
    count: int, height: float, extra: float = 0.0, abreast: int = ABREAST
) -> tuple[Figure, list[Axes], list[Axes]]:
    """A figure with so many panels, each `height` inches high; the panels, and the first of each row.

    extra: inches for what is above them all; abreast: panels in a row, 1 for a phone.
    """
    rows = -(-count // abreast)
    figure = Figure(figsize=(WIDTH if abreast > 1 else NARROW, rows * height + extra))
    grid = np.atleast_2d(figure.subplots(rows, min(count, abreast), sharey=True, squeeze=False))
    every = list(grid.flat)
    for spare in every[count:]:
        spare.set_visible(False)
    return figure, every[:count], list(grid[:, 0])


def off_axis(ax: Axes, text: str, left: bool, y: float) -> None:
    """Say at height y what lies beyond an end of the axis."""
    ax.annotate(
        f"◂ {text}" if left else f"{text} ▸",
        (0.0 if left else 1.0, y),
        xycoords=("axes fraction", "data"),
        ha="left" if left else "right",
        va="center",
        fontsize=7,
        color=QUIET,
    )
