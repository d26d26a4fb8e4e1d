"""The record: what cleaning did, the fits of the likeliest models and their residuals."""

from __future__ import annotations

from functools import partial

import numpy as np
from markupsafe import Markup

from bayesdamp.provenance import Provenance
from bayesdamp.report import words
from bayesdamp.report.figures.record import Fit, raw, record
from bayesdamp.report.html import fill
from bayesdamp.report.results.answers import only_answered
from bayesdamp.report.results.reading import models_kept
from bayesdamp.report.results.run import Run, rows_of
from bayesdamp.report.sections._layout import SignalSection, drawn
from bayesdamp.store.contents import RecordContent
from bayesdamp.types import OK


class Record(SignalSection):
    """Each signal as read, as used, and as every model explains it."""

    order = 30
    title = "The record and the fits"

    def shows(self, run: Run, signal: str) -> bool:
        """Return whether a record is more than an envelope, which the answer shows."""
        return run.quantity(signal) != "envelope"

    def part(self, run: Run, signal: str) -> Markup:
        """Return the record as read, as used, and under the likeliest fits."""
        repeats = run.repeats(signal)
        cell, about, own = run.cell("signal", signal, repeats[0]), run.about(signal), run.provenance(signal)
        notes = list(own.said)
        if about.get("epsilon_note") and not only_answered(run):  # the answer weighs several widths
            notes.append(str(about["epsilon_note"]))
        if about.get("noise"):
            notes.append(f"The noise model of the answer is {words.method(about['noise'])}; see below.")
        if about.get("outcome", OK) != OK:
            notes.append(str(about["outcome"]))
        if cell is None or "t" not in cell.arrays:
            why = cell.outcome if cell else "The record is not in this folder."
            return fill("record.html", notes=notes, figures=[], missing=[why], repeats=len(repeats))
        content = RecordContent.of(cell)
        unit = run.unit(signal)
        factor, name = unit.scale, unit.of(run.quantity(signal))
        ratio = f"({name})" if "/" in name else name
        axis = f"{unit.called(run.quantity(signal))} / {ratio}"
        t, y = cell.arrays["t"], cell.arrays["y"] * factor
        fits, missing = _fits(run, signal, repeats[0], name, len(t))
        figures = []
        raw_t, raw_y = (cell.arrays.get(f"raw_{which}", np.empty(0)) for which in "ty")
        if len(raw_t) > 1 and not np.array_equal(raw_y, cell.arrays["y"]):
            origin = Provenance.of(content.provenance)
            window = next(((o.start, o.stop) for o in (own, origin) if o.stop is not None), (None, None))
            draw = partial(raw, raw_t, raw_y * factor, *window, axis, origin.decays)
            figures.append(run.drawings.add(f"raw-{signal}", f"{signal}: the record as it was read.", draw))
        modes = "; the fits of the likeliest models at their posterior modes, best first, and their residuals"
        caption = f"{signal}: the record as used{modes if fits else ''}."
        if any(len(fit.autocorrelation) for fit in fits):
            caption += " Grey band: what white noise would give."
        period = content.features.period if content.features is not None else 0.04 * float(t[-1] - t[0])
        draw = partial(record, t, y, fits, axis, ratio, period)
        figures.append(run.drawings.add(f"record-{signal}", caption, draw))
        return fill("record.html", notes=notes, figures=figures, missing=missing, repeats=len(repeats))


def _fits(run: Run, signal: str, repeat: int, unit: str, samples: int) -> tuple[list[Fit], list[str]]:
    """Return the fits to draw, and why others are missing."""
    fits, missing = [], []
    for place, model in enumerate(models_kept(run, signal, repeat)):
        cell = run.cell("mode", signal, repeat, model)
        if not drawn(run, place) or (cell is None and only_answered(run)):
            continue
        if cell is None:
            missing.append(f"No fit of {words.model(model)} is stored.")
        elif len(cell.arrays.get("fit", ())) != samples:
            missing.append(f"No fit of {words.model(model)}: {cell.outcome}")
        else:
            factor = run.unit(signal).scale
            rows = rows_of(run.fits, signal=signal, repeat=repeat, model=model)
            text = run.rms(rows[0]) if rows else f"not in fits.csv (axis in {unit})"
            autocorrelation = np.asarray(cell.arrays.get("autocorrelation", []), float)
            residual = cell.arrays["residual"] * factor
            fits.append(Fit(model, cell.arrays["fit"] * factor, residual, autocorrelation, text))
    return fits, missing


PLUGIN = Record()
