"""Draw the figures that show the answer on an oscillation, on several records together, and on an envelope."""

import math
from collections.abc import Mapping, Sequence
from itertools import cycle

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from bayesdamp.formatting import SUPERSCRIPTS
from bayesdamp.report import words
from bayesdamp.report.drawing import (
    FAINT,
    INK,
    INKS,
    MUTED,
    WIDTH,
    colour,
    dash,
    fix_margins,
    label_with_plain_numbers,
    legend_columns,
)
from bayesdamp.report.figures.record import USED, thin_line
from bayesdamp.verdict.types import Verdict
from bayesdamp.verdict.words import named

ANSWER_HEIGHT = 6.2
"""Height of the figure of an answer, in inches."""
ENVELOPE_HEIGHT = 3.4
"""Height of the figure of an answer on an envelope, in inches."""
LAW_FREE_COLOUR = "#c9b27c"
"""Colour of the 95 % band of the damping ratio that is measured directly, without assuming a damping law."""
MOST_POINTS = 1200
"""Largest number of points to which a line in a panel is thinned: about two for each column of pixels in the PNG."""
MOST_COLOURED = 6
"""Largest number of records in an overview that are drawn in different colours and with a legend."""
LEGEND_ROW = 0.17
"""Height of a row of a legend, in inches."""
FIT_COLOUR, BAND_COLOUR = USED, "#D55E00"
"""Colours in the figure of an envelope. `FIT_COLOUR`: the fit with its band. `BAND_COLOUR`: the lines at the start and
the end of the decay, and the band (± 2 sd) of the readings' noise."""


def answer(arrays: Mapping[str, np.ndarray], unit: str, damping: str, recorded: str) -> Figure:
    """Draw the answer on a record in four panels: record and fit, damping ratio, residual, energy lost in a cycle.

    If `arrays` contains no fit (because the best damping law contradicts the measured damping), the residual is left
    out and there are three panels.

    Parameters
    ----------
    arrays
        `Answer.arrays` of the answer (`interface.answer`), already converted to `unit` by `picture_in_unit`.
    unit
        Unit of the displacement. The energy per unit of inertia is in `unit`²/s².
    damping
        The damping sum of the fit in `arrays`, for its colour and for the legend.
    recorded
        The recorded quantity and its unit, such as "velocity / (mm/s)", for the axes of the record and of the residual;
        "" means `unit`.
    """
    figure, has_fit = Figure(figsize=(WIDTH, ANSWER_HEIGHT)), "fit" in arrays
    axes = figure.subplot_mosaic("AB;CD" if has_fit else "AA;BD")
    draw_answer([axes.get(letter) for letter in "ABCD"], arrays, unit, damping, recorded)
    legend = axes["B"].get_legend()
    assert legend is not None
    below = 0.5 + 0.14 * math.ceil(len(legend.get_texts()) / 2)
    if has_fit:
        fix_margins(figure, left=0.98, down=below + 0.42)  # room for residuals such as −0.00025
    else:
        fix_margins(figure, bottom=below, down=0.95)
    return figure


