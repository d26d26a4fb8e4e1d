"""Draw densities of draws, damping ratios of several records, and the exponent of the damping force."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from itertools import cycle

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from scipy.ndimage import gaussian_filter, gaussian_filter1d

from bayesdamp.report.style import INK, QUIET, RIGHT, WIDTH, colour, fix_margins, legend_columns, plain

_BINS = 160
INKS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#56B4E9", "#E69F00")
"""Colours of records or methods that are drawn together."""
LEGEND_ROW = 0.17
"""Height of a row of a legend, in inches."""
MARKED = ((0.0, "Coulomb", "coulomb"), (1.0, "viscous", "viscous"), (2.0, "quadratic", "quadratic"))
"""Exponents of laws, with their names and terms."""
ENDS = (-0.12, 3.05)
"""Ends of the exponent's axis; its prior is uniform between 0 and 3."""
HEIGHT = 1.9
"""Height of the exponent's figure, in inches."""


def outline(draws: np.ndarray, reflected: bool = False) -> tuple[np.ndarray, np.ndarray]:
    """Return a smooth density of draws.

    Parameters
    ----------
    draws
        Of any shape.
    reflected
        Whether the quantity cannot be negative; then the density is reflected at zero and ends there.

    Returns
    -------
    tuple
        Grid and density, whose maximum is 1, each (bins,).
    """
    flat = np.ravel(draws)
    flat = flat[np.isfinite(flat)]
    low, high = np.quantile(flat, [0.0005, 0.9995])
    pad = 0.15 * (high - low) or max(abs(high), 1.0) * 1e-6
    low, high = low - pad, high + pad
    reflect = reflected and low < 0
    low = 0.0 if reflect else low
    counts, edges = np.histogram(flat, bins=_BINS, range=(low, high))
    width = 1.06 * flat.std() * flat.size**-0.2 / (edges[1] - edges[0])
    height = gaussian_filter1d(
        counts.astype(float), max(1.0, width), mode="reflect" if reflect else "constant"
    )
    return 0.5 * (edges[1:] + edges[:-1]), height / (height.max() or 1.0)


def contours(
    x: np.ndarray, y: np.ndarray, reflected: bool = False
) -> tuple[np.ndarray, np.ndarray, np.ndarray, list[float]]:
    """Return a smooth joint density of draws, and its levels that enclose 90 % and 50 % of them.

    Parameters
    ----------
    x, y
        Draws, of the same shape.
    reflected
        Whether x and y cannot be negative, as in `outline`.

    Returns
    -------
    tuple
        Grids of x and y, (80,) each, the density (y, x), and the two levels.
    """
    x, y = np.ravel(x), np.ravel(y)
    edges, modes = [], []
    for values in (x, y):
        low, high = np.quantile(values, [0.001, 0.999])
        pad = 0.2 * (high - low) or 1e-12
        reflect = reflected and low - pad < 0
        edges.append(np.linspace(0.0 if reflect else low - pad, high + pad, 81))
        modes.append("reflect" if reflect else "constant")
    counts, *_ = np.histogram2d(x, y, bins=edges)
    smooth = gaussian_filter(counts, 2.6, mode=modes)  # pyright: ignore[reportArgumentType]
    order = np.sort(smooth.ravel())[::-1]
    mass = np.cumsum(order) / order.sum()
    levels = [float(order[np.searchsorted(mass, m)]) for m in (0.9, 0.5)]
    centres = [0.5 * (e[1:] + e[:-1]) for e in edges]
    return centres[0], centres[1], smooth.T, levels


def overview(curves: Mapping[str, Sequence[np.ndarray]], unit: str) -> Figure:
    """Draw the damping ratios of several records against amplitude.

    Parameters
    ----------
    curves
        Record to amplitude, ratio and the ends of its interval, each (m,).
    unit
        Of the amplitudes.
    """
    figure = Figure(figsize=(WIDTH, 3.4))
    ax = figure.subplots()
    few = len(curves) <= len(INKS)
    for (name, (at, ratio, low, high)), ink in zip(
        curves.items(), cycle(INKS if few else (QUIET,)), strict=False
    ):
        ax.fill_between(at, 100 * low, 100 * high, color=ink, alpha=0.15 if few else 0.05, lw=0)
        ax.plot(at, 100 * ratio, color=ink, lw=1.4 if few else 0.8, label=name)
    tops = [np.nanmax(curve[1]) for curve in curves.values()]
    ax.set(xscale="log", xlabel=f"amplitude / {unit}", ylabel="damping ratio / %")
    plain(ax)
    ax.set_ylim(0, 130 * float(np.nanquantile(tops, 0.9)) or 1.0)
    if few:
        columns = legend_columns(list(curves), WIDTH, 3)
        rows = math.ceil(len(curves) / columns)
        figure.set_figheight(3.4 + max(rows - 2, 0) * LEGEND_ROW)
        figure.legend(*ax.get_legend_handles_labels(), loc="outside upper left", ncols=columns)
    return figure


def exponent(draws: np.ndarray, interval: tuple[float, float, float], title: str) -> Figure:
    """Draw the posterior of the exponent, with its median and 95 % interval below.

    Parameters
    ----------
    draws
        Of the exponent, (n,).
    interval
        Value, low, high.
    title
        Of the figure.
    """
    figure = Figure(figsize=(WIDTH, HEIGHT), layout="none")
    draw_exponent(figure.subplots(), draws, interval, title)
    fix_margins(figure, left=RIGHT, top=0.5)
    return figure


def draw_exponent(
    ax: Axes,
    draws: np.ndarray | None,
    interval: tuple[float, float, float],
    title: str = "",
    marked: Sequence[tuple[float, str, str]] = MARKED,
) -> None:
    """Draw the exponent on these axes, as `exponent` does; without draws only its interval.

    `marked` contains exponents of laws, their names and terms.
    """
    value, low, high = interval
    for place, name, term in marked:
        ax.axvline(place, color=colour(term), lw=1.2, ls=(0, (4, 2)))
        side = "left" if place == 0.0 else "center" if place < 3.0 else "right"
        ax.text(place, 1.14, name, color=colour(term), fontsize=8, ha=side, va="bottom")
    if draws is not None:
        grid, height = outline(draws)
        inside = (grid >= 0.0) & (grid <= 3.0)
        ax.fill_between(grid[inside], 0.0, height[inside], color=QUIET, alpha=0.35, lw=0)
        ax.plot(grid[inside], height[inside], color=INK, lw=1.0)
    at = 0.4 if draws is None else -0.13
    ax.plot([low, high], [at, at], color=INK, lw=2.4)
    ax.plot([value], [at], "o", color=INK, ms=5)
    ax.set(xlim=ENDS, ylim=(-0.3, 1.12), yticks=[])
    ax.spines["left"].set_visible(False)
    ax.set(xticks=[0, 0.5, 1, 1.5, 2, 2.5, 3], xlabel="exponent of the velocity")
    ax.set_title(title, loc="left", pad=16)
