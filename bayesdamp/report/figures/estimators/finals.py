"""What every method gives in the end, one panel a signal."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from matplotlib.figure import Figure

from bayesdamp.report import words
from bayesdamp.report.figures._panels import panels
from bayesdamp.report.style import FAINT, INK, QUIET, colour, legend_above

Values = Mapping[tuple[str, str, str], float]


def finals(
    values: Values, truths: Mapping[str, float], axes_labels: Mapping[str, str], models: Mapping[str, str]
) -> Figure:
    """values: (method, signal, stage) to the coefficient. The axis shows 6 % about the truth; arrows beyond."""
    methods = list(dict.fromkeys(key[0] for key in values))
    signals = list(truths)
    figure, axes, firsts = panels(len(signals), 0.31 * len(methods) + 0.8, 0.3)
    for ax, signal in zip(axes, signals):
        true, shade = truths[signal], colour(models[signal])
        low, high = 0.94 * true, 1.06 * true
        ax.axvline(true, color=INK, lw=0.9, ls=(0, (2, 2)))
        for row, method in enumerate(methods):
            ax.axhline(row, color=FAINT, lw=0.5, zorder=0.5)
            for stage, face, shift in (("initial", "white", -0.15), ("refined", shade, 0.15)):
                value = values.get((method, signal, stage), np.nan)
                if low <= value <= high:
                    ax.plot(value, row + shift, "o", ms=4.2, mfc=face, mec=shade, mew=1.0)
                elif np.isfinite(value):
                    left = value < low
                    text = words.number(value, 3)
                    ax.annotate(
                        f"◂ {text}" if left else f"{text} ▸",
                        (0.0 if left else 1.0, row + shift),
                        xycoords=("axes fraction", "data"),
                        ha="left" if left else "right",
                        va="center",
                        fontsize=7,
                        color=QUIET,
                    )
        ax.set_xlim(low, high)
        ax.set_ylim(len(methods) - 0.4, -0.6)
        ax.set_title(signal)
        ax.set_xlabel(axes_labels[signal])
        ax.locator_params(axis="x", nbins=4)
        ax.tick_params(axis="y", length=0)
        ax.spines["left"].set_visible(False)
    for ax in firsts:
        ax.set_yticks(range(len(methods)), [words.method(m) for m in methods])
    for face, label in (("white", "initial"), (QUIET, "refined")):
        axes[0].plot([], [], "o", ms=4.5, mfc=face, mec=QUIET, label=label)
    axes[0].plot([], [], color=INK, lw=0.9, ls=(0, (2, 2)), label="truth")
    legend_above(figure)
    return figure
