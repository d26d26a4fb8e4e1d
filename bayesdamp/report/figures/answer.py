"""The picture of an answer: record, damping ratio against amplitude, residual, energy lost in a cycle by term."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from bayesdamp.report import words
from bayesdamp.report.figures._panels import NARROW, broken, plain
from bayesdamp.report.style import FAINT, INK, QUIET, WIDTH, colour, dash

HEIGHT, PANEL = 6.2, 2.5
"""Inches: of the figure, and of a panel where they stand below each other."""
FREE = "#c9b27c"
"""The band of the damping curve without a law."""


def answer(
    arrays: Mapping[str, np.ndarray], unit: str, damping: str, recorded: str = "", narrow: bool = False
) -> Figure:
    """Four panels, three where no law is drawn; arrays as `inference.deviation.picture` leaves them, unit: of the
    displacement, recorded: of the record where that is another.

    narrow: below each other, for a phone.
    """
    panels = ("AB;CD", "A;B;C;D") if "fit" in arrays else ("AA;BD", "A;B;D")
    rows = panels[narrow].count(";") + 1
    figure = Figure(figsize=(NARROW, rows * PANEL + 0.7) if narrow else (WIDTH, HEIGHT))
    found = figure.subplot_mosaic(panels[narrow])
    axes = [found.get(one) for one in "ABCD"]
    draw_answer(axes, arrays, unit, damping, recorded, narrow)
    return figure


def draw_answer(
    axes: Sequence[Axes | None],
    arrays: Mapping[str, np.ndarray],
    unit: str,
    damping: str,
    recorded: str = "",
    narrow: bool = False,
) -> None:
    """Draw the four panels on these axes: record, damping ratio, residual (nothing where no law is drawn), energy.
    Arguments as those of `answer`."""
    whole, ratio, left, energy = axes
    assert whole is not None
    assert ratio is not None
    assert energy is not None
    t = arrays["t"]
    whole.plot(*broken(t, arrays["record"], t), color=FAINT, lw=1.8, label="record")
    fitted = "fit" in arrays
    if fitted:
        fit = broken(t, arrays["fit"], t)
        whole.plot(*fit, color=colour(damping), lw=0.6, label=f"fit of {words.model(damping)}")
    _finish(whole, "Record and fit" if fitted else "Record", "time / s", recorded or unit)
    # Beside the title where there is room for a sum's name, else below.
    place = ("upper center", (0.5, -0.2)) if narrow else ("lower right", (1.0, 1.0))
    whole.legend(loc=place[0], bbox_to_anchor=place[1], ncols=2, borderaxespad=0.1, fontsize=7.5)
    if left is not None and not fitted:
        left.set_axis_off()
    elif left is not None:
        left.plot(*broken(t, arrays["residual"], t), color=INK, lw=0.5)
        left.axhline(0.0, color=QUIET, lw=0.6)
        _finish(left, "What the fit leaves", "time / s", recorded or unit)
    _ratios(ratio, arrays, unit)
    _energies(energy, arrays, unit)


def _ratios(ax: Axes, arrays: Mapping[str, np.ndarray], unit: str) -> None:
    measured = "ratio" not in arrays  # no law is the answer
    names = ("amplitude", "ratio", "low", "high")
    names = ("free/amplitude", "free/ratio", "free/ratio_low", "free/ratio_high") if measured else names
    at, value, low, high = (arrays[n] for n in names)
    ax.fill_between(at, 100 * low, 100 * high, color=QUIET, alpha=0.35, lw=0, label="95 % interval")
    whose = "this record, without a law" if measured else "this record"
    ax.plot(at, 100 * value, color=INK, lw=1.8, label=whose)
    top = 100 * float(np.max(high, initial=0.0, where=np.isfinite(high)))
    if "free/amplitude" in arrays and not measured:
        free, low, high = (arrays[f"free/{n}"] for n in ("amplitude", "ratio_low", "ratio_high"))
        ax.fill_between(free, 100 * low, 100 * high, color=FREE, alpha=0.45, lw=0, label="without a law")
    a = arrays["amplitude"]
    laws = [name for name in sorted(arrays) if name.startswith("law/")]
    for name in laws:
        sum_ = name.removeprefix("law/")
        single = "+" not in sum_
        ax.plot(
            a, 100 * arrays[name], color=colour(sum_), ls=dash(sum_), lw=1.0 if single else 0.7, label=words.model(sum_)
        )  # fmt: skip
    ax.set_xscale("log")
    ax.set_ylim(0, 1.35 * top or 1.0)  # in %: nothing may be lost
    plain(ax)
    ax.set_xlim(a.min(), a.max())
    title = "Equivalent damping ratio, " + ("and each law fitted alone" if laws else "measured without a law")
    _finish(ax, title, f"amplitude / {unit}", "%")
    # Below: ten names over the curves would hide them.
    ax.legend(loc="upper center", bbox_to_anchor=(0.5, -0.2), fontsize=6.5, ncols=2, borderaxespad=0.1)


def _energies(ax: Axes, arrays: Mapping[str, np.ndarray], unit: str) -> None:
    a, lost = arrays["amplitude"], False
    for name, values in sorted(arrays.items()):
        if name.startswith("work/"):
            term, lost = name.removeprefix("work/"), lost or bool(np.any(values > 0))
            ax.plot(a, values, color=colour(term), ls=dash(term), label=words.model(term))
    by_term = bool(ax.lines)
    if not by_term and "free/lost" in arrays:
        a, values = arrays["free/amplitude"], arrays["free/lost"]
        ax.plot(a, values, color=INK, label="without a law")
        lost = bool(np.any(values > 0))
    ax.set(xscale="log", yscale="log" if lost else "linear")
    plain(ax)
    ax.set_xlim(a.min(), a.max())
    _finish(
        ax,
        f"Energy lost in a cycle, {'by term' if by_term else 'without a law'}",
        f"amplitude / {unit}",
        f"{unit}²/s²",
    )
    ax.legend(loc="best")


def _finish(ax: Axes, title: str, xlabel: str, ylabel: str) -> None:
    ax.set(title=title, xlabel=xlabel, ylabel=ylabel)
