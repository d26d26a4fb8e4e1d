"""The record: what cleaning changed, the fits of the most probable models, and their residuals."""

from __future__ import annotations

from functools import partial

import numpy as np
from markupsafe import Markup

from bayesdamp.provenance import Provenance
from bayesdamp.report import words
from bayesdamp.report.figures.record import ModelFit, raw, record
from bayesdamp.report.markup import fill
from bayesdamp.report.results.answers import only_answered
from bayesdamp.report.results.reading import models_kept
from bayesdamp.report.results.run import RunFolder, rows_of
from bayesdamp.report.sections import SignalSection, is_drawn
from bayesdamp.store.contents import RecordContent
from bayesdamp.types import OK


class RecordSection(SignalSection):
    """Each signal as it was read, as it is used, and with the fit of every model."""

    order = 30
    title = "The record and the fits"

    def shows(self, run: RunFolder, signal: str) -> bool:
        """Return whether a record is not an envelope, which the answer shows."""
        return run.quantity(signal) != "envelope"

    def part(self, run: RunFolder, signal: str) -> Markup:
        """Return the record as it was read, as it is used, and with the most probable fits."""
        repeats = run.repeats(signal)
        cell, about, own = run.cell("signal", signal, repeats[0]), run.about(signal), run.provenance(signal)
        notes = list(own.said)
        if about.get("epsilon_note") and not only_answered(run):  # the answer compares several widths
            notes.append(str(about["epsilon_note"]))
        if about.get("noise"):
            notes.append(f"The answer uses the noise model {words.method(about['noise'])}; see below.")
        if about.get("outcome", OK) != OK:
            notes.append(str(about["outcome"]))
        if cell is None or "t" not in cell.arrays:
            why = cell.outcome if cell else "The record is not in this folder."
            return fill("record.html", notes=notes, figures=[], missing=[why], repeats=len(repeats))
        content = RecordContent.of(cell)
        unit, quantity = run.unit(signal), run.quantity(signal)
        factor, name = unit.scale, unit.of(quantity)
        ratio = f"({name})" if "/" in name else name
        axis = f"{unit.called(quantity)} / {ratio}"
        t, y = cell.arrays["t"], cell.arrays["y"] * factor
        fits, missing = _fits(run, signal, repeats[0], name, len(t))
        figures = []
        raw_t, raw_y = (cell.arrays.get(f"raw_{which}", np.empty(0)) for which in "ty")
        if len(raw_t) > 1 and not np.array_equal(raw_y, cell.arrays["y"]):
            origin = Provenance.of(content.provenance)
            window = next(((o.start, o.stop) for o in (own, origin) if o.stop is not None), (None, None))
            draw = partial(raw, raw_t, raw_y * factor, *window, axis, origin.decays)
            figures.append(run.drawings.add(f"raw-{signal}", f"{signal}: the record as it was read.", draw))
        caption = f"{signal}: the record as used."
        if fits:
            caption = (
                f"{signal}: the record as used, the fits of the most probable models at their posterior modes, the "
                "best first, and their residuals."
            )
        if any(len(fit.autocorrelation) for fit in fits):
            caption += " Grey band: expected for white noise."
        period = content.features.period if content.features is not None else 0.04 * float(t[-1] - t[0])
        draw = partial(record, t, y, fits, axis, ratio, period)
        figures.append(run.drawings.add(f"record-{signal}", caption, draw))
        return fill("record.html", notes=notes, figures=figures, missing=missing, repeats=len(repeats))


def _fits(
    run: RunFolder, signal: str, repeat: int, unit: str, samples: int
) -> tuple[list[ModelFit], list[str]]:
    """Return the fits to draw, and why others are missing."""
    fits, missing = [], []
    for place, model in enumerate(models_kept(run, signal, repeat)):
        cell = run.cell("mode", signal, repeat, model)
        if not is_drawn(run, place) or (cell is None and only_answered(run)):
            continue
        if cell is None:
            missing.append(f"No fit of {words.model(model)} is stored.")
        elif len(cell.arrays.get("fit", ())) != samples:
            missing.append(f"No fit of {words.model(model)}: {cell.outcome}")
        else:
            factor = run.unit(signal).scale
            rows = rows_of(run.fits, signal=signal, repeat=repeat, model=model)
            rms = run.rms(rows[0]) if rows else f"not in fits.csv (axis in {unit})"
            autocorrelation = np.asarray(cell.arrays.get("autocorrelation", []), float)
            fit, residual = (cell.arrays[name] * factor for name in ("fit", "residual"))
            fits.append(ModelFit(model, fit, residual, autocorrelation, rms))
    return fits, missing


PLUGIN = RecordSection()
