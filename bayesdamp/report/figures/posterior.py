"""Draw posteriors: marginals and pairs."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from typing import Any

import numpy as np
import scipy  # loads its modules when they are used
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from bayesdamp.report import words
from bayesdamp.report.drawing import INK, WIDTH, colour

_BINS = 160
"""Number of grid points of a drawn density."""
TRUE_LINE_STYLE: dict[str, Any] = {"color": INK, "lw": 0.9, "ls": (0, (2, 2))}
"""Style of a line at a true value."""
_POSITIVE = frozenset({"noise_sd", "noise_time", "epsilon", "stiffness"})
"""Parameters that cannot be negative, besides the damping coefficients."""

Draws = Mapping[str, Mapping[str, np.ndarray]]
"""For each sampler and parameter its draws, of any shape."""


def outline(draws: np.ndarray, reflected: bool) -> tuple[np.ndarray, np.ndarray]:
    """Estimate the density of draws with a Gaussian kernel, scaled to a maximum of 1.

    Parameters
    ----------
    draws
        The draws, of any shape; those that are not finite are left out.
    reflected
        Whether the quantity cannot be negative. The grid then has no negative points, and the part of the density that
        the kernel puts below zero is reflected.

    Returns
    -------
    tuple
        Grid and density, each (`_BINS`,). The grid covers all draws except the outermost 0.05 % on either side.
    """
    flat = np.ravel(draws)
    flat = flat[np.isfinite(flat)]
    low, high = np.quantile(flat, [0.0005, 0.9995])
    pad = 0.15 * (high - low) or max(abs(high), 1.0) * 1e-6
    low, high = low - pad, high + pad
    reflect = reflected and low < 0
    low = 0.0 if reflect else low
    counts, edges = np.histogram(flat, bins=_BINS, range=(low, high))
    width = 1.06 * flat.std() * flat.size**-0.2 / (edges[1] - edges[0])  # Scott's rule, in bins
    height = scipy.ndimage.gaussian_filter1d(
        counts.astype(float), max(1.0, width), mode="reflect" if reflect else "constant"
    )
    return 0.5 * (edges[1:] + edges[:-1]), height / (height.max() or 1.0)


def contours(
    x: np.ndarray, y: np.ndarray, reflected: bool = False
) -> tuple[np.ndarray, np.ndarray, np.ndarray, list[float]]:
    """Estimate the joint density of two parameters, and the levels whose contours enclose 90 % and 50 % of it.

    Parameters
    ----------
    x, y
        Finite draws of the two parameters, of the same shape.
    reflected
        Whether x and y cannot be negative. The grids then have no negative points, and the part of the density that the
        smoothing puts below zero is reflected.

    Returns
    -------
    tuple
        Grids of x and y, (80,) each, the density (not normalised) at (y, x), and the levels for 90 % and 50 %.
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
    smooth = scipy.ndimage.gaussian_filter(counts, 2.6, mode=modes)  # pyright: ignore[reportArgumentType]
    order = np.sort(smooth.ravel())[::-1]
    mass = np.cumsum(order) / order.sum()
    levels = [float(order[np.searchsorted(mass, m)]) for m in (0.9, 0.5)]
    centres = [0.5 * (e[1:] + e[:-1]) for e in edges]
    return centres[0], centres[1], smooth.T, levels


