"""Whether probabilities are what they say: the share that was right against the probability that was given."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from bayesdamp.report import words
from bayesdamp.report.style import INK, QUIET, WIDTH


def reliability(bins: Sequence[Mapping[str, Any]]) -> Figure:
    """bins: probability, share, low, high and records of each."""
    figure = Figure(figsize=(0.5 * WIDTH, 0.45 * WIDTH))
    ax = figure.subplots()
    p, share, low, high = (
        np.array([b[k] for b in bins], float) for k in ("probability", "share", "low", "high")
    )
    ax.plot([0, 1], [0, 1], color=QUIET, lw=0.8)
    ax.vlines(p, low, high, color=QUIET, lw=5, alpha=0.4)
    ax.plot(p, share, "o", color="#0072B2", ms=5)
    for x, y, b in zip(p, share, bins):
        ax.annotate(str(b["records"]), (x, y), (-6, 4), textcoords="offset points", ha="right", fontsize=7.5)
    ax.set(
        xlim=(0, 1.02), ylim=(0, 1.02), xlabel="probability of the best model", ylabel="share that was right"
    )
    return figure


def confusion(models: Sequence[str], counts: np.ndarray) -> Figure:
    """counts: true model by the most probable one, (m, m)."""
    size = 0.62 * len(models) + 1.8
    figure = Figure(figsize=(min(size + 1.2, WIDTH), size))
    ax = figure.subplots()
    rows = counts / np.maximum(counts.sum(axis=1, keepdims=True), 1)
    ax.imshow(rows, cmap="Blues", vmin=0, vmax=1)
    for i, j in np.ndindex(counts.shape):
        if counts[i, j]:
            colour = "white" if rows[i, j] > 0.6 else INK
            ax.text(j, i, str(int(counts[i, j])), ha="center", va="center", color=colour, fontsize=8)
    labels = [words.model(m) for m in models]
    ax.set_xticks(range(len(models)), labels, rotation=40, ha="right")
    ax.set_yticks(range(len(models)), labels)
    ax.set(xlabel="most probable", ylabel="true")
    ax.tick_params(length=0)
    return figure
