"""Draw ranks of a calibration."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from bayesdamp.report import words
from bayesdamp.report.style import FAINT, INK, QUIET, WIDTH

LOOKS = (("#0072B2", "-"), ("#D55E00", "--"), ("#009E73", "-."), ("#CC79A7", ":"))
"""A colour and a line style for each sampler."""

Counts = Mapping[str, Mapping[str, np.ndarray]]


def ranks(names: Sequence[str], counts: Counts, result: Mapping[str, Any]) -> Figure:
    """counts: sampler to parameter to how often each rank came, (draws + 1,).

    result: bins of the histograms and points of the distribution function, numbers that divide draws + 1; bands: number
    of records to low and high of their cumulative counts at the inner points, and bin_low and bin_high of one bin.
    """
    bands = result["bands"]
    figure = Figure(figsize=(WIDTH, 3.1))
    grid = figure.subplots(2, len(names), sharex=True, sharey="row", squeeze=False)
    for (upper, lower), name in zip(grid.T, names):
        for i, found in enumerate(counts.values()):
            look, own, shown = LOOKS[i % len(LOOKS)], found[name], {} if i else bands
            _histogram(upper, own.reshape(result["bins"], -1).sum(axis=1), shown, *look)
            _departure(lower, own.reshape(result["points"], -1).sum(axis=1), shown, *look)
        upper.set_title(words.symbol(name).math)
        lower.set_xlabel("rank / draws")
    grid[0, 0].set_ylabel("records")
    grid[1, 0].set_ylabel("ECDF − uniform")
    looks = zip(counts, LOOKS)
    handles = [Line2D([], [], color=c, ls=dash, label=words.method(s)) for s, (c, dash) in looks]
    figure.legend(handles=handles, loc="outside upper right", ncols=len(handles))
    return figure


def _histogram(ax: Axes, counts: np.ndarray, bands: Mapping[str, Any], colour: str, dash: str) -> None:
    limits = bands.get(str(int(counts.sum())))
    if limits:
        ax.axhspan(limits["bin_low"], limits["bin_high"], color=FAINT, lw=0)
        ax.axhline(counts.sum() / counts.size, color=QUIET, lw=0.6)
    ax.stairs(counts, np.linspace(0, 1, counts.size + 1), color=colour, ls=dash, lw=1.0)
    ax.set_ylim(0, None)
    ax.locator_params(axis="both", nbins=3)


def _departure(ax: Axes, counts: np.ndarray, bands: Mapping[str, Any], colour: str, dash: str) -> None:
    n, at = max(int(counts.sum()), 1), np.linspace(0, 1, counts.size + 1)
    limits = bands.get(str(n))
    if limits:
        low, high = (np.r_[0.0, np.asarray(limits[k], float) / n, 1.0] - at for k in ("low", "high"))
        ax.fill_between(at, low, high, color=FAINT, lw=0)
    ax.plot(at, np.r_[0.0, np.cumsum(counts) / n] - at, color=colour, ls=dash, lw=1.1)
    ax.axhline(0, color=INK, lw=0.5)
    ax.locator_params(axis="both", nbins=3)
