"""Draw the errors of estimators along a factor."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure

from bayesdamp import formatting as fmt
from bayesdamp.report import words
from bayesdamp.report.results.comparing import STAGES
from bayesdamp.report.results.sweeping import FACTORS, Series
from bayesdamp.report.style import INK, WIDTH

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
        ax.set(xscale="log", yscale="log", xlabel=FACTORS[found.factor])
        ax.set_xticks(x, [fmt.given(v) for v in found.values])
        ax.minorticks_off()
        ax.set_title(words.stage(stage))
    axes[0].set_ylabel("rms error / %")
    handles, labels = axes[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside right upper", title="method, repeats")
    return figure
