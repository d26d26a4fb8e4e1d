"""What the evidence depends on, and what remains when the models are averaged."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from matplotlib.figure import Figure

from bayesdamp.report import words
from bayesdamp.report.style import FAINT, INK, WIDTH, colour, legend_above, looks

INTERVAL = 1.96
"""Half-width of a central 95 % interval in sds."""
PANELS = 3


@dataclass(frozen=True)
class Line:
    """One model: log Bayes factor (nats) at each factor on the priors' widths, shape (m,). anew, trusted: where it was
    sampled anew, where its diagnostics are good."""

    model: str
    log_bayes_factor: np.ndarray
    anew: np.ndarray
    trusted: np.ndarray


def widths(factors: np.ndarray, lines: Sequence[Line]) -> Figure:
    """Log Bayes factors against the factor; linear to one nat, logarithmic beyond. Open: sampled anew; ×: poor."""
    figure = Figure(figsize=(WIDTH * 0.7, 2.7))
    ax = figure.subplots()
    ax.axvline(1.0, color=FAINT, lw=0.8, zorder=0.5)
    for line, (shown, dashes) in zip(lines, looks(line.model for line in lines).values(), strict=True):
        y = line.log_bayes_factor
        ax.plot(factors, y, color=shown, ls=dashes, label=words.model(line.model))
        for chosen, mark, face in (
            (line.trusted & ~line.anew, "o", shown),
            (line.trusted & line.anew, "o", "white"),
            (~line.trusted, "X", shown),
        ):
            ax.plot(factors[chosen], y[chosen], mark, color=shown, markerfacecolor=face, markersize=4)
    ax.set_xscale("log")
    values = np.concatenate([line.log_bayes_factor for line in lines])
    if np.abs(values[np.isfinite(values)]).max(initial=0.0) > 20.0:
        ax.set_yscale("symlog", linthresh=1.0, linscale=0.6)
    ax.set_xticks([0.1, 0.3, 1, 3, 10], ["0.1", "0.3", "1", "3", "10"])
    ax.set_xticks([], minor=True)
    ax.set_xlabel("factor on the width of the damping's priors")
    ax.set_ylabel("log Bayes factor / nats")
    legend_above(figure)
    return figure


def prediction(models: Mapping[str, tuple[np.ndarray, np.ndarray, np.ndarray]], unit: str) -> Figure:
    """Model to times (s), errors of the prediction and its predictive sds, each of shape (m,): a panel a model."""
    figure = Figure(figsize=(WIDTH, 1.5 * len(models) + 0.3))
    panels = figure.subplots(len(models), 1, sharex=True, squeeze=False)[:, 0]
    for ax, (model, (t, error, sd)) in zip(panels, models.items()):
        ax.fill_between(t, -INTERVAL * sd, INTERVAL * sd, color=colour(model), alpha=0.2, lw=0)
        ax.plot(t, error, ".", color=colour(model), ms=2)
        ax.set_title(words.model(model))
        ax.set_ylabel(f"error / {unit}")
    panels[-1].set_xlabel("time / s")
    return figure


def averaged(
    amplitudes: np.ndarray,
    band: np.ndarray,
    models: dict[str, tuple[np.ndarray, np.ndarray]],
    unit: str,
) -> Figure:
    """band: quantiles 2.5, 50 and 97.5 % of the average, shape (3, m); models: model to its amplitudes and median."""
    figure = Figure(figsize=(WIDTH * 0.7, 2.7))
    ax = figure.subplots()
    low, median, high = band
    ax.fill_between(amplitudes, low, high, color=INK, alpha=0.18, lw=0)
    ax.plot(amplitudes, median, color=INK, lw=1.8, label="average")
    for model, (shade, dashes) in looks(models).items():
        ax.plot(*models[model], color=shade, ls=dashes, lw=1.0, label=words.model(model))
    ax.set_xlabel(f"amplitude / {unit}")
    ax.set_ylabel(words.axis("equivalent_ratio", ""))
    ax.set_ylim(0, 1.6 * float(high.max()))
    legend_above(figure)
    return figure