def draw_answer(
    axes: Sequence[Axes | None], arrays: Mapping[str, np.ndarray], unit: str, damping: str, recorded: str
) -> None:
    """Draw the panels of `answer` on the given axes: record, damping ratio, residual, energy lost in a cycle.

    The energy is that of each damping term or, if `arrays` has none by term, the total that is measured without a law.

    Parameters
    ----------
    axes
        The four axes in this order; the axes of the residual may be None. They are switched off if `arrays` contains no
        fit.
    arrays
        `Answer.arrays` of the answer (`interface.answer`), already converted to `unit` by `picture_in_unit`.
    unit
        Unit of the displacement.
    damping
        The damping sum of the fit in `arrays`.
    recorded
        The recorded quantity and its unit; "" means `unit`.
    """
    whole, ratio, rest, energy = axes
    assert whole is not None
    assert ratio is not None
    assert energy is not None
    t, has_fit = arrays["t"], "fit" in arrays
    whole.plot(*thin_line(t, arrays["record"], MOST_POINTS), color=FAINT, lw=1.8, label="record")
    if has_fit:
        label = f"fit of {words.model(damping)}"
        whole.plot(*thin_line(t, arrays["fit"], MOST_POINTS), color=colour(damping), lw=0.6, label=label)
    whole.set(title="Record and fit" if has_fit else "Record", xlabel="time / s", ylabel=recorded or unit)
    whole.legend(loc="lower right", bbox_to_anchor=(1.0, 1.0), ncols=2, borderaxespad=0.1, fontsize=7.5)
    if rest is not None and not has_fit:
        rest.set_axis_off()
    elif rest is not None:
        rest.plot(*thin_line(t, arrays["residual"], MOST_POINTS), color=INK, lw=0.5)
        rest.axhline(0.0, color=MUTED, lw=0.6)
        rest.set(title="Residual of the fit", xlabel="time / s", ylabel=recorded or unit)
    _ratios(ratio, arrays, unit)
    # Energy lost in a cycle: by each damping term, or in total as measured without a law.
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
    energy.set(title=title, xlabel=f"amplitude / {unit}", ylabel=f"energy lost / ({unit}²/s²)")
    energy.set(xscale="log", yscale="log" if lost else "linear")
    if lost:  # the formulas that Matplotlib writes by default take 0.1 s
        energy.yaxis.set_major_formatter(lambda y, _: "10" + f"{math.log10(y):.0f}".translate(SUPERSCRIPTS))
        energy.fmt_ydata = "{:.3g}".format  # what an interactive figure shows at the cursor
    # Most minor ticks are outside of the axis; they would not be visible, but take time.
    minor, (low, high) = energy.get_yticks(minor=True), energy.get_ylim()
    energy.set_yticks(minor[(minor >= low) & (minor <= high)], minor=True)
    label_with_plain_numbers(energy.xaxis)
    energy.set_xlim(a.min(), a.max())
    energy.legend(loc="best")


def _ratios(ax: Axes, arrays: Mapping[str, np.ndarray], unit: str) -> None:
    """Draw the equivalent damping ratio in per cent against amplitude in `unit`; in `arrays` ratios are fractions.

    These are drawn if `arrays` contains them: the answer's ratio with its 95 % band, the ratio of each damping sum
    fitted to the record, and the 95 % band of the ratio that is measured without assuming a damping law. If the answer
    has no ratio, the ratio measured without a law is drawn as a line with its band.
    """
    law_free = "ratio" not in arrays
    names = ("amplitude", "ratio", "low", "high")
    if law_free:
        names = ("free/amplitude", "free/ratio", "free/ratio_low", "free/ratio_high")
    at, value, low, high = (arrays[n] for n in names)
    ax.fill_between(at, 100 * low, 100 * high, color=MUTED, alpha=0.35, lw=0, label="95 % interval")
    ax.plot(at, 100 * value, color=INK, lw=1.8, label="this record" + ", without a law" * law_free)
    top = 100 * float(np.max(high, initial=0.0, where=np.isfinite(high)))
    if "free/amplitude" in arrays and not law_free:
        free, low, high = (arrays[f"free/{n}"] for n in ("amplitude", "ratio_low", "ratio_high"))
        ax.fill_between(
            free, 100 * low, 100 * high, color=LAW_FREE_COLOUR, alpha=0.45, lw=0, label="95 %, without a law"
        )
    a, laws = arrays["amplitude"], [name for name in sorted(arrays) if name.startswith("law/")]
    for name in laws:
        terms = name.removeprefix("law/")
        look = {"color": colour(terms), "ls": dash(terms), "lw": 0.7 if "+" in terms else 1.0}
        ax.plot(a, 100 * arrays[name], label=words.model(terms), **look)
    how = "and each model fitted alone" if laws else "measured without a law"
    title = f"Equivalent damping ratio, {how}"
    ax.set(title=title, xlabel=f"amplitude / {unit}", ylabel="damping ratio / %", xscale="log")
    ax.set_ylim(0, 1.35 * top or 1.0)  # the top is 0 if nothing is lost
    label_with_plain_numbers(ax.xaxis)
    ax.set_xlim(a.min(), a.max())
    # The legend is below the axes, because up to ten entries would hide the curves.
    ax.legend(loc="upper center", bbox_to_anchor=(0.5, -0.22), fontsize=6.5, ncols=2, borderaxespad=0.1)


