"""Intervals of the same quantity from several records or specimens, beside that of all together."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from matplotlib.figure import Figure

from bayesdamp.report.style import FAINT, QUIET, WIDTH

Interval = tuple[float, float, float]
"""2.5, 50 and 97.5 %."""


@dataclass(frozen=True)
class Panel:
    """One parameter: its axis label, an interval for each row, more for each row (open, below it), and a band."""

    label: str
    rows: Sequence[Interval]
    band: Interval
    others: Sequence[Interval] = ()


def intervals(labels: Sequence[str], panels: Sequence[Panel], colour: str) -> Figure:
    """labels: of the rows."""
    figure = Figure(figsize=(WIDTH, 0.27 * len(labels) + 0.85))
    axes = np.atleast_1d(figure.subplots(1, len(panels), sharey=True))
    places = np.arange(len(labels), dtype=float)
    for ax, panel in zip(axes, panels):
        ax.axvspan(panel.band[0], panel.band[2], color=FAINT, lw=0)
        ax.axvline(panel.band[1], color=QUIET, lw=0.8)
        lift = 0.16 if panel.others else 0.0
        ax.errorbar(*_bars(panel.rows, places - lift), fmt="o", ms=4, color=colour, lw=1.0)
        if panel.others:
            ax.errorbar(*_bars(panel.others, places + lift), fmt="o", ms=4, mfc="white", color=colour, lw=1.0)
        # A band much wider than the intervals would leave nothing of them to see.
        edges = np.array([x for row in (*panel.rows, *panel.others) for x in row])
        room = 0.6 * max(float(np.ptp(edges)), 1e-12)
        ax.set_xlim(
            max(min(panel.band[0], edges.min()), edges.min() - room) - 0.05 * room,
            min(max(panel.band[2], edges.max()), edges.max() + room) + 0.05 * room,
        )
        ax.set_xlabel(panel.label)
        ax.locator_params(axis="x", nbins=5)
        ax.tick_params(axis="y", length=0)
    axes[0].set_yticks(places, list(labels))
    axes[0].set_ylim(len(labels) - 0.4, -0.6)
    return figure


def _bars(rows: Sequence[Interval], places: np.ndarray) -> tuple[np.ndarray, np.ndarray, None, np.ndarray]:
    low, middle, high = np.array(rows).T
    return middle, places, None, np.stack([middle - low, high - middle])
