"""Draw how iterative estimators converge."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import NullFormatter

from bayesdamp.report.style import INK, WIDTH


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
