"""The running estimate of an online filter, with its band, against time."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from bayesdamp.report import words
from bayesdamp.report.style import INK, QUIET, WIDTH, colour

SETTLING = 0.15
"""Share of the record before which a band is too wide to set the scale."""


def running(
    model: str,
    names: Sequence[str],
    t: np.ndarray,
    last: Mapping[str, tuple[np.ndarray, np.ndarray]],
    first: Mapping[str, tuple[np.ndarray, np.ndarray]],
    units: Mapping[str, str],
    truth: Mapping[str, float],
) -> Figure:
    """names: the coefficients to draw; last, first: mean and sd at the times t of the last and of the first pass."""
    figure = Figure(figsize=(WIDTH, 1.9 * len(names) + 0.4))
    for ax, name in zip(figure.subplots(len(names), 1, sharex=True, squeeze=False)[:, 0], names):
        mean, sd = last[name]
        low, high = np.maximum(mean - 2 * sd, 0.0), mean + 2 * sd
        ax.fill_between(t, low, high, color=colour(model), alpha=0.22, lw=0)
        ax.plot(t, mean, color=colour(model), lw=1.3)
        ax.plot(t, first[name][0], color=QUIET, lw=0.9, ls=(0, (3, 2)))
        if np.isfinite(truth.get(name, np.nan)):
            ax.axhline(truth[name], color=INK, lw=0.9, ls=(0, (2, 2)))
        late = t >= t[0] + SETTLING * (t[-1] - t[0])
        bottom, top = float(low[late].min()), float(high[late].max())
        ax.set_ylim(max(bottom - 0.1 * (top - bottom), 0.0), top + 0.1 * (top - bottom))
        ax.set_ylabel(words.axis(name, units.get(name, "")))
    figure.axes[-1].set_xlabel("time / s")
    handles = [
        Patch(color=colour(model), alpha=0.35, label="estimate from the record so far, ± 2 sd"),
        Line2D([], [], color=QUIET, lw=0.9, ls=(0, (3, 2)), label="first pass"),
    ]
    if any(np.isfinite(v) for v in truth.values()):
        handles.append(Line2D([], [], color=INK, lw=0.9, ls=(0, (2, 2)), label="truth"))
    figure.legend(handles=handles, loc="outside upper left", ncols=len(handles))
    return figure
