"""Ranks of the truth among posterior draws: histograms, and how their distribution departs from the uniform one."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.figure import Figure

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
    figure = Figure(figsize=(WIDTH, 1.25 * (len(counts) + 1) + 0.5))
    grid = figure.subplots(len(counts) + 1, len(names), sharex=True, sharey="row", squeeze=False)
    for j, name in enumerate(names):
        for i, (sampler, found) in enumerate(counts.items()):
            look, own = LOOKS[i % len(LOOKS)], found[name]
            _histogram(grid[i, j], own.reshape(result["bins"], -1).sum(axis=1), bands, look[0])
            _departure(
                grid[-1, j], own.reshape(result["points"], -1).sum(axis=1), bands if i == 0 else {}, *look
            )
            if j == 0:
                grid[i, 0].set_ylabel(words.method(sampler))
        grid[0, j].set_title(words.symbol(name).math)
        grid[-1, j].set_xlabel("rank / draws")
    grid[-1, 0].set_ylabel("ECDF − uniform")
    return figure


def _histogram(ax, counts: np.ndarray, bands: Mapping[str, Any], colour: str) -> None:
    edges = np.linspace(0, 1, counts.size + 1)
    limits = bands.get(str(int(counts.sum())))
    if limits:
        ax.axhspan(limits["bin_low"], limits["bin_high"], color=FAINT, lw=0)
    ax.stairs(counts, edges, color=colour, lw=1.0)
    ax.axhline(counts.sum() / counts.size, color=QUIET, lw=0.6)
    ax.set_ylim(0, None)
    ax.locator_params(axis="both", nbins=3)


def _departure(ax, counts: np.ndarray, bands: Mapping[str, Any], colour: str, dash: str) -> None:
    n, at = max(int(counts.sum()), 1), np.linspace(0, 1, counts.size + 1)
    limits = bands.get(str(n))
    if limits:
        low, high = (np.r_[0.0, np.asarray(limits[k], float) / n, 1.0] - at for k in ("low", "high"))
        ax.fill_between(at, low, high, color=FAINT, lw=0)
    ax.plot(at, np.r_[0.0, np.cumsum(counts) / n] - at, color=colour, ls=dash, lw=1.1)
    ax.axhline(0, color=INK, lw=0.5)
    ax.locator_params(axis="both", nbins=3)
