"""Get the axes to draw on: those that are given, or new ones."""

from __future__ import annotations

import os
import sys
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np

from bayesdamp.types import InputError

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from numpy.typing import NDArray

    Given: TypeAlias = Axes | Sequence[Axes] | NDArray[Any] | None
    """Axes as a user gives them: one, several, those of `plt.subplots`, or none."""

INVISIBLE = ("agg", "cairo", "pdf", "pgf", "ps", "svg", "template")
"""Backends of matplotlib that show nothing."""
INK, QUIET, FAINT, BLUE = "#222222", "#8a8a8a", "#d9d9d9", "#0072B2"


def get_axes(
    ax: Given,
    count: int = 1,
    columns: int = 1,
    heights: Sequence[float] | None = None,
    size: tuple[float, float] | None = None,
) -> tuple[Axes, ...]:
    """Return the axes to draw on, row by row.

    Parameters
    ----------
    ax
        The axes that the user gives; None for those of a new figure.
    count
        How many are needed.
    columns, heights, size
        Of a new figure: columns, relative heights of the rows, and size in inches.

    Raises
    ------
    InputError
        Where another number of axes is given, or something else.
    """
    if ax is not None:
        given = list_axes(ax)
        if len(given) != count:
            raise InputError(f"plot: ax has {len(given)} axes; it must have {count}, or be left out")
        return given
    import matplotlib.pyplot as plt

    show_in_notebook()
    figure = plt.figure(figsize=size, layout="constrained")
    grid = figure.subplots(-(-count // columns), columns, squeeze=False, height_ratios=heights)
    return tuple(grid.ravel().tolist())


def list_axes(ax: Axes | Sequence[Axes] | NDArray[Any]) -> tuple[Axes, ...]:
    """Return the given axes, row by row. Raises InputError for anything else."""
    from matplotlib.axes import Axes

    elements: list[Any] = np.ravel(np.asarray(ax, dtype=object)).tolist()
    for element in elements:
        if not isinstance(element, Axes):
            raise InputError(f"plot: ax holds a {type(element).__name__}; it must be matplotlib's axes")
    return tuple(elements)


def show_in_notebook() -> None:
    """Let a notebook show pictures below the cell, even where the environment names a backend that shows nothing.

    Servers and test machines do so. A backend that the notebook itself chose stays. Call this outside of a context of
    settings.
    """
    import matplotlib as mpl

    shell = sys.modules["IPython"].get_ipython() if "IPython" in sys.modules else None
    named = os.environ.get("MPLBACKEND", "").lower()
    if shell is None or not hasattr(shell, "kernel") or named not in INVISIBLE:
        return
    if mpl.get_backend().lower() == named:
        shell.run_line_magic("matplotlib", "inline")
