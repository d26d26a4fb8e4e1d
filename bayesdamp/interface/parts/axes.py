"""Axes to draw on: those that are given, or new ones."""

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
    """Axes as a user has them: one, several, those that `plt.subplots` gives, or none yet."""

UNSEEN = ("agg", "cairo", "pdf", "pgf", "ps", "svg", "template")
"""Backends of matplotlib that show nothing."""
INK, QUIET, FAINT, BLUE = "#222222", "#8a8a8a", "#d9d9d9", "#0072B2"


def one(ax: Axes | None) -> Axes:
    """The axes given, or those of a new figure of pyplot's. Raises InputError where something else is given."""
    return several(ax, 1)[0]


def several(
    ax: Given,
    count: int,
    columns: int = 1,
    heights: Sequence[float] | None = None,
    size: tuple[float, float] | None = None,
) -> tuple[Axes, ...]:
    """As many axes as are drawn on, row by row. columns, heights of the rows and size (inches): of a new figure.

    Raises InputError where another number is given, or something else.
    """
    if ax is not None:
        given = listed(ax)
        if len(given) != count:
            raise InputError(f"plot: ax has {len(given)} axes; it must have {count}, or be left out")
        return given
    import matplotlib.pyplot as plt

    seen_in_notebooks()
    figure = plt.figure(figsize=size, layout="constrained")
    grid = figure.subplots(-(-count // columns), columns, squeeze=False, height_ratios=heights)
    return tuple(grid.ravel().tolist())


def listed(ax: Axes | Sequence[Axes] | NDArray[Any]) -> tuple[Axes, ...]:
    """The axes given, row by row. Raises InputError for what is none."""
    from matplotlib.axes import Axes

    found: list[Any] = np.ravel(np.asarray(ax, dtype=object)).tolist()
    for one_of_them in found:
        if not isinstance(one_of_them, Axes):
            raise InputError(f"plot: ax holds a {type(one_of_them).__name__}; it must be matplotlib's axes")
    return tuple(found)


def seen_in_notebooks() -> None:
    """In a notebook, draw below the cell also where the environment names a backend that shows nothing, as servers and
    test machines do; what the notebook itself chose stays. To be called outside of a context of settings."""
    import matplotlib as mpl

    shell = sys.modules["IPython"].get_ipython() if "IPython" in sys.modules else None
    named = os.environ.get("MPLBACKEND", "").lower()
    if (
        shell is not None
        and hasattr(shell, "kernel")
        and named in UNSEEN
        and mpl.get_backend().lower() == named
    ):
        shell.run_line_magic("matplotlib", "inline")
