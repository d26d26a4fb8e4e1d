"""Draw the errors of estimators: ranked, by signal, and along a factor."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from bayesdamp import formatting as fmt
from bayesdamp.report import words
from bayesdamp.report.results.comparing import STAGES, Comparison
from bayesdamp.report.results.sweeping import FACTORS, Series
from bayesdamp.report.style import FAINT, INK, QUIET, WIDTH

FLOOR = 1e-8
"""Errors below this share of a per cent are drawn at it: rounding."""
THRESHOLD = 0.1
"""The paper's line between good and other methods, per cent."""
_INITIAL, _REFINED = "#E69F00", "#0072B2"


def ranking(found: Comparison) -> Figure:
    """Mean error of each method at both stages, beside the published mean; best initial stage at the top."""
    methods = sorted(found.methods, key=lambda m: np.nan_to_num(found.mean(m, "initial"), nan=np.inf))
    figure = Figure(figsize=(WIDTH, 0.34 * len(methods) + 1.0))
    ax = figure.add_subplot()
    for row, method in enumerate(methods):
        ax.axhline(row, color=FAINT, lw=0.5, zorder=0.5)
        ends = [found.mean(method, s) for s in ("initial", "refined")]
        if np.all(np.isfinite(ends)):
            ax.plot(np.maximum(ends, FLOOR), [row, row], color=FAINT, lw=2.5, zorder=0.7)
        _point(ax, ends[0], row, "o", "white", _INITIAL)
        _point(ax, ends[1], row, "o", _REFINED, _REFINED)
        _point(ax, found.mean_published(method), row, "|", INK, INK, size=11)
    for marker, face, edge, label in (
        ("o", "white", _INITIAL, words.stage("initial")),
        ("o", _REFINED, _REFINED, words.stage("refined")),
        ("|", INK, INK, "published"),
    ):
        if label != "published" or found.published:
            ax.plot([], [], ls="", marker=marker, mfc=face, mec=edge, label=label)
    ax.set_xscale("log")
    ax.axvline(THRESHOLD, color=QUIET, lw=0.8, ls=(0, (3, 2)))
    ax.set_yticks(range(len(methods)), [words.method(m) for m in methods])
    ax.set_ylim(len(methods) - 0.4, -0.6)
    ax.tick_params(axis="y", length=0)
    ax.spines["left"].set_visible(False)
    ax.set_xlabel("mean error / %")
    figure.legend(loc="outside upper left", ncols=4)
    return figure


def _point(ax: Axes, error: float, row: int, marker: str, face: str, edge: str, size: float = 5.5) -> None:
    if np.isfinite(error):
        ax.plot(max(error, FLOOR), row, marker, ms=size, mfc=face, mec=edge, mew=1.3)


_COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#56B4E9", "#E69F00", "#8C564B", "#7F3C8D", "#222222")
_MARKS = "osD^vP*Xph<>"
LOWEST, HIGHEST = 1e-7, 1e3


def sweep(found: Series, methods: list[str]) -> Figure:
    """Left the initial stage, right the refined one; both axes logarithmic, a value of 0 at the left edge."""
    figure = Figure(figsize=(WIDTH, 3.3))
    axes = np.atleast_1d(figure.subplots(1, 2, sharey=True))
    positive = [v for v in found.values if v > 0]
    x = np.array([v if v > 0 else 0.3 * min(positive) for v in found.values])
    for ax, stage in zip(axes, STAGES):
        for i, method in enumerate(methods):
            errors = found.errors.get((method, stage))
            if errors is None:
                continue
            y = np.clip(np.array(errors, float), LOWEST, HIGHEST)
            look = {"color": _COLOURS[i % len(_COLOURS)], "marker": _MARKS[i % len(_MARKS)]}
            dash = "-" if i < len(_COLOURS) else "--"
            repeats = max(tried for _, tried in found.answers[method, stage])
            label = f"{words.method(method)}, {repeats}"
            ax.plot(x, y, lw=0.9, ls=dash, ms=4, mfc="white", label=label, **look)
        ax.plot(x, found.bounds, color=INK, lw=1.4, ls=(0, (3, 2)), label="Cramér–Rao bound")
        _finish(ax, x, found)
        ax.set_title(words.stage(stage))
    axes[0].set_ylabel("rms error / %")
    handles, labels = axes[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside right upper", title="method, repeats")
    return figure


def _finish(ax: Axes, x: np.ndarray, found: Series) -> None:
    ax.set(xscale="log", yscale="log", xlabel=FACTORS[found.factor])
    ax.set_xticks(x, [fmt.given(v) for v in found.values])
    ax.minorticks_off()
