"""Draw log Bayes factors and probabilities, what they depend on, and the average over models."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from matplotlib.figure import Figure

from bayesdamp import formatting as fmt
from bayesdamp.report import words
from bayesdamp.report.style import FAINT, INK, WIDTH, colour, legend_above, looks


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
