"""Draw the record of an envelope with its decay and fit, the residual, and the power of the velocity."""

from __future__ import annotations

import io
from collections.abc import Mapping, Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from bayesdamp.report.figures.curves import MARKED, draw_exponent
from bayesdamp.report.figures.record import USED, thinned
from bayesdamp.report.style import INK, QUIET
from bayesdamp.verdict.types import Verdict
from bayesdamp.verdict.words import named

POINTS = 1200
CUBIC = (3.0, "cubic", "cubic")
FIT, BAND = USED, "#D55E00"
PLACES = ((0.075, 0.12, 0.53, 0.78), (0.68, 0.42, 0.305, 0.48), (0.68, 0.12, 0.305, 0.12))
"""Left, bottom, width and height of the three panels in the figure."""


def draw_envelope(
    axes: Sequence[Axes], arrays: Mapping[str, np.ndarray], verdict: Verdict, unit: str
) -> None:
    """Draw the record with its fit, the residual and the exponent; without a decay only the record.

    Parameters
    ----------
    axes
        Three; those that stay empty are switched off.
    arrays
        `t` (s) and `level` (dB) of the record; `curve/...` of the decay, the fields of
        `envelope.answer.answer.Curve`.
    verdict
        On the record.
    unit
        Of the levels.
    """
    whole, rest, below = axes
    whole.plot(*thinned(arrays["t"], arrays["level"], POINTS), color=QUIET, lw=0.7)
    whole.set_xlabel("time / s", color=INK)
    whole.set_ylabel(f"level / {unit}", color=INK)
    title = f"{verdict.record}: {named(verdict.damping)}" if verdict.damping else verdict.record
    whole.set_title(title, loc="left", fontsize=9)
    whole.tick_params(labelsize=8)
    if verdict.exponent is None:
        below.set_axis_off()
    else:
        e, cubic = verdict.exponent, any(share.term == "cubic" for share in verdict.energy)
        draw_exponent(below, None, (e.value, e.low, e.high), marked=(*MARKED, CUBIC) if cubic else MARKED)
        below.tick_params(labelsize=8)
    if "curve/t" not in arrays or verdict.window is None:
        rest.set_axis_off()
        return
    names = ("t", "level", "fit", "fit_sd", "scatter")
    t, level, fit, sd, scatter = (arrays[f"curve/{name}"] for name in names)
    whole.fill_between(t, fit - 2 * sd, fit + 2 * sd, color=FIT, alpha=0.3, lw=0)
    whole.plot(t, fit, color=FIT, lw=1.4)
    for at in (verdict.window.start, verdict.window.stop):
        whole.axvline(at, color=BAND, lw=0.8)
    if np.isfinite(verdict.window.floor_db):
        whole.axhline(verdict.window.floor_db, color=QUIET, lw=0.6, ls=":")
    rest.fill_between(t, -2 * scatter, 2 * scatter, color=BAND, alpha=0.15, lw=0)
    rest.plot(t, level - fit, color=INK, lw=0.8)
    rest.axhline(0.0, color=FIT, lw=0.8)
    rest.set_xlabel("time / s", color=INK, fontsize=8.5)
    rest.set_title("mean readings minus the fit, in dB; ± 2 sd", loc="left", fontsize=9)
    rest.tick_params(labelsize=8)


def picture(arrays: Mapping[str, np.ndarray], verdict: Verdict, unit: str) -> bytes:
    """Return the figure as PNG. The arguments are those of `draw_envelope`."""
    figure = Figure(figsize=(9.6, 4.2), dpi=90)
    canvas = FigureCanvasAgg(figure)
    draw_envelope([figure.add_axes(place) for place in PLACES], arrays, verdict, unit)
    png = io.BytesIO()
    canvas.print_png(png, metadata={"Software": "bayesdamp"})
    return png.getvalue()