def marginals(
    model: str, draws: Draws, units: Mapping[str, str], truth: Mapping[str, float], damping: Collection[str]
) -> Figure:
    """Draw the marginal posterior of each parameter.

    Parameters
    ----------
    model
        Name of the model, which determines the colour.
    draws
        Draws, of any shape, by sampler and parameter; the density of the first sampler is filled.
    units
        Units, by parameter, for the labels of the axes.
    truth
        True values, by parameter; missing or nan if not known.
    damping
        Names of the damping coefficients, which are never negative.
    """
    names = list(dict.fromkeys(name for own in draws.values() for name in own))
    rows = -(-len(names) // 4)
    columns = max(2, -(-len(names) // rows))
    figure = Figure(figsize=(WIDTH * (1.0 if rows > 1 else min(1.0, 0.26 * columns)), 1.65 * rows + 0.45))
    for i, name in enumerate(names):
        ax = figure.add_subplot(rows, columns, i + 1)
        _densities(ax, model, name, draws, name in _POSITIVE or name in damping)
        _mark(ax.axvline, truth.get(name))
        ax.set(xlabel=words.axis(name, units.get(name, "")))
        ax.locator_params(axis="x", nbins=4)
    _legend(figure, _samplers(model, draws), truth)
    return figure


def pairs(
    model: str, names: Sequence[str], draws: Draws, units: Mapping[str, str], truth: Mapping[str, float]
) -> Figure:
    """Draw pairs of damping coefficients, with contours that enclose 50 % and 90 % of the posterior.

    The panels on the diagonal have the marginal density of each coefficient.

    Parameters
    ----------
    model
        Name of the model, which determines the colour.
    names
        Names of the coefficients.
    draws
        Draws, of any shape, by sampler and parameter; the density and the contours of the first sampler are filled.
    units
        Units, by parameter, for the labels of the axes.
    truth
        True values, by parameter; missing or nan if not known.
    """
    count = len(names)
    figure = Figure(figsize=(2.5 * count + 0.4, 2.3 * count + 0.4))
    for row, below in enumerate(names):
        for column, across in enumerate(names[: row + 1]):
            ax = figure.add_subplot(count, count, row * count + column + 1)
            if row == column:
                _densities(ax, model, across, draws, reflected=True)
            else:
                for i, own in enumerate(draws.values()):
                    line, fill = _strokes(model, i)
                    x, y, smooth, levels = contours(own[across], own[below], reflected=True)
                    if fill:
                        top = smooth.max() * 1.01
                        ax.contourf(x, y, smooth, [*levels, top], colors=[fill, fill], alpha=0.25)
                    look = {"colors": line["color"], "linewidths": line["lw"], "linestyles": line["ls"]}
                    ax.contour(x, y, smooth, levels, **look)
                _mark(ax.axhline, truth.get(below))
            _mark(ax.axvline, truth.get(across))
            ax.locator_params(nbins=4)
            if row == column:
                ax.set(yticks=[])
            elif column == 0:
                ax.set_ylabel(words.axis(below, units.get(below, "")))
            else:
                ax.tick_params(labelleft=False)
            if row == count - 1:
                ax.set_xlabel(words.axis(across, units.get(across, "")))
            else:
                ax.tick_params(labelbottom=False)
    _legend(figure, _samplers(model, draws), truth)
    return figure


def _densities(ax: Axes, model: str, name: str, draws: Draws, reflected: bool) -> None:
    """Draw the marginal density of a parameter by each sampler that drew it."""
    for i, own in enumerate(draws.values()):
        if name in own:
            grid, height = outline(own[name], reflected)
            line, fill = _strokes(model, i)
            ax.plot(grid, height, **line)
            if fill:
                ax.fill_between(grid, height, color=fill, alpha=0.22, lw=0)
    ax.set(yticks=[], ylim=(0, 1.08))
    ax.spines["left"].set_visible(False)


def _mark(line: Callable[..., object], value: float | None) -> None:
    """Draw a line at a true value if it is known. `line` is `ax.axvline` or `ax.axhline`."""
    if value is not None and np.isfinite(value):
        line(value, **TRUE_LINE_STYLE)


def _strokes(model: str, place: int) -> tuple[dict, str | None]:
    """Return Matplotlib's arguments for the line, and the colour of the fill, of the sampler with this index.

    Only the first sampler is filled; the others are lines over it, for which the colour is None.
    """
    if place == 0:
        return {"color": colour(model), "lw": 1.3, "ls": "-"}, colour(model)
    return {"color": INK, "lw": 1.0, "ls": ("--", ":", "-.")[(place - 1) % 3]}, None


def _samplers(model: str, draws: Draws) -> list[Artist]:
    """Return the legend entries of the samplers."""
    return [Line2D([], [], **_strokes(model, i)[0], label=words.method(s)) for i, s in enumerate(draws)]


def _legend(figure: Figure, handles: Sequence[Artist], truth: Mapping[str, float]) -> None:
    if any(np.isfinite(v) for v in truth.values()):
        handles = [*handles, Line2D([], [], **TRUE_LINE_STYLE, label="truth")]
    figure.legend(handles=handles, loc="outside upper left", ncols=len(handles))
