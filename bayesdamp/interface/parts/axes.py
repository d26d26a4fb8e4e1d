"""Axes to draw on: those that are given, or new ones."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from bayesdamp.types import InputError

if TYPE_CHECKING:
    from matplotlib.axes import Axes

INK, QUIET, FAINT, BLUE = "#222222", "#8a8a8a", "#d9d9d9", "#0072B2"


def one(ax: Axes | None) -> Axes:
    """The axes given, or those of a new figure of pyplot's."""
    if ax is not None:
        return ax
    return several(None, 1)[0]


def several(
    axes: Sequence[Axes] | None,
    count: int,
    columns: int = 1,
    heights: Sequence[float] | None = None,
    size: tuple[float, float] | None = None,
) -> tuple[Axes, ...]:
    """As many axes as are drawn on, row by row. columns, heights of the rows and size (inches): of a new figure.

    Raises InputError where another number is given.
    """
    if axes is not None:
        if len(axes) != count:
            raise InputError(f"axes: {len(axes)} given; {count} are drawn on")
        return tuple(axes)
    import matplotlib.pyplot as plt

    figure = plt.figure(figsize=size, layout="constrained")
    grid = figure.subplots(-(-count // columns), columns, squeeze=False, height_ratios=heights)
    return tuple(grid.ravel().tolist())
