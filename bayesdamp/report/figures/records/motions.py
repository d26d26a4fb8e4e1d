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
    for mode, ink, dash in zip(modes, INKS, DASHES, strict=False):
        size = mode.first * (mode.last / mode.first) ** ((at - at[0]) / (at[-1] - at[0]))
        shown = size * (2 * np.pi * mode.frequency) ** ORDERS[quantity]
        middle = float(np.median(y))
        for sign in (1, -1):
            whole.plot(at, middle + sign * shown, color=ink, ls=dash, lw=1.2)
        each.plot(
            at, size, color=ink, ls=dash, label=f"{mode.frequency:.4g} Hz, {100 * mode.damping_ratio:.3g} %"
        )
    each.set_title("Amplitude of each, frequency and damping ratio")
    each.set_yscale("log")
    for which in (each.yaxis.set_major_formatter, each.yaxis.set_minor_formatter):
        which(FuncFormatter(lambda size, _: f"{size:g}"))
    each.set_ylabel(f"amplitude / {modes[0].unit}")
    each.legend(loc="best", labelcolor=INK)
    whole.set_ylabel(axis)
    for ax in (whole, each):
        ax.set_xlabel("time / s")
    return figure
