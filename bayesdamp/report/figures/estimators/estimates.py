"""Point estimates of every method over the posterior's density."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from bayesdamp import formatting as fmt
from bayesdamp.report import words
from bayesdamp.report.figures._panels import off_axis
from bayesdamp.report.figures.density import outline
from bayesdamp.report.style import FAINT, INK, WIDTH, colour

_STAGES = ("initial", "refined")


@dataclass(frozen=True)
class Point:
    """One estimate of one coefficient; stderr is nan where the method has none."""

    estimator: str
    stage: str
    value: float
    stderr: float


def estimates(
    model: str,
    points: Mapping[str, Sequence[Point]],
    draws: Mapping[str, np.ndarray],
    units: Mapping[str, str],
    truth: Mapping[str, float],
) -> Figure:
    """points, draws, units, truth: by coefficient. A point off the axis is an arrow with its value."""
    names = list(points)
    methods = list(dict.fromkeys(p.estimator for found in points.values() for p in found))
    figure = Figure(figsize=(WIDTH, 0.31 * len(methods) + 1.15))
    axes = np.atleast_1d(figure.subplots(1, len(names), sharey=True))
    for ax, name in zip(axes, names):
        _one(ax, model, points[name], methods, draws.get(name), truth.get(name, np.nan))
        ax.set_xlabel(words.axis(name, units.get(name, "")))
    axes[0].set_yticks(range(len(methods)), [words.method(m) for m in methods])
    figure.legend(handles=_handles(model, bool(draws), truth), loc="outside upper left", ncols=4)
    return figure


def _one(
    ax: Axes,
    model: str,
    points: Sequence[Point],
    methods: Sequence[str],
    draws: np.ndarray | None,
    truth: float,
) -> None:
    low, high = _window([p.value for p in points], draws, truth)
    top, bottom = -0.6, len(methods) - 0.4
    if draws is not None:
        grid, height = outline(draws, reflected=True)
        ax.fill_between(
            grid, bottom, bottom - height * (bottom - top) * 0.94, color=colour(model), alpha=0.18, lw=0
        )
    if np.isfinite(truth):
        ax.axvline(truth, color=INK, lw=0.9, ls=(0, (2, 2)))
    for row in range(len(methods)):
        ax.axhline(row, color=FAINT, lw=0.5, zorder=0.5)
    outside: dict[tuple[float, bool], list[float]] = {}
    for point in points:
        refined = point.stage != _STAGES[0]
        y = methods.index(point.estimator) + (0.15 if refined else -0.15)
        face = colour(model) if refined else "white"
        if not low <= point.value <= high:
            outside.setdefault((y, point.value < low), []).append(point.value)
            continue
        error = point.stderr if np.isfinite(point.stderr) else 0.0
        if error:
            ax.plot([point.value - error, point.value + error], [y, y], color=colour(model), lw=0.9)
        ax.plot(point.value, y, "o", ms=4.2, mfc=face, mec=colour(model), mew=1.0)
    for (y, left), values in outside.items():
        text = fmt.number(values[0], 3) if len(values) == 1 else f"{len(values)} repeats"
        off_axis(ax, text, left, y)
    room = 0.16 * (high - low)
    low -= room * any(left for _, left in outside)
    high += room * any(not left for _, left in outside)
    ax.set_xlim(low, high)
    ax.set_ylim(bottom, top)
    ax.locator_params(axis="x", nbins=5)
    ax.tick_params(axis="y", length=0)
    ax.spines["left"].set_visible(False)


def _window(values: Sequence[float], draws: np.ndarray | None, truth: float) -> tuple[float, float]:
    """Limits that show the posterior and most estimates, and keep the posterior wide enough to be seen."""
    finite = np.array([v for v in values if np.isfinite(v)])
    anchors = [truth] if np.isfinite(truth) else []
    if draws is not None:
        anchors.append(float(np.median(draws)))
    centre = anchors[-1] if anchors else float(np.median(finite))
    distances = np.sort(np.abs(finite - centre))
    reach = 1.2 * distances[max(0, int(np.ceil(0.85 * len(distances))) - 1)] if len(distances) else 0.0
    if draws is not None:
        spread = float(np.std(draws))
        reach = min(max(reach, 5 * spread), 40 * spread)
    if np.isfinite(truth):
        reach = max(reach, 1.3 * abs(truth - centre))
    reach = reach or 0.1 * abs(centre) or 1.0
    return centre - reach, centre + reach


def _handles(model: str, posterior: bool, truth: Mapping[str, float]) -> list[Line2D | Patch]:
    kinds: list[Line2D | Patch] = [
        Line2D(
            [], [], ls="", marker="o", ms=4.5, mfc="white", mec=colour(model), label=words.stage("initial")
        ),
        Line2D(
            [],
            [],
            ls="",
            marker="o",
            ms=4.5,
            mfc=colour(model),
            mec=colour(model),
            label=words.stage("refined"),
        ),
    ]
    if posterior:
        kinds.append(Patch(color=colour(model), alpha=0.18, lw=0, label="posterior"))
    if any(np.isfinite(v) for v in truth.values()):
        kinds.append(Line2D([], [], color=INK, lw=0.9, ls=(0, (2, 2)), label="truth"))
    return kinds
