"""Draw the plots of the contest."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
import pandas as pd
from matplotlib.figure import Figure

from bayesdamp.types import OK
from validation.contest.roster import OURS, ROSTER, peers_of
from validation.contest.scoring import coverage, groups_of, quantile_of_errors, simulated
from validation.rows import numbers, where

LOWEST, HIGHEST = 1e-4, 30.0
"""Range of the plotted relative errors; errors outside are drawn at the ends of the range."""


def errors(rows: pd.DataFrame, path: Path) -> None:
    """Plot the median and the 90 % quantile of each peer's relative error to a file, a panel for each group.

    A thick band is the 95 % interval of the median.
    """
    groups, peers = groups_of(rows), peers_of(rows)[::-1]
    figure = Figure(figsize=(11, 0.9 + 0.36 * len(peers) * (1 + (len(groups) > 3))), layout="constrained")
    across = min(len(groups), 3)
    axes = np.ravel(figure.subplots(-(-len(groups) // 3), across, sharex=True, sharey=True, squeeze=False))
    for ax, group in zip(axes, groups, strict=False):
        for i, name in enumerate(peers):
            part = where(rows, group=group, peer=name, outcome=OK)
            if part.empty:
                continue
            middle, far = (quantile_of_errors(part, level) for level in (0.5, 0.9))
            value, end, *ends = np.clip([middle.value, far.value, middle.low, middle.high], LOWEST, HIGHEST)
            colour = _draw(ax, i, name, value, ends)
            ax.plot([value, end], [i, i], color=colour, lw=1.2)
            ax.plot(end, i, "|", color=colour, ms=8)
        ax.set(xscale="log", title=group)
        ax.tick_params(axis="x", labelbottom=True)
        _finish(ax, peers)
    for ax in axes[len(groups) :]:
        ax.set_visible(False)
    figure.supxlabel("relative error of the damping ratio: median with its interval, and 90 % quantile")
    _save(figure, path)


def cost(rows: pd.DataFrame, path: Path) -> None:
    """Plot the CPU time of each peer and the coverage of its intervals to a file, for all simulated records.

    The bands are the 10 to 90 % quantiles of the time, and the 95 % interval of the coverage.
    """
    rows = simulated(rows)
    peers = peers_of(rows)[::-1]
    figure = Figure(figsize=(11, 0.9 + 0.3 * len(peers)), layout="constrained")
    left, right = figure.subplots(1, 2, sharey=True)
    for i, name in enumerate(peers):
        part = where(rows, peer=name)
        low, middle, high = np.nanquantile(numbers(part, "seconds"), [0.1, 0.5, 0.9])
        _draw(left, i, name, middle, [low, high])
        covered, _ = coverage(where(part, outcome=OK))
        _draw(right, i, name, covered.value, [covered.low, covered.high])
    right.axvline(0.95, color="black", lw=0.8, ls=":")
    left.set(xscale="log", xlabel="CPU seconds for a record: median, and 10 to 90 % quantiles")
    right.set(xlabel="coverage of the stated 95 % intervals", xlim=(-0.03, 1.03))
    for ax in (left, right):
        _finish(ax, peers)
    _save(figure, path)


def _draw(ax: Any, i: int, name: str, value: float, ends: list[float]) -> str:
    """Draw a number of the peer `name` with its interval at height i, nothing for NaN; return its colour."""
    colour = "#1f5a93" if name == OURS else "#8a8f98"
    ax.plot(ends, [i, i], color=colour, lw=5, alpha=0.35, solid_capstyle="butt")
    ax.plot(value, i, "o", color=colour, ms=5)
    return colour


def _finish(ax: Any, peers: list[str]) -> None:
    """Label the heights 0, 1, … of an axis with the names of the peers, and draw a grid."""
    ax.set_yticks(range(len(peers)), [ROSTER[n].label for n in peers], fontsize=8)
    ax.grid(axis="x", color="#dddddd", lw=0.6)
    ax.spines[["top", "right"]].set_visible(False)


def _save(figure: Figure, path: Path) -> None:
    """Save a figure without a date or random ids, so that the same rows give the same file."""
    with mpl.rc_context({"svg.hashsalt": "contest", "svg.fonttype": "path"}):
        figure.savefig(path, metadata={"Date": None})
