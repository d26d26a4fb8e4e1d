"""Log Bayes factors and probabilities of the models."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from matplotlib.figure import Figure

from bayesdamp import formatting as fmt
from bayesdamp.report.style import FAINT, INK, WIDTH, colour


@dataclass(frozen=True)
class Bar:
    """One model: log Bayes factor to the best (nats, at most 0; nan where there is none), its stderr, probability."""

    model: str
    label: str
    log_bayes_factor: float
    stderr: float
    probability: float


def bars(found: Sequence[Bar]) -> Figure:
    """Best first. The axis is linear to one nat and logarithmic beyond."""
    figure = Figure(figsize=(WIDTH, 0.34 * len(found) + 1.05))
    left, right = figure.subplots(1, 2, sharey=True, width_ratios=[3, 2])
    places = np.arange(len(found))
    colours = [colour(bar.model) for bar in found]
    behind = [max(0.0, -bar.log_bayes_factor) for bar in found]
    left.barh(places, behind, color=colours, height=0.62)
    for place, length, bar in zip(places, behind, found):
        text = "best" if length == 0 else fmt.nats(-length)
        text = text if np.isfinite(bar.log_bayes_factor) else "not weighed"
        left.annotate(
            text, (length, place), xytext=(5, 0), textcoords="offset points", va="center", fontsize=8
        )
    reach = max(10.0, *behind) if behind else 10.0
    left.set_xscale("symlog", linthresh=1.0, linscale=0.6)
    left.set_xlim(0, reach**1.75)
    shown = [tick for tick in (0, 1, 3, 10, 100, 1000, 10_000, 100_000, 1_000_000) if tick <= reach * 1.05]
    left.set_xticks(shown, [f"−{tick:,}" if tick else "0" for tick in shown])
    left.set_xticks([], minor=True)
    for tick in shown[1:]:
        left.axvline(tick, color=FAINT, lw=0.6, zorder=0.5)
    left.set_xlabel("log Bayes factor to the best model / nats")
    left.set_yticks(places, [bar.label for bar in found])
    left.invert_yaxis()
    right.barh(places, [bar.probability for bar in found], color=colours, height=0.62)
    for place, bar in zip(places, found):
        right.annotate(
            fmt.probability(bar.probability),
            (bar.probability, place),
            xytext=(5, 0),
            textcoords="offset points",
            va="center",
            fontsize=8,
            color=INK,
        )
    right.set_xlim(0, 1.22)
    right.set_xticks([0, 0.25, 0.5, 0.75, 1.0])
    right.set_xlabel("probability of the model")
    for ax in (left, right):
        ax.tick_params(axis="y", length=0)
    return figure
