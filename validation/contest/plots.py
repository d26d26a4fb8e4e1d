"""Draw the plots of the contest."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd

from bayesdamp.types import OK
from validation.contest.roster import OURS, ROSTER, peers_of
from validation.contest.scoring import coverage, groups_of, quantile_of_errors, simulated, where

BLUE, GREY = "#1f5a93", "#8a8f98"
LOWEST, HIGHEST = 1e-4, 30.0
"""Range of the plotted errors; errors outside are drawn at its ends."""


def errors(rows: pd.DataFrame, path: Path) -> None:
    """Plot the median error of each peer with its interval, and the 90 % quantile; a panel for each group."""
    from matplotlib.figure import Figure

    groups = groups_of(rows)
    peers = peers_of(rows)
    figure = Figure(figsize=(11, 0.9 + 0.36 * len(peers) * (1 + (len(groups) > 3))), layout="constrained")
    across = min(len(groups), 3)
    axes = np.ravel(figure.subplots(-(-len(groups) // 3), across, sharex=True, sharey=True, squeeze=False))
    for ax, group in zip(axes, groups, strict=False):
        for i, name in enumerate(reversed(peers)):
            part = where(rows, group=group, peer=name)
            if where(part, outcome=OK).empty:
                continue
            middle, far = (quantile_of_errors(part, level) for level in (0.5, 0.9))
            colour = BLUE if name == OURS else GREY
            ends = np.clip([middle.value, far.value, middle.low, middle.high], LOWEST, HIGHEST)
            ax.plot(ends[:2], [i, i], color=colour, lw=1.2)
            ax.plot(ends[2:], [i, i], color=colour, lw=5, alpha=0.35, solid_capstyle="butt")
            ax.plot(ends[0], i, "o", color=colour, ms=5)
            ax.plot(ends[1], i, "|", color=colour, ms=8)
        ax.set(xscale="log", title=group)
        ax.set_yticks(range(len(peers)), [ROSTER[n].label for n in reversed(peers)], fontsize=8)
        ax.grid(axis="x", color="#dddddd", lw=0.6)
        ax.spines[["top", "right"]].set_visible(False)
        ax.tick_params(axis="x", labelbottom=True)
    for ax in axes[len(groups) :]:
        ax.set_visible(False)
    figure.supxlabel("relative error of the damping ratio: median with its interval, and 90 % quantile")
    _save(figure, path)


def cost(rows: pd.DataFrame, path: Path) -> None:
    """Plot the CPU time of each peer and the coverage of its intervals, for all simulated records."""
    from matplotlib.figure import Figure

    rows = simulated(rows)
    peers = peers_of(rows)[::-1]
    figure = Figure(figsize=(11, 0.9 + 0.3 * len(peers)), layout="constrained")
    left, right = figure.subplots(1, 2, sharey=True)
    for i, name in enumerate(peers):
        part, colour = where(rows, peer=name), BLUE if name == OURS else GREY
        seconds = part["seconds"].dropna().to_numpy(float)
        if seconds.size:
            low, middle, high = np.quantile(seconds, [0.1, 0.5, 0.9])
            left.plot([low, high], [i, i], color=colour, lw=5, alpha=0.35, solid_capstyle="butt")
            left.plot(middle, i, "o", color=colour)
        covered, count = coverage(where(part, outcome=OK))
        if count:
            right.plot(
                [covered.low, covered.high], [i, i], color=colour, lw=5, alpha=0.35, solid_capstyle="butt"
            )
            right.plot(covered.value, i, "o", color=colour)
    right.axvline(0.95, color="black", lw=0.8, ls=":")
    left.set(xscale="log", xlabel="CPU seconds for a record: median, and 10 to 90 % quantiles")
    left.set_yticks(range(len(peers)), [ROSTER[n].label for n in peers], fontsize=8)
    right.set(xlabel="coverage of the stated 95 % intervals", xlim=(-0.03, 1.03))
    for ax in (left, right):
        ax.grid(axis="x", color="#dddddd", lw=0.6)
        ax.spines[["top", "right"]].set_visible(False)
    _save(figure, path)


def _save(figure, path: Path) -> None:
    import matplotlib

    with matplotlib.rc_context({"svg.hashsalt": "contest", "svg.fonttype": "path"}):
        figure.savefig(path, metadata={"Date": None} if path.suffix == ".svg" else None)
