"""Draw an answer: record, damping ratio against amplitude, residual, and energy lost in a cycle by each term."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from bayesdamp.report import words
from bayesdamp.report.style import FAINT, INK, NARROW, QUIET, WIDTH, broken, colour, dash, plain

HEIGHT, PANEL = 6.2, 2.5
"""Inches: of the figure, and of a panel in the narrow figure."""
FREE = "#c9b27c"
"""Colour of the band of the damping curve without a law."""


def answer(
    arrays: Mapping[str, np.ndarray], unit: str, damping: str, recorded: str = "", narrow: bool = False
) -> Figure:
    """Return a figure with four panels, or three if no law is drawn.

    Parameters
    ----------
    arrays
        As `inference.deviation.picture` returns them.
    unit
        Of the displacement.
    damping
        The damping sum whose fit is drawn.
    recorded
        Unit of the record if it differs from `unit`.
    narrow
        Whether the panels are below each other, for a phone.
    """
    panels = ("AB;CD", "A;B;C;D") if "fit" in arrays else ("AA;BD", "A;B;D")
    rows = panels[narrow].count(";") + 1
    figure = Figure(figsize=(NARROW, rows * PANEL + 0.7) if narrow else (WIDTH, HEIGHT))
    axes = figure.subplot_mosaic(panels[narrow])
    draw_answer([axes.get(letter) for letter in "ABCD"], arrays, unit, damping, recorded, narrow)
    return figure


def draw_answer(
    axes: Sequence[Axes | None],
    arrays: Mapping[str, np.ndarray],
    unit: str,
    damping: str,
    recorded: str = "",
    narrow: bool = False,
) -> None:
    """Draw the four panels on these axes: record, damping ratio, residual, energy.

    The panel of the residual stays empty if no law is drawn. The other arguments are those of `answer`.
    """
    whole, ratio, rest, energy = axes
    assert whole is not None
    assert ratio is not None
    assert energy is not None
    t, has_fit = arrays["t"], "fit" in arrays
    whole.plot(*broken(t, arrays["record"], t), color=FAINT, lw=1.8, label="record")
    if has_fit:
        fit = broken(t, arrays["fit"], t)
        whole.plot(*fit, color=colour(damping), lw=0.6, label=f"fit of {words.model(damping)}")
    title = "Record and fit" if has_fit else "Record"
    whole.set(title=title, xlabel="time / s", ylabel=recorded or unit)
    # Next to the title if there is room for a sum's name, otherwise below.
    corner, anchor = ("upper center", (0.5, -0.2)) if narrow else ("lower right", (1.0, 1.0))
    whole.legend(loc=corner, bbox_to_anchor=anchor, ncols=2, borderaxespad=0.1, fontsize=7.5)
    if rest is not None and not has_fit:
        rest.set_axis_off()
    elif rest is not None:
        rest.plot(*broken(t, arrays["residual"], t), color=INK, lw=0.5)
        rest.axhline(0.0, color=QUIET, lw=0.6)
        rest.set(title="Residual of the fit", xlabel="time / s", ylabel=recorded or unit)
    _ratios(ratio, arrays, unit)
    # The energy lost in a cycle: by each term, or without a law.
    a, lost = arrays["amplitude"], False
    for name, values in sorted(arrays.items()):
        if name.startswith("work/"):
            term, lost = name.removeprefix("work/"), lost or bool(np.any(values > 0))
            energy.plot(a, values, color=colour(term), ls=dash(term), label=words.model(term))
    by_term = bool(energy.lines)
    if not by_term and "free/lost" in arrays:
        values = arrays["free/lost"]
        energy.plot(arrays["free/amplitude"], values, color=INK, label="without a law")
        a, lost = arrays["free/amplitude"], bool(np.any(values > 0))
    title = f"Energy lost in a cycle, {'by term' if by_term else 'without a law'}"
    energy.set(title=title, xlabel=f"amplitude / {unit}", ylabel=f"{unit}²/s²")
    energy.set(xscale="log", yscale="log" if lost else "linear")
    plain(energy)
    energy.set_xlim(a.min(), a.max())
    energy.legend(loc="best")


def _ratios(ax: Axes, arrays: Mapping[str, np.ndarray], unit: str) -> None:
    """Draw the damping ratio against amplitude, with each law and with the ratio without a law."""
    law_free = "ratio" not in arrays
    names = ("amplitude", "ratio", "low", "high")
    if law_free:
        names = ("free/amplitude", "free/ratio", "free/ratio_low", "free/ratio_high")
    at, value, low, high = (arrays[n] for n in names)
    ax.fill_between(at, 100 * low, 100 * high, color=QUIET, alpha=0.35, lw=0, label="95 % interval")
    ax.plot(at, 100 * value, color=INK, lw=1.8, label="this record" + ", without a law" * law_free)
    top = 100 * float(np.max(high, initial=0.0, where=np.isfinite(high)))
    if "free/amplitude" in arrays and not law_free:
        free, low, high = (arrays[f"free/{n}"] for n in ("amplitude", "ratio_low", "ratio_high"))
        ax.fill_between(free, 100 * low, 100 * high, color=FREE, alpha=0.45, lw=0, label="without a law")
    a, laws = arrays["amplitude"], [name for name in sorted(arrays) if name.startswith("law/")]
    for name in laws:
        terms = name.removeprefix("law/")
        width = 0.7 if "+" in terms else 1.0
        look = {"color": colour(terms), "ls": dash(terms), "lw": width}
        ax.plot(a, 100 * arrays[name], label=words.model(terms), **look)
    title = "Equivalent damping ratio, " + ("and each law fitted alone" if laws else "measured without a law")
    ax.set(title=title, xlabel=f"amplitude / {unit}", ylabel="%", xscale="log")
    ax.set_ylim(0, 1.35 * top or 1.0)  # the top is 0 if nothing is lost
    plain(ax)
    ax.set_xlim(a.min(), a.max())
    # Below the axes, because ten names would hide the curves.
    ax.legend(loc="upper center", bbox_to_anchor=(0.5, -0.2), fontsize=6.5, ncols=2, borderaxespad=0.1)
