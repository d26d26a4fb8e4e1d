"""Draw ranks of a calibration, and whether probabilities are right as often as they say."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from bayesdamp.report import words
from bayesdamp.report.style import FAINT, INK, QUIET, WIDTH


def reliability(bins: Sequence[Mapping[str, Any]]) -> Figure:
    """bins: probability, share, low, high and records of each."""
    figure = Figure(figsize=(0.5 * WIDTH, 0.45 * WIDTH))
    ax = figure.subplots()
    p, share, low, high = (
        np.array([b[k] for b in bins], float) for k in ("probability", "share", "low", "high")
    )
    ax.plot([0, 1], [0, 1], color=QUIET, lw=0.8)
    ax.vlines(p, low, high, color=QUIET, lw=5, alpha=0.4)
    ax.plot(p, share, "o", color="#0072B2", ms=5)
    for x, y, b in zip(p, share, bins):
        ax.annotate(str(b["records"]), (x, y), (-6, 4), textcoords="offset points", ha="right", fontsize=7.5)
    ax.set(
        xlim=(0, 1.02), ylim=(0, 1.02), xlabel="probability of the best model", ylabel="share that was right"
    )
    return figure


def confusion(models: Sequence[str], counts: np.ndarray) -> Figure:
    """counts: true model by the most probable one, (m, m)."""
    size = 0.62 * len(models) + 1.8
    figure = Figure(figsize=(min(size + 1.2, WIDTH), size))
    ax = figure.subplots()
    rows = counts / np.maximum(counts.sum(axis=1, keepdims=True), 1)
    ax.imshow(rows, cmap="Blues", vmin=0, vmax=1)
    for i, j in np.ndindex(counts.shape):
        if counts[i, j]:
            colour = "white" if rows[i, j] > 0.6 else INK
            ax.text(j, i, str(int(counts[i, j])), ha="center", va="center", color=colour, fontsize=8)
    labels = [words.model(m) for m in models]
    ax.set_xticks(range(len(models)), labels, rotation=40, ha="right")
    ax.set_yticks(range(len(models)), labels)
    ax.set(xlabel="most probable", ylabel="true")
    ax.tick_params(length=0)
    return figure


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