def overview(curves: Mapping[str, Sequence[np.ndarray]], unit: str) -> Figure:
    """Draw the damping ratios of several records against amplitude.

    If there are more than `MOST_COLOURED` records, all have the same colour and there is no legend.

    Parameters
    ----------
    curves
        For each record, by its name in the legend: amplitude, damping ratio (a fraction) and the low and the high end
        of its 95 % interval, each (m,).
    unit
        Unit of the amplitudes, for the label of the axis.
    """
    figure = Figure(figsize=(WIDTH, 3.4))
    ax, few = figure.subplots(), len(curves) <= MOST_COLOURED
    inks = cycle(INKS if few else (MUTED,))
    for (name, (at, ratio, low, high)), ink in zip(curves.items(), inks, strict=False):
        ax.fill_between(at, 100 * low, 100 * high, color=ink, alpha=0.15 if few else 0.05, lw=0)
        ax.plot(at, 100 * ratio, color=ink, lw=1.4 if few else 0.8, label=name)
    tops = [np.nanmax(curve[1]) for curve in curves.values()]
    ax.set(xscale="log", xlabel=f"amplitude / {unit}", ylabel="damping ratio / %")
    label_with_plain_numbers(ax.xaxis)
    ax.set_ylim(0, 130 * float(np.nanquantile(tops, 0.9)) or 1.0)
    if few:
        columns = legend_columns(list(curves), WIDTH, 3)
        figure.set_figheight(3.4 + max(math.ceil(len(curves) / columns) - 2, 0) * LEGEND_ROW)
        figure.legend(*ax.get_legend_handles_labels(), loc="outside upper left", ncols=columns)
    return figure


def envelope(arrays: Mapping[str, np.ndarray], verdict: Verdict, unit: str) -> Figure:
    """Draw an envelope with its fit, and the residual, in a new figure. The arguments are as for `draw_envelope`."""
    figure = Figure(figsize=(WIDTH, ENVELOPE_HEIGHT))
    draw_envelope(figure.subplots(1, 2, width_ratios=(3, 2)), arrays, verdict, unit)
    return figure


def draw_envelope(
    axes: Sequence[Axes], arrays: Mapping[str, np.ndarray], verdict: Verdict, unit: str
) -> None:
    """Draw the level of an envelope with its fit, and the residual, on the given axes.

    If the record contains no free decay, only the level is drawn.

    Parameters
    ----------
    axes
        Two axes: for the level and for the residual. If there is no residual, its axes are switched off.
    arrays
        Times `t` in s and the `level` of the readings in dB. If the record contains a decay, also the arrays
        `curve/...`, the fields of `inference.envelope.decay.Curve`.
    verdict
        The verdict on the record.
    unit
        Unit of the level for the label of its axis, such as "dB" or "dB of 1 V".
    """
    whole, rest = axes
    whole.plot(*thin_line(arrays["t"], arrays["level"], MOST_POINTS), color=MUTED, lw=0.7)
    title = f"{verdict.record}: {named(verdict.damping)}" if verdict.damping else verdict.record
    whole.set(title=title, xlabel="time / s", ylabel=f"level / {unit}")
    if "curve/t" not in arrays or verdict.window is None:
        rest.set_axis_off()
        return
    t, level, fit, sd, scatter = (arrays[f"curve/{n}"] for n in ("t", "level", "fit", "fit_sd", "scatter"))
    whole.fill_between(t, fit - 2 * sd, fit + 2 * sd, color=FIT_COLOUR, alpha=0.3, lw=0)
    whole.plot(t, fit, color=FIT_COLOUR, lw=1.4)
    for at in (verdict.window.start, verdict.window.stop):
        whole.axvline(at, color=BAND_COLOUR, lw=0.8)
    if np.isfinite(verdict.window.floor_db):
        whole.axhline(verdict.window.floor_db, color=MUTED, lw=0.6, ls=":")
    rest.fill_between(t, -2 * scatter, 2 * scatter, color=BAND_COLOUR, alpha=0.15, lw=0)
    rest.plot(t, level - fit, color=INK, lw=0.8)
    rest.axhline(0.0, color=FIT_COLOUR, lw=0.8)
    rest.set(title="Mean readings minus the fit", xlabel="time / s", ylabel="dB")
