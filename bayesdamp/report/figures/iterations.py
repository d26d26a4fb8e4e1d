"""Draw how iterative estimators converge."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import NullFormatter

from bayesdamp.report import words
from bayesdamp.report.style import FAINT, INK, WIDTH, colour

Courses = Mapping[tuple[str, str], np.ndarray]


def convergence(
    courses: Courses, truths: Mapping[str, float], parameters: Mapping[str, str], models: Mapping[str, str]
) -> Figure:
    """courses: (method, signal) to the coefficient after each iteration, shape (n,); the others by signal."""
    methods = list(dict.fromkeys(method for method, _ in courses))
    signals = list(dict.fromkeys(signal for _, signal in courses))
    figure = Figure(figsize=(WIDTH, 1.75 * len(methods) + 0.1))
    axes = figure.subplots(len(methods), len(signals), squeeze=False)
    for i, method in enumerate(methods):
        for j, signal in enumerate(signals):
            ax = axes[i, j]
            course = courses.get((method, signal))
            if course is None:
                ax.set_axis_off()
                continue
            ax.axhline(truths[signal], color=INK, lw=0.9, ls=(0, (2, 2)))
            ax.axhspan(0.99 * truths[signal], 1.01 * truths[signal], color=FAINT, alpha=0.6, lw=0)
            ax.plot(np.arange(len(course)), course, color=colour(models[signal]), lw=1.1)
            ax.set_title(f"{words.method(method)}, {signal}", fontsize=8.5)
            ax.set_ylabel(words.symbol(parameters[signal]).math)
            if i == len(methods) - 1:
                ax.set_xlabel("iteration")
    return figure


def traces(found: Mapping[str, np.ndarray]) -> Figure:
    """found: title to curve, shape (n,). Logarithmic where all values are positive and span two decades."""
    columns = min(4, len(found))
    rows = -(-len(found) // columns)
    figure = Figure(figsize=(WIDTH * max(0.3, columns / 4), 1.6 * rows + 0.1))
    for i, (title, curve) in enumerate(found.items()):
        ax = figure.add_subplot(rows, columns, i + 1)
        ax.plot(np.arange(len(curve)), curve, color=INK, lw=0.9)
        finite = curve[np.isfinite(curve)]
        if finite.size and finite.min() > 0 and finite.max() > 100 * finite.min():
            ax.set_yscale("log")
            ax.yaxis.set_minor_formatter(NullFormatter())
        ax.set_title(title, fontsize=8)
        ax.set_xlabel("iteration")
    return figure
