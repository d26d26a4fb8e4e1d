"""Draw a record with the fits of models, its windows, and the oscillations that are in it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.gridspec import SubplotSpec
from matplotlib.ticker import FuncFormatter

from bayesdamp.provenance import FreeDecay
from bayesdamp.report import words
from bayesdamp.report.figures._panels import NARROW, broken
from bayesdamp.report.style import FAINT, INK, QUIET, WIDTH, colour, legend_columns, looks
from bayesdamp.verdict.parts import Mode

KEPT = "#0072B2"
NOT_USED = "#56B4E9"
_POINTS = 2000
_APART = 200
"""Lines side by side that a panel has room for."""


@dataclass(frozen=True)
class Fit:
    """One model at its mode. fit, residual: shape (n,), on the record's times; empty where not stored.

    autocorrelation: shape (lags,), of the whitened residual, from lag 0.
    """

    model: str
    fit: np.ndarray
    residual: np.ndarray
    autocorrelation: np.ndarray
    rms: str


def record(t: np.ndarray, y: np.ndarray, fits: Sequence[Fit], axis: str, unit: str, period: float) -> Figure:
    """t in s and y in the displayed unit, shape (n,); fits in the order of their rank; axis: label of y; unit: as it
    stands there."""
    heights = [1.9, 1.9, 1.05 * len(fits)] if fits else [2.2]
    figure = Figure(figsize=(WIDTH, sum(heights) + 0.4))
    grid = figure.add_gridspec(len(heights), 1, height_ratios=heights)
    whole = figure.add_subplot(grid[0])
    at, values = thinned(t, y)
    whole.plot(at, values, color=FAINT if fits else INK, lw=1.6 if fits else 0.8, label="record")
    if fits:
        best = fits[0]
        at, values = thinned(t, best.fit)
        whole.plot(at, values, color=colour(best.model), lw=0.6, label=f"fit of {words.model(best.model)}")
        whole.legend(loc="upper right", ncols=2, borderaxespad=0.1)
    _finish(whole, axis, "Record" + (" and best fit" if fits else ""))
    whole.set(xlabel="time / s", xlim=(t[0], t[-1]))
    if not fits:
        return figure
    length = min(3.0 * period, 0.5 * (t[-1] - t[0]))
    first, last = (figure.add_subplot(place) for place in grid[1].subgridspec(1, 2))
    _zoom(first, t, y, fits, t[0], t[0] + length)
    _zoom(last, t, y, fits, t[-1] - length, t[-1])
    _finish(first, axis, "The first cycles and their fits")
    _finish(last, "", "The last cycles and their fits")
    _residuals(figure, grid[2], t, fits, unit)
    handles, labels = first.get_legend_handles_labels()
    columns = legend_columns(labels, figure.get_figwidth(), 5)
    figure.legend(handles, labels, loc="outside lower center", ncols=columns)
    return figure


def raw(
    t: np.ndarray,
    y: np.ndarray,
    start: float | None,
    stop: float | None,
    axis: str,
    decays: Sequence[FreeDecay] = (),
) -> Figure:
    """Draw the record as it was read, with what was kept, start to stop (s on its own clock), and other decays."""
    figure = Figure(figsize=(WIDTH, 1.9))
    ax = figure.add_subplot()
    at, values = thinned(t, y)
    ax.plot(at, values, color=INK, lw=0.6)
    if start is not None and stop is not None:
        ax.axvspan(start, stop, color=KEPT, alpha=0.10, lw=0, label="kept")
    for decay in decays:
        if start is None or stop is None or decay.start >= stop or decay.stop <= start:
            label = (
                "" if "free decay, not used" in ax.get_legend_handles_labels()[1] else "free decay, not used"
            )
            ax.axvspan(decay.start, decay.stop, color=NOT_USED, alpha=0.18, lw=0, label=label)
    if ax.get_legend_handles_labels()[1]:
        ax.legend(loc="upper right", ncols=4)
    _finish(ax, axis, "As read")
    ax.set_xlabel("time / s")
    ax.margins(x=0)
    return figure


def thinned(t: np.ndarray, y: np.ndarray, points: int = _POINTS) -> tuple[np.ndarray, np.ndarray]:
    """At most about so many points, with every extreme kept; nan where the record has a hole."""
    size = -(-len(t) // max(1, points // 2))
    if size <= 2:
        return broken(t, y, t)
    edges = range(0, len(t), size)
    blocks = [y[i : i + size] for i in edges]
    kept = {i + int(at) for i, b in zip(edges, blocks) for at in (b.argmin(), b.argmax())}
    chosen = np.array(sorted(kept | {0, len(t) - 1}))
    return broken(t[chosen], y[chosen], t)


def _zoom(ax: Axes, t: np.ndarray, y: np.ndarray, fits: Sequence[Fit], start: float, stop: float) -> None:
    inside = (t >= start) & (t <= stop)
    if inside.sum() <= 400:
        ax.plot(t[inside], y[inside], ".", color=QUIET, ms=3, label="record")
    else:
        ax.plot(*thinned(t[inside], y[inside]), color=FAINT, lw=2.2, label="record")
    for i, (fit, (shade, dashes)) in enumerate(zip(fits, looks(f.model for f in fits).values(), strict=True)):
        ax.plot(
            *thinned(t[inside], fit.fit[inside]),
            color=shade,
            ls=dashes,
            lw=1.4 if i == 0 else 1.0,
            zorder=3 - 0.01 * i,
            label=words.model(fit.model),
        )
    ax.set_xlabel("time / s")
    ax.margins(x=0)


def _residuals(figure: Figure, place: SubplotSpec, t: np.ndarray, fits: Sequence[Fit], unit: str) -> None:
    lags = max((len(fit.autocorrelation) for fit in fits), default=0)
    first_right: Axes | None = None
    grid = place.subgridspec(len(fits), 2, width_ratios=[2, 1])
    for i, fit in enumerate(fits):
        left = figure.add_subplot(grid[i, 0])
        at, values = thinned(t, fit.residual)
        left.plot(at, values, color=colour(fit.model), lw=0.5)
        left.axhline(0.0, color=QUIET, lw=0.6)
        reach = 1.15 * float(np.nanmax(np.abs(fit.residual), initial=0.0)) or 1.0
        left.set(ylim=(-reach, reach), xlim=(t[0], t[-1]))
        _finish(left, unit, f"Residual of {words.model(fit.model)}, rms {fit.rms}")
        right = figure.add_subplot(grid[i, 1])
        if len(fit.autocorrelation):
            right.axhspan(-2 / np.sqrt(len(t)), 2 / np.sqrt(len(t)), color=FAINT, lw=0)
            _stems(right, fit.autocorrelation, colour(fit.model))
            right.axhline(0.0, color=QUIET, lw=0.6)
            right.set(
                xlim=(-0.5, lags - 0.5), ylim=(-1.05 if fit.autocorrelation.min() < -0.35 else -0.4, 1.08)
            )
        else:
            right.set_axis_off()
        _finish(right, "", "Autocorrelation, whitened" if first_right is None else "")
        first_right = first_right or right
        is_last = i == len(fits) - 1
        left.tick_params(labelbottom=is_last)
        right.tick_params(labelbottom=is_last)
        if is_last:
            left.set_xlabel("time / s")
            right.set_xlabel("lag / samples")


def _stems(ax: Axes, values: np.ndarray, shade: str) -> None:
    """A line for each value, shape (n,); where these would touch, the area that they fill."""
    at = np.arange(len(values))
    if len(values) <= _APART:
        ax.vlines(at, 0, values, color=shade)
    else:
        ax.fill_between(at, 0, values, color=shade, lw=0.5)


def _finish(ax: Axes, ylabel: str, title: str) -> None:
    ax.set(title=title, ylabel=ylabel)
    ax.locator_params(axis="y", nbins=5)


HEIGHT = 2.7
"""Inches of a panel."""
INKS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7")
"""Of the oscillations, in the order of the verdict."""
DASHES = ("-", "--", "-.", ":")
ORDERS = {"angle": 0, "velocity": 1, "acceleration": 2}
LEAST = 2.0
"""By how much an axis of amplitudes spans at least."""
_MOMENTS = 200


def motions(
    t: np.ndarray, y: np.ndarray, modes: Sequence[Mode], quantity: str, axis: str, narrow: bool = False
) -> Figure:
    """t in s and y in the shown unit, shape (n,); modes: with amplitudes in that unit, of the displacement.

    quantity: what was recorded; axis: its label. narrow: panels below each other, for a phone.
    """
    figure = Figure(figsize=(NARROW, 2 * HEIGHT) if narrow else (WIDTH, HEIGHT))
    whole, each = figure.subplots(*((2, 1) if narrow else (1, 2)))
    whole.plot(*broken(t, y, t), color=FAINT, lw=0.7)
    whole.set_title("The record, and how large each oscillation in it is")
    at = np.linspace(t[0], t[-1], _MOMENTS)
    if not np.isfinite(modes[0].damping_ratio):
        middles, sizes = _by_period(t, y, 1 / modes[0].frequency)
        each.plot(middles, sizes / (2 * np.pi * modes[0].frequency) ** ORDERS[quantity], color=INKS[0])
        whole.set_title("The record")
        each.set_title("Its amplitude, period by period")
    for mode, ink, dash in zip(modes, INKS, DASHES, strict=False):
        if not np.isfinite(mode.damping_ratio):
            continue
        size = mode.first * (mode.last / mode.first) ** ((at - at[0]) / (at[-1] - at[0]))
        shown = size * (2 * np.pi * mode.frequency) ** ORDERS[quantity]
        middle = float(np.median(y))
        for sign in (1, -1):
            whole.plot(at, middle + sign * shown, color=ink, ls=dash, lw=1.2)
        each.plot(
            at, size, color=ink, ls=dash, label=f"{mode.frequency:.4g} Hz, {100 * mode.damping_ratio:.3g} %"
        )
    if np.isfinite(modes[0].damping_ratio):
        each.set_title("Amplitude of each, frequency and damping ratio")
        each.legend(loc="best", labelcolor=INK)
    each.set_yscale("log")
    low, high = each.get_ylim()
    if high < LEAST * low:
        each.set_ylim(low / LEAST**0.5, high * LEAST**0.5)  # what hardly changes shall look so
    for which in (each.yaxis.set_major_formatter, each.yaxis.set_minor_formatter):
        which(FuncFormatter(lambda size, _: f"{size:g}"))
    each.set_ylabel(f"amplitude / {modes[0].unit}")
    whole.set_ylabel(axis)
    for ax in (whole, each):
        ax.set_xlabel("time / s")
    return figure


def _by_period(t: np.ndarray, y: np.ndarray, period: float) -> tuple[np.ndarray, np.ndarray]:
    """Middles of whole periods in s, and half the range of y there, (k,) each."""
    edges = np.searchsorted(t, np.arange(t[0], t[-1], period))
    parts = [(a, b) for a, b in zip(edges[:-1].tolist(), edges[1:].tolist(), strict=True) if b - a > 1]
    return (
        np.array([0.5 * (t[a] + t[b - 1]) for a, b in parts]),
        np.array([0.5 * np.ptp(y[a:b]) for a, b in parts]),
    )
