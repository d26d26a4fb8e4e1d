"""Panels side by side, in as many rows as they need."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from bayesdamp.report.style import WIDTH

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
