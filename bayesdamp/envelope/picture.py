"""A record of an envelope with what was cut out of it, the fit, and what the fit leaves."""

from __future__ import annotations

import io

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from bayesdamp.records.envelope.record import EnvelopeRecord
from bayesdamp.report.figures.curves import ENDS, MARKED
from bayesdamp.report.figures.record import KEPT, thinned
from bayesdamp.report.style import INK, QUIET, colour
from bayesdamp.verdict.envelope.answer import Answer
from bayesdamp.verdict.parts import Interval
from bayesdamp.verdict.words import named

POINTS = 1200
CUBIC = (3.0, "cubic", "cubic")
FIT, BAND = KEPT, "#D55E00"


def _exponent(ax: Axes, found: Interval, cubic: bool) -> None:
    """The interval of the power of the velocity on an axis where the three laws are marked, the cubic one where it was
    weighed."""
    aligned = ("left", "center", "center", "right")
    for side, (place, name, term) in zip(aligned, (*MARKED, CUBIC) if cubic else MARKED, strict=False):
        ax.axvline(place, color=colour(term), lw=1.2, ls="--")
        ax.text(place, 1.25, name, color=colour(term), fontsize=7.5, ha=side, va="bottom")
    ax.plot([found.low, found.high], [0.0, 0.0], color=INK, lw=3.0, solid_capstyle="butt")
    ax.plot([found.value], [0.0], "o", color=INK, ms=5)
    ax.set_xlim(*ENDS)
    ax.set_ylim(-1.0, 1.0)
    ax.set_yticks([])
    ax.set_xlabel("exponent of the velocity", fontsize=8.5, color=INK)
    ax.tick_params(labelsize=8)


def picture(record: EnvelopeRecord, answer: Answer) -> bytes:
    """A PNG."""
    found = answer.verdict
    figure = Figure(figsize=(9.6, 4.2), dpi=90)
    canvas = FigureCanvasAgg(figure)
    left = figure.add_axes((0.075, 0.12, 0.53, 0.78))
    left.plot(*thinned(record.t, record.level, POINTS), color=QUIET, lw=0.7)
    left.set_xlabel("time / s", color=INK)
    unit = record.unit if record.logarithmic else f"dB of 1 {record.unit}"
    left.set_ylabel(f"level / {unit}", color=INK)
    title = f"{found.record}: {named(found.damping)}" if found.damping else found.record
    left.set_title(title, loc="left", fontsize=9)
    if answer.curve is not None and found.window is not None:
        curve, cut = answer.curve, found.window
        left.plot(curve.t, curve.fit, color=FIT, lw=1.4)
        for at in (cut.start, cut.stop):
            left.axvline(at, color=BAND, lw=0.8)
        if np.isfinite(cut.floor_db):
            left.axhline(cut.floor_db, color=QUIET, lw=0.6, ls=":")
        right = figure.add_axes(
            (0.68, 0.12, 0.305, 0.78) if found.exponent is None else (0.68, 0.42, 0.305, 0.48)
        )
        if found.exponent is not None:
            below = figure.add_axes((0.68, 0.12, 0.305, 0.12))
            _exponent(below, found.exponent, any(share.term == "cubic" for share in found.energy))
        right.fill_between(curve.t, -2 * curve.scatter, 2 * curve.scatter, color=BAND, alpha=0.15, lw=0)
        right.plot(curve.t, curve.level - curve.fit, color=INK, lw=0.8)
        right.axhline(0.0, color=FIT, lw=0.8)
        right.set_xlabel("time / s", color=INK, fontsize=8.5)
        right.set_title("means of readings less the fit, in dB; ± 2 sd", loc="left", fontsize=9)
        right.tick_params(labelsize=8)
    left.tick_params(labelsize=8)
    held = io.BytesIO()
    canvas.print_png(held, metadata={"Software": "bayesdamp"})
    return held.getvalue()
