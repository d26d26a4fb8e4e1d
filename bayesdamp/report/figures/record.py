"""Draw a record: with the fits of models, or with the part that is used and other free decays marked."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from bayesdamp.report import words
from bayesdamp.report.drawing import DASHES, FAINT, INK, MUTED, WIDTH, colour, fix_margins, legend_columns
from bayesdamp.types import FreeDecay

USED, NOT_USED = "#0072B2", "#56B4E9"
"""Colours that mark the free decay that is used, and other free decays in the same record."""
DRAWN_GAP = 20.0
"""A time without samples that is longer than this many median sampling intervals interrupts the drawn line."""
_POINTS = 2000
"""Default number of points to which the line of a record is thinned before it is drawn."""


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

    The panels of the first and the last cycles show three periods each, but at most half of the record.

    Parameters
    ----------
    t, y
        The record, (n,), in s and in the displayed unit.
    fits
        The fits, at least one, the best first.
    axis
        Label of y.
    unit
        Unit of y, for the axes of the residuals.
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
        Start and end of the part that is used, in s on the time axis of t. If the end is None, no part is marked as
        used.
    decays
        All free decays in the record, also on the time axis of t. Those that overlap the used part are not marked.
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

    t, y: times, ascending, and values, (n,). A line with at most `points` samples is not thinned. At the beginning of
    each time without samples that is longer than `DRAWN_GAP` median sampling intervals, a point with y = nan interrupts
    the line.
    """
    size = -(-len(t) // max(1, points // 2))
    thin_t, thin_y = t, np.asarray(y, float)
    if size > 2:
        blocks = np.pad(y, (0, -len(t) % size), mode="edge").reshape(-1, size)
        begins = size * np.arange(len(blocks))
        places = np.unique([begins + blocks.argmin(axis=1), begins + blocks.argmax(axis=1)])
        places = np.union1d(places, [0, len(t) - 1])
        thin_t, thin_y = t[places], thin_y[places]
    gaps = np.diff(t)
    begins = t[:-1][gaps > DRAWN_GAP * np.median(gaps)] if gaps.size else t[:0]
    at = np.searchsorted(thin_t, begins, side="right")
    return np.insert(thin_t, at, begins), np.insert(thin_y, at, np.nan)


def _zoom(
    ax: Axes, t: np.ndarray, y: np.ndarray, fits: Sequence[ModelFit], start: float, stop: float
) -> None:
    """Draw the part of a record from start to stop (in s), and the same part of the fits."""
    inside = (t >= start) & (t <= stop)
    if inside.sum() <= 400:
        ax.plot(t[inside], y[inside], ".", color=MUTED, ms=3, label="record")
    else:
        ax.plot(*thin_line(t[inside], y[inside]), color=FAINT, lw=2.2, label="record")
    for i, fit in enumerate(fits):
        look = {"color": colour(fit.model), "ls": DASHES[i % len(DASHES)], "lw": 1.4 if i == 0 else 1.0}
        line = thin_line(t[inside], fit.fit[inside])
        ax.plot(*line, **look, zorder=3 - 0.01 * i, label=words.model(fit.model))
    ax.set_xlabel("time / s")
    ax.margins(x=0)


def _finish(ax: Axes, ylabel: str, title: str) -> None:
    """Set the title of the axes and the label of the y axis, and limit the number of ticks on the y axis."""
    ax.set(title=title, ylabel=ylabel)
    ax.locator_params(axis="y", nbins=5)
