"""Draw a record: with the fits of models, with the parts that are used, or with the amplitudes of its oscillations."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from bayesdamp.report import words
from bayesdamp.report.drawing import (
    FAINT,
    INK,
    INKS,
    LOOKS,
    MUTED,
    WIDTH,
    colour,
    fix_margins,
    interrupt_at_gaps,
    label_with_plain_numbers,
    legend_columns,
    looks,
)
from bayesdamp.types import DERIVATIVES, FreeDecay
from bayesdamp.verdict.parts import Oscillation

USED, NOT_USED = "#0072B2", "#56B4E9"
"""Colours of the free decay that is used, and of other free decays."""
_POINTS = 2000
"""Default number of points to which a line is thinned."""
_MOST_LAG_LINES = 200
"""Largest number of lags for which an autocorrelation is drawn as separate lines; with more it is drawn as an area."""
HEIGHT = 2.7
"""Height of a panel of `draw_motions`, in inches."""
LEAST_AXIS_RATIO = 2.0
"""Smallest ratio of the upper to the lower end of an axis of amplitudes, so that a nearly constant amplitude looks
constant."""
_AMPLITUDE_POINTS = 200
"""Number of times at which an amplitude is drawn."""


@dataclass(frozen=True)
class ModelFit:
    """The fit of one model at its posterior mode.

    Attributes
    ----------
    model
        Name of the model.
    fit, residual
        The fit and the residual (record minus fit) at the record's times, (n,), in the displayed unit.
    autocorrelation
        Autocorrelation of the whitened residual from lag 0 on, (lags,); empty if it is not stored.
    rms
        Root mean square of the residual as text, with its unit.
    """

    model: str
    fit: np.ndarray
    residual: np.ndarray
    autocorrelation: np.ndarray
    rms: str


def record(
    t: np.ndarray, y: np.ndarray, fits: Sequence[ModelFit], axis: str, unit: str, period: float
) -> Figure:
    """Draw a record, its first and last cycles with the fits, and the residuals with their autocorrelations.

    These cycles are three periods each, but at most half of the record.

    Parameters
    ----------
    t, y
        The record, (n,), in s and in the displayed unit.
    fits
        The fits, at least one, the best first.
    axis
        Label of y.
    unit
        Unit of y, as it is written on an axis.
    period
        Period of the oscillation in s.
    """
    heights = [1.9, 1.9, 1.05 * len(fits)]
    figure = Figure(figsize=(WIDTH, sum(heights) + 0.4))
    grid = figure.add_gridspec(3, 1, height_ratios=heights)
    whole, best = figure.add_subplot(grid[0]), fits[0]
    whole.plot(*thin_line(t, y), color=FAINT, lw=1.6, label="record")
    label = f"fit of {words.model(best.model)}"
    whole.plot(*thin_line(t, best.fit), color=colour(best.model), lw=0.6, label=label)
    whole.legend(loc="upper right", ncols=2, borderaxespad=0.1)
    _finish(whole, axis, "Record and best fit")
    whole.set(xlabel="time / s", xlim=(t[0], t[-1]))
    length = min(3.0 * period, 0.5 * (t[-1] - t[0]))
    first, last = (figure.add_subplot(place) for place in grid[1].subgridspec(1, 2))
    _zoom(first, t, y, fits, t[0], t[0] + length)
    _zoom(last, t, y, fits, t[-1] - length, t[-1])
    _finish(first, axis, "The first cycles and their fits")
    _finish(last, "", "The last cycles and their fits")
    # A row for each fit: left its residual, right the autocorrelation of the residual.
    lags = max(len(fit.autocorrelation) for fit in fits)
    places = grid[2].subgridspec(len(fits), 2, width_ratios=[2, 1])
    for i, fit in enumerate(fits):
        shade, is_last = colour(fit.model), i == len(fits) - 1
        left, right = figure.add_subplot(places[i, 0]), figure.add_subplot(places[i, 1])
        left.plot(*thin_line(t, fit.residual), color=shade, lw=0.5)
        left.axhline(0.0, color=MUTED, lw=0.6)
        reach = 1.15 * float(np.nanmax(np.abs(fit.residual), initial=0.0)) or 1.0
        left.set(ylim=(-reach, reach), xlim=(t[0], t[-1]))
        _finish(left, unit, f"Residual of {words.model(fit.model)}, rms {fit.rms}")
        values, at = fit.autocorrelation, np.arange(len(fit.autocorrelation))
        if len(values):
            right.axhspan(-2 / np.sqrt(len(t)), 2 / np.sqrt(len(t)), color=FAINT, lw=0)
            if len(values) <= _MOST_LAG_LINES:
                right.vlines(at, 0, values, color=shade)
            else:
                right.fill_between(at, 0, values, color=shade, lw=0.5)
            right.axhline(0.0, color=MUTED, lw=0.6)
            right.set(xlim=(-0.5, lags - 0.5), ylim=(-1.05 if values.min() < -0.35 else -0.4, 1.08))
        else:
            right.set_axis_off()
        _finish(right, "", "" if i else "Autocorrelation of the whitened residual")
        for ax, label in ((left, "time / s"), (right, "lag / samples")):
            ax.tick_params(labelbottom=is_last)
            ax.set_xlabel(label if is_last else "")
    handles, labels = first.get_legend_handles_labels()
    columns = legend_columns(labels, figure.get_figwidth(), 5)
    figure.legend(handles, labels, loc="outside lower center", ncols=columns)
    return figure


def draw_raw_record(
    t: np.ndarray,
    y: np.ndarray,
    axis: str,
    start: float = 0.0,
    stop: float | None = None,
    decays: Sequence[FreeDecay] = (),
) -> Figure:
    """Draw a record without fits. Mark the part that is used, and other free decays in the record.

    Parameters
    ----------
    t, y
        The record, (n,), in s and in the displayed unit.
    axis
        Label of y.
    start, stop
        Start and end of the part that is used, in s on the time axis of t; without an end it is not marked.
    decays
        All free decays in the record; those that overlap the used part are not marked.
    """
    figure = Figure(figsize=(WIDTH, 2.0))
    ax = figure.add_subplot()
    ax.plot(*thin_line(t, y), color=INK, lw=0.6)
    if stop is not None:
        ax.axvspan(start, stop, color=USED, alpha=0.10, lw=0, label="used")
    others = [d for d in decays if stop is None or d.start >= stop or d.stop <= start]
    for i, decay in enumerate(others):
        label = "" if i else "free decay, not used"
        ax.axvspan(decay.start, decay.stop, color=NOT_USED, alpha=0.18, lw=0, label=label)
    if ax.get_legend_handles_labels()[1]:
        ax.legend(loc="upper right", ncols=4)
    ax.set(xlabel="time / s", ylabel=axis)
    ax.locator_params(axis="y", nbins=5)
    ax.margins(x=0)
    fix_margins(figure, top=0.25)
    return figure


def thin_line(t: np.ndarray, y: np.ndarray, points: int = _POINTS) -> tuple[np.ndarray, np.ndarray]:
    """Return a line (t, y) thinned to about `points` points, which include its ends and the extremes of each section.

    At each gap of the samples that is longer than `DRAWN_GAP` median sampling intervals it has a point with
    y = nan. A line with at most `points` samples is not thinned.
    """
    size = -(-len(t) // max(1, points // 2))
    if size <= 2:
        return interrupt_at_gaps(t, y, t)
    blocks = np.pad(y, (0, -len(t) % size), mode="edge").reshape(-1, size)
    begins = size * np.arange(len(blocks))
    places = np.unique([begins + blocks.argmin(axis=1), begins + blocks.argmax(axis=1)])
    places = np.union1d(places, [0, len(t) - 1])
    return interrupt_at_gaps(t[places], y[places], t)


def _zoom(
    ax: Axes, t: np.ndarray, y: np.ndarray, fits: Sequence[ModelFit], start: float, stop: float
) -> None:
    """Draw the part of a record from start to stop, in s, and the fits to it."""
    inside = (t >= start) & (t <= stop)
    if inside.sum() <= 400:
        ax.plot(t[inside], y[inside], ".", color=MUTED, ms=3, label="record")
    else:
        ax.plot(*thin_line(t[inside], y[inside]), color=FAINT, lw=2.2, label="record")
    for i, (fit, (shade, dashes)) in enumerate(zip(fits, looks(f.model for f in fits).values(), strict=True)):
        ax.plot(
            *thin_line(t[inside], fit.fit[inside]),
            color=shade,
            ls=dashes,
            lw=1.4 if i == 0 else 1.0,
            zorder=3 - 0.01 * i,
            label=words.model(fit.model),
        )
    ax.set_xlabel("time / s")
    ax.margins(x=0)


def _finish(ax: Axes, ylabel: str, title: str) -> None:
    """Set the title of the axes and the label of the y axis, and limit the number of ticks on the y axis."""
    ax.set(title=title, ylabel=ylabel)
    ax.locator_params(axis="y", nbins=5)


def draw_motions(
    t: np.ndarray, y: np.ndarray, modes: Sequence[Oscillation], quantity: str, axis: str
) -> Figure:
    """Draw a record that is not a free decay, with the amplitude of each oscillation in it.

    Each amplitude is drawn as an exponential from its first to its last value. If the first oscillation has no damping
    ratio (nan), because it is excited, draw instead its amplitude in each period: half the range of the samples.

    Parameters
    ----------
    t, y
        The record, (n,), in s and in the displayed unit.
    modes
        The oscillations. Their amplitudes are those of the displacement, in the displayed unit.
    quantity
        The recorded quantity: "angle", "velocity" or "acceleration".
    axis
        Label of y.
    """
    figure = Figure(figsize=(WIDTH, HEIGHT))
    whole, each = figure.subplots(1, 2)
    whole.plot(*thin_line(t, y), color=FAINT, lw=0.7)
    damped = np.isfinite(modes[0].damping_ratio)
    if damped:
        whole.set_title("The record, and the amplitude of each oscillation in it")
    else:  # an excited oscillation: half the range of the samples in each period is its amplitude
        edges = np.searchsorted(t, np.arange(t[0], t[-1], 1 / modes[0].frequency)).tolist()
        periods = [(a, b) for a, b in pairwise(edges) if b - a > 1]
        middles = [0.5 * (t[a] + t[b - 1]) for a, b in periods]
        sizes = np.array([0.5 * np.ptp(y[a:b]) for a, b in periods])
        each.plot(middles, sizes / (2 * np.pi * modes[0].frequency) ** DERIVATIVES[quantity], color=INKS[0])
        whole.set_title("The record")
        each.set_title("Amplitude in each period")
    at, middle = np.linspace(t[0], t[-1], _AMPLITUDE_POINTS), float(np.median(y))
    for mode, (ink, dash) in zip(modes, LOOKS, strict=False):
        if not np.isfinite(mode.damping_ratio):
            continue
        size = mode.first * (mode.last / mode.first) ** ((at - at[0]) / (at[-1] - at[0]))
        edge = size * (2 * np.pi * mode.frequency) ** DERIVATIVES[quantity]
        for sign in (1, -1):
            whole.plot(at, middle + sign * edge, color=ink, ls=dash, lw=1.2)
        label = f"{mode.frequency:.4g} Hz, {100 * mode.damping_ratio:.3g} %"
        each.plot(at, size, color=ink, ls=dash, label=label)
    if damped:
        each.set_title("Amplitude, frequency and damping ratio of each oscillation")
        each.legend(loc="best", labelcolor=INK)
    each.set_yscale("log")
    low, high = each.get_ylim()
    if high < LEAST_AXIS_RATIO * low:
        each.set_ylim(low / LEAST_AXIS_RATIO**0.5, high * LEAST_AXIS_RATIO**0.5)
    label_with_plain_numbers(each.yaxis, decades=high > 5 * low)
    each.set_ylabel(f"amplitude / {modes[0].unit}")
    whole.set_ylabel(axis)
    for ax in (whole, each):
        ax.set_xlabel("time / s")
    fix_margins(figure)
    return figure
