"""What several figures draw alike: lines with holes, what lies beyond an axis."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.ticker import FuncFormatter, LogLocator

from bayesdamp.report.style import QUIET

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


def plain(ax: Axes) -> None:
    """Write a logarithmic axis of amplitudes in plain numbers, not in powers of ten."""
    for which in (ax.xaxis.set_major_formatter, ax.xaxis.set_minor_formatter):
        which(FuncFormatter(lambda x, _: f"{x:g}"))
    ax.xaxis.set_minor_locator(LogLocator(subs=(2, 4, 6)))


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
