"""The picture of a record that is no free decay of one oscillator: the record, and each oscillation in it."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter

from bayesdamp.report.figures._panels import NARROW, broken
from bayesdamp.report.style import FAINT, INK, WIDTH
from bayesdamp.verdict.parts import Mode

HEIGHT = 2.7
"""Inches of a panel."""
INKS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7")
"""Of the oscillations, in the order of the verdict."""
DASHES = ("-", "--", "-.", ":")
ORDERS = {"angle": 0, "velocity": 1, "acceleration": 2}
LEAST = 2.0
"""By how much an axis of amplitudes spans at least."""
_POINTS = 200


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
    at = np.linspace(t[0], t[-1], _POINTS)
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
