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
