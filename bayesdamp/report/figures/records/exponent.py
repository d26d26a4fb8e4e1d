"""The power of the velocity that a record's damping goes like, on an axis where the paper's three are marked."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from bayesdamp.report.figures._panels import NARROW
from bayesdamp.report.figures.density import outline
from bayesdamp.report.style import INK, QUIET, WIDTH, colour

MARKED = ((0.0, "Coulomb", "coulomb"), (1.0, "viscous", "viscous"), (2.0, "quadratic", "quadratic"))
ENDS = (-0.12, 3.05)
"""Of the axis: the exponent is uniform between 0 and 3 beforehand."""
HEIGHT = 1.9
"""Inches."""


def exponent(
    draws: np.ndarray, interval: tuple[float, float, float], title: str, narrow: bool = False
) -> Figure:
    """The posterior of the exponent from draws of it, (n,), with its median and 95 % interval below.

    interval: value, low, high; title: what it says; narrow: for a phone.
    """
    figure = Figure(figsize=(NARROW if narrow else WIDTH, HEIGHT))
    draw_exponent(figure.subplots(), draws, interval, title)
    return figure


def draw_exponent(ax: Axes, draws: np.ndarray, interval: tuple[float, float, float], title: str = "") -> None:
    """Draw it on these axes."""
    value, low, high = interval
    grid, height = outline(draws)
    inside = (grid >= 0.0) & (grid <= 3.0)
    grid, height = grid[inside], height[inside]
    for place, name, term in MARKED:
        ax.axvline(place, color=colour(term), lw=1.2, ls=(0, (4, 2)))
        ax.text(
            place, 1.14, name, color=colour(term), fontsize=8, ha="left" if place == 0 else "center",
            va="bottom",
        )  # fmt: skip
    ax.fill_between(grid, 0.0, height, color=QUIET, alpha=0.35, lw=0)
    ax.plot(grid, height, color=INK, lw=1.0)
    ax.plot([low, high], [-0.13, -0.13], color=INK, lw=2.4)
    ax.plot([value], [-0.13], "o", color=INK, ms=5)
    ax.set_xlim(*ENDS)
    ax.set_ylim(-0.3, 1.12)
    ax.set_yticks([])
    ax.spines["left"].set_visible(False)
    ax.set_xticks([0, 0.5, 1, 1.5, 2, 2.5, 3])
    ax.set_xlabel("exponent of the velocity")
    ax.set_title(title, loc="left", pad=16)
