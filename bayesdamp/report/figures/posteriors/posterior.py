"""Marginals of all parameters, and the pairs of the damping coefficients."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence

import numpy as np
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from bayesdamp.report import words
from bayesdamp.report.figures.density import contours, outline
from bayesdamp.report.style import INK, WIDTH, colour

_POSITIVE = frozenset({"noise_sd", "noise_time", "epsilon", "stiffness"})
"""Parameters beside the damping coefficients whose densities end at zero."""


def marginals(
    model: str,
    draws: Mapping[str, Mapping[str, np.ndarray]],
    units: Mapping[str, str],
    truth: Mapping[str, float],
    coefficients: Collection[str],
) -> Figure:
    """draws: sampler to parameter to draws of any shape; truth: parameter to value, where known; coefficients: those of
    the damping, which are never negative."""
    names = list(dict.fromkeys(name for found in draws.values() for name in found))
    rows = -(-len(names) // 4)
    columns = max(2, -(-len(names) // rows))
    figure = Figure(figsize=(WIDTH * (1.0 if rows > 1 else min(1.0, 0.26 * columns)), 1.65 * rows + 0.45))
    for i, name in enumerate(names):
        ax = figure.add_subplot(rows, columns, i + 1)
        for sampler, found in draws.items():
            if name not in found:
                continue
            grid, height = outline(found[name], name in _POSITIVE or name in coefficients)
            line, fill = _strokes(model, sampler, list(draws))
            ax.plot(grid, height, **line)
            if fill:
                ax.fill_between(grid, height, color=fill, alpha=0.22, lw=0)
        if np.isfinite(truth.get(name, np.nan)):
            ax.axvline(truth[name], color=INK, lw=0.9, ls=(0, (2, 2)))
        ax.set_xlabel(words.axis(name, units.get(name, "")))
        ax.set_yticks([])
        ax.set_ylim(0, 1.08)
        ax.spines["left"].set_visible(False)
        ax.locator_params(axis="x", nbins=4)
    _legend(figure, model, list(draws), truth)
    return figure


def pairs(
    model: str,
    names: Sequence[str],
    draws: Mapping[str, Mapping[str, np.ndarray]],
    units: Mapping[str, str],
    truth: Mapping[str, float],
) -> Figure:
    """The damping coefficients against each other: contours of 50 % and 90 % of the posterior's mass."""
    count = len(names)
    figure = Figure(figsize=(2.5 * count + 0.4, 2.3 * count + 0.4))
    for row, below in enumerate(names):
        for column, across in enumerate(names[: row + 1]):
            ax = figure.add_subplot(count, count, row * count + column + 1)
            for sampler, found in draws.items():
                line, fill = _strokes(model, sampler, list(draws))
                if row == column:
                    grid, height = outline(found[across], reflected=True)
                    ax.plot(grid, height, **line)
                    if fill:
                        ax.fill_between(grid, height, color=fill, alpha=0.22, lw=0)
                    continue
                x, y, smooth, levels = contours(found[across], found[below], (True, True))
                if fill:
                    ax.contourf(x, y, smooth, [*levels, smooth.max() * 1.01], colors=[fill, fill], alpha=0.25)
                ax.contour(
                    x, y, smooth, levels, colors=line["color"], linewidths=line["lw"], linestyles=line["ls"]
                )
            _mark_truth(ax, across, None if row == column else below, truth)
            ax.locator_params(nbins=4)
            if row == column:
                ax.set_ylim(0, 1.08)
                ax.set_yticks([])
                ax.spines["left"].set_visible(False)
            elif column == 0:
                ax.set_ylabel(words.axis(below, units.get(below, "")))
            else:
                ax.tick_params(labelleft=False)
            if row == count - 1:
                ax.set_xlabel(words.axis(across, units.get(across, "")))
            else:
                ax.tick_params(labelbottom=row == column == 0 and count == 1)
    _legend(figure, model, list(draws), truth)
    return figure


def _mark_truth(ax, across: str, below: str | None, truth: Mapping[str, float]) -> None:
    if np.isfinite(truth.get(across, np.nan)):
        ax.axvline(truth[across], color=INK, lw=0.9, ls=(0, (2, 2)))
    if below and np.isfinite(truth.get(below, np.nan)):
        ax.axhline(truth[below], color=INK, lw=0.9, ls=(0, (2, 2)))


def _strokes(model: str, sampler: str, samplers: Sequence[str]) -> tuple[dict, str | None]:
    """The first sampler is filled in the model's colour, the others are lines over it."""
    place = samplers.index(sampler)
    if place == 0:
        return {"color": colour(model), "lw": 1.3, "ls": "-"}, colour(model)
    return {"color": INK, "lw": 1.0, "ls": ("--", ":", "-.")[(place - 1) % 3]}, None


def _legend(figure: Figure, model: str, samplers: Sequence[str], truth: Mapping[str, float]) -> None:
    handles = [Line2D([], [], **_strokes(model, s, samplers)[0], label=words.method(s)) for s in samplers]
    if any(np.isfinite(v) for v in truth.values()):
        handles.append(Line2D([], [], color=INK, lw=0.9, ls=(0, (2, 2)), label="truth"))
    figure.legend(handles=handles, loc="outside upper left", ncols=len(handles))
