"""Draw posteriors: marginals, pairs, running estimates, and intervals of several records."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from matplotlib.artist import Artist
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from bayesdamp.report import words
from bayesdamp.report.figures.curves import contours, outline
from bayesdamp.report.style import FAINT, INK, QUIET, WIDTH, colour

TRUE: dict[str, Any] = {"color": INK, "lw": 0.9, "ls": (0, (2, 2))}
"""How a true value is drawn."""
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
        _mark(ax.axvline, truth.get(name))
        ax.set(xlabel=words.axis(name, units.get(name, "")), yticks=[], ylim=(0, 1.08))
        ax.spines["left"].set_visible(False)
        ax.locator_params(axis="x", nbins=4)
    _legend(figure, _samplers(model, list(draws)), truth)
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
            _mark(ax.axvline, truth.get(across))
            _mark(ax.axhline, None if row == column else truth.get(below))
            ax.locator_params(nbins=4)
            if row == column:
                ax.set(ylim=(0, 1.08), yticks=[])
                ax.spines["left"].set_visible(False)
            elif column == 0:
                ax.set_ylabel(words.axis(below, units.get(below, "")))
            else:
                ax.tick_params(labelleft=False)
            if row == count - 1:
                ax.set_xlabel(words.axis(across, units.get(across, "")))
            else:
                ax.tick_params(labelbottom=row == column == 0 and count == 1)
    _legend(figure, _samplers(model, list(draws)), truth)
    return figure


def _mark(line: Callable[..., object], value: float | None) -> None:
    """Draw a line at a true value where that is known."""
    if value is not None and np.isfinite(value):
        line(value, **TRUE)


def _strokes(model: str, sampler: str, samplers: Sequence[str]) -> tuple[dict, str | None]:
    """The first sampler is filled in the model's colour, the others are lines over it."""
    place = samplers.index(sampler)
    if place == 0:
        return {"color": colour(model), "lw": 1.3, "ls": "-"}, colour(model)
    return {"color": INK, "lw": 1.0, "ls": ("--", ":", "-.")[(place - 1) % 3]}, None


def _legend(figure: Figure, handles: Sequence[Artist], truth: Mapping[str, float]) -> None:
    if any(np.isfinite(v) for v in truth.values()):
        handles = [*handles, Line2D([], [], **TRUE, label="truth")]
    figure.legend(handles=handles, loc="outside upper left", ncols=len(handles))


def _samplers(model: str, samplers: Sequence[str]) -> list[Artist]:
    return [Line2D([], [], **_strokes(model, s, samplers)[0], label=words.method(s)) for s in samplers]


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
        _mark(ax.axhline, truth.get(name))
        late = t >= t[0] + SETTLING * (t[-1] - t[0])
        bottom, top = float(low[late].min()), float(high[late].max())
        ax.set(
            ylim=(max(bottom - 0.1 * (top - bottom), 0.0), top + 0.1 * (top - bottom)),
            ylabel=words.axis(name, units.get(name, "")),
        )
    figure.axes[-1].set_xlabel("time / s")
    handles: list[Artist] = [
        Patch(color=colour(model), alpha=0.35, label="estimate from the record so far, ± 2 sd"),
        Line2D([], [], color=QUIET, lw=0.9, ls=(0, (3, 2)), label="first pass"),
    ]
    _legend(figure, handles, truth)
    return figure


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
