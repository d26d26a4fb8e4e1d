"""Panels side by side, in as many rows as they need."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from bayesdamp.report.style import WIDTH

ABREAST = 4
"""Panels in a row; more would be too narrow for their labels."""


def panels(count: int, height: float, extra: float = 0.0) -> tuple[Figure, list[Axes], list[Axes]]:
    """A figure with so many panels, each `height` inches high; the panels, and the first of each row.

    extra: inches for what is above them all.
    """
    rows = -(-count // ABREAST)
    figure = Figure(figsize=(WIDTH, rows * height + extra))
    grid = np.atleast_2d(figure.subplots(rows, min(count, ABREAST), sharey=True, squeeze=False))
    every = list(grid.flat)
    for spare in every[count:]:
        spare.set_visible(False)
    return figure, every[:count], list(grid[:, 0])
