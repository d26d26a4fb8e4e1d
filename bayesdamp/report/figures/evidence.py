"""Draw log Bayes factors and probabilities, and what they depend on."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.figure import Figure

from bayesdamp import formatting as fmt
from bayesdamp.report.results.reading import label
from bayesdamp.report.results.run import Row
from bayesdamp.report.style import FAINT, INK, WIDTH, colour


def bars(rows: Sequence[Row]) -> Figure:
    """Draw rows of evidence.csv, best first. The axis is linear to one nat and logarithmic beyond."""
    figure = Figure(figsize=(WIDTH, 0.34 * len(rows) + 1.05))
    left, right = figure.subplots(1, 2, sharey=True, width_ratios=[3, 2])
    places = np.arange(len(rows))
    look = {"color": [colour(row["model"]) for row in rows], "height": 0.62}
    behind = [max(0.0, -row["log_bayes_factor"]) for row in rows]
    texts = [
        "not weighed" if not np.isfinite(row["log_bayes_factor"]) else fmt.nats(-length) if length else "best"
        for row, length in zip(rows, behind, strict=True)
    ]
    left.bar_label(left.barh(places, behind, **look), texts, padding=5, fontsize=8)
    reach = max(10.0, *behind) if behind else 10.0
    left.set_xscale("symlog", linthresh=1.0, linscale=0.6)
    left.set_xlim(0, reach**1.75)
    shown = [tick for tick in (0, 1, 3, 10, 100, 1000, 10_000, 100_000, 1_000_000) if tick <= reach * 1.05]
    left.set_xticks(shown, [f"−{tick:,}" if tick else "0" for tick in shown])
    left.set_xticks([], minor=True)
    for tick in shown[1:]:
        left.axvline(tick, color=FAINT, lw=0.6, zorder=0.5)
    left.set_xlabel("log Bayes factor to the best model / nats")
    left.set_yticks(places, list(map(label, rows)))
    left.invert_yaxis()
    probabilities = [row["probability"] for row in rows]
    texts = list(map(fmt.probability, probabilities))
    right.bar_label(right.barh(places, probabilities, **look), texts, padding=5, fontsize=8, color=INK)
    right.set(xlim=(0, 1.22), xticks=[0, 0.25, 0.5, 0.75, 1.0], xlabel="probability of the model")
    for ax in (left, right):
        ax.tick_params(axis="y", length=0)
    return figure
