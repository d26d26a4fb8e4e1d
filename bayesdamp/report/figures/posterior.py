"""Draw posterior draws: histograms of single parameters, and scatter plots of pairs of parameters."""

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from bayesdamp.report import words
from bayesdamp.report.drawing import INK, WIDTH, colour

_BINS = 40
"""Number of bars of a histogram."""
_INNER = (0.0005, 0.9995)
"""Quantiles between which draws are shown; the few draws beyond them would make the rest of a panel too narrow."""
_MOST_POINTS = 500
"""Largest number of draws of a sampler that are drawn as points in a panel."""
TRUE_LINE_STYLE: dict[str, Any] = {"color": INK, "lw": 0.9, "ls": (0, (2, 2))}
"""Style of a line at a true value."""
Draws = Mapping[str, Mapping[str, np.ndarray]]
"""Posterior draws, an array of any shape, by name of the sampler and then of the parameter."""


def marginals(model: str, draws: Draws, units: Mapping[str, str], truth: Mapping[str, float]) -> Figure:
    """Draw histograms of the draws of each parameter.

    Parameters
    ----------
    model
        Name of the model, which determines the colour.
    draws
        Finite draws, of any shape, by sampler and parameter; the histogram of the first sampler is filled.
    units
        Units, by parameter, for the labels of the axes.
    truth
        True values, by parameter; missing or nan if not known.
    """
    names = list(dict.fromkeys(name for own in draws.values() for name in own))
    rows = -(-len(names) // 4)
    columns = max(2, -(-len(names) // rows))
    figure = Figure(figsize=(WIDTH * (1.0 if rows > 1 else min(1.0, 0.26 * columns)), 1.65 * rows + 0.45))
    for i, name in enumerate(names):
        ax = figure.add_subplot(rows, columns, i + 1)
        _histograms(ax, model, name, draws)
        _mark(ax.axvline, truth.get(name))
        ax.set(xlabel=words.axis(name, units.get(name, "")))
        ax.locator_params(axis="x", nbins=4)
    _legend(figure, model, draws, truth)
    return figure


def pairs(
    model: str, names: Sequence[str], draws: Draws, units: Mapping[str, str], truth: Mapping[str, float]
) -> Figure:
    """Draw scatter plots of the draws of each pair of damping coefficients.

    Of each sampler, at most `_MOST_POINTS` draws are shown. The panels on the diagonal have histograms of each
    coefficient.

    Parameters
    ----------
    model
        Name of the model, which determines the colour.
    names
        Names of the coefficients.
    draws
        Finite draws, of any shape, by sampler and parameter.
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
                _histograms(ax, model, across, draws)
            else:
                for i, own in enumerate(draws.values()):
                    x, y = np.ravel(own[across]), np.ravel(own[below])
                    few = np.linspace(0, x.size - 1, min(x.size, _MOST_POINTS)).astype(int)
                    ax.plot(x[few], y[few], ".", ms=3, mew=0, alpha=0.5, color=_look(model, i)["color"])
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
    _legend(figure, model, draws, truth)
    return figure


def _histograms(ax: Axes, model: str, name: str, draws: Draws) -> None:
    """Draw a histogram of a parameter for each sampler that drew it, all with the same area.

    The few draws outside of the quantiles `_INNER` are not shown.
    """
    each = {i: np.ravel(own[name]) for i, own in enumerate(draws.values()) if name in own}
    low, high = np.quantile(np.concatenate(list(each.values())), _INNER)
    for i, values in each.items():
        look = _look(model, i)
        heights, edges = np.histogram(values, _BINS, (low, high), density=True)
        ax.stairs(heights, edges, **look)
        if i == 0:
            ax.stairs(heights, edges, color=look["color"], fill=True, alpha=0.22)
    ax.set(yticks=[], ylim=(0, None))
    ax.spines["left"].set_visible(False)


def _mark(line: Callable[..., object], value: float | None) -> None:
    """Draw a line at a true value if it is known. `line` is `ax.axvline` or `ax.axhline`."""
    if value is not None and np.isfinite(value):
        line(value, **TRUE_LINE_STYLE)


def _look(model: str, place: int) -> dict[str, Any]:
    """Return Matplotlib's arguments (colour, width, style) for the line of the sampler with the index `place`."""
    if place == 0:
        return {"color": colour(model), "lw": 1.3, "ls": "-"}
    return {"color": INK, "lw": 1.0, "ls": ("--", ":", "-.")[(place - 1) % 3]}


def _legend(figure: Figure, model: str, draws: Draws, truth: Mapping[str, float]) -> None:
    """Draw a legend of the samplers, and of the line at the true value if one is known."""
    handles = [Line2D([], [], **_look(model, i), label=words.method(s)) for i, s in enumerate(draws)]
    if any(np.isfinite(v) for v in truth.values()):
        handles.append(Line2D([], [], **TRUE_LINE_STYLE, label="truth"))
    figure.legend(handles=handles, loc="outside upper left", ncols=len(handles))
