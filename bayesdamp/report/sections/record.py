"""The record: what cleaning did, the fits of the likeliest models and their residuals."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from markupsafe import Markup

from bayesdamp import formatting as fmt
from bayesdamp.provenance import Provenance
from bayesdamp.report import words
from bayesdamp.report.figures.record import Fit, raw, record
from bayesdamp.report.html import fill
from bayesdamp.report.results.answers import only_answered
from bayesdamp.report.results.reading import models_kept
from bayesdamp.report.results.run import Run
from bayesdamp.report.sections._layout import SignalSection, drawn
from bayesdamp.store.contents.records import RecordContent
from bayesdamp.types import OK


class Record(SignalSection):
    """Each signal as read, as used, and as every model explains it."""

    order = 30
    name = "record"
    title = "The record and the fits"

    def shows(self, run: Run, signal: str) -> bool:
        """Return whether a record is more than an envelope, which the answer shows."""
        return run.quantity(signal) != "envelope"

    def part(self, run: Run, signal: str) -> Markup:
        """Return the record as read, as used, and under the likeliest fits."""
        return _one(run, signal)


def _one(run: Run, signal: str) -> Markup:
    repeats = run.repeats(signal)
    repeat = repeats[0]
    cell = run.cell("signal", signal, repeat)
    about = run.about(signal)
    said = list(run.provenance(signal).said)
    if about.get("epsilon_note") and not only_answered(run):  # the answer weighs several widths
        said.append(str(about["epsilon_note"]))
    if about.get("noise"):
        said.append(f"The noise model of the answer is {words.method(about['noise'])}; see below.")
    if about.get("outcome", OK) != OK:
        said.append(str(about["outcome"]))
    if cell is None or "t" not in cell.arrays:
        why = cell.outcome if cell else "The record is not in this folder."
        return fill("record.html", notes=said, figures=[], missing=[why], repeats=len(repeats))
    content = RecordContent.of(cell)
    quantity = about.get("quantity") or "angle"
    factor = run.unit(signal).scale
    unit = run.unit(signal).of(quantity)
    name = run.unit(signal).called(quantity)
    ratio = f"({unit})" if "/" in unit else unit
    axis = f"{name} / {ratio}"
    t, y = cell.arrays["t"], cell.arrays["y"]
    fits, missing = _fits(run, signal, repeat, factor, unit, len(t))
    figures = []
    if _has_raw(cell.arrays, len(t)):
        origin = Provenance.of(content.provenance)
        start, stop = _window(run.provenance(signal), origin)
        raw_t, raw_y = cell.arrays["raw_t"], cell.arrays["raw_y"] * factor
        caption = f"{signal}: the record as it was read."
        figures.append(
            run.drawings.add(
                f"raw-{signal}", caption, lambda: raw(raw_t, raw_y, start, stop, axis, origin.decays)
            )
        )
    caption = f"{signal}: the record as used" + (
        "; the fits of the likeliest models at their posterior modes, best first, and their residuals."
        if fits
        else "."
    )
    if any(len(fit.autocorrelation) for fit in fits):
        caption += " Grey band: what white noise would give."
    period = _period(content, t)
    figures.append(
        run.drawings.add(
            f"record-{signal}", caption, lambda: record(t, y * factor, fits, axis, ratio, period)
        )
    )
    return fill("record.html", notes=said, figures=figures, missing=missing, repeats=len(repeats))


def _fits(
    run: Run, signal: str, repeat: int, factor: float, unit: str, samples: int
) -> tuple[list[Fit], list[str]]:
    fits, missing = [], []
    for place, model in enumerate(models_kept(run, signal, repeat)):
        if not drawn(run, place):
            continue
        cell = run.cell("mode", signal, repeat, model)
        if cell is None:
            if only_answered(run):
                continue
            missing.append(f"No fit of {words.model(model)} is stored.")
        elif len(cell.arrays.get("fit", ())) != samples:
            missing.append(f"No fit of {words.model(model)}: {cell.outcome}")
        else:
            residual = cell.arrays["residual"] * factor
            row = next(
                (r for r in run.fits if (r["signal"], r["repeat"], r["model"]) == (signal, repeat, model)),
                None,
            )
            text = fmt.rms(*run.rms(row)) if row else f"not in fits.csv (axis in {unit})"
            autocorrelation = np.asarray(cell.arrays.get("autocorrelation", []), float)
            fits.append(Fit(model, cell.arrays["fit"] * factor, residual, autocorrelation, text))
    return fits, missing


def _has_raw(arrays: Mapping[str, np.ndarray], samples: int) -> bool:
    if not {"raw_t", "raw_y"} <= set(arrays) or len(arrays["raw_t"]) < 2:
        return False
    same = len(arrays["raw_t"]) == samples and np.array_equal(arrays["raw_y"], arrays["y"])
    return not same


def _window(*said: Provenance) -> tuple[float | None, float | None]:
    return next(((one.start, one.stop) for one in said if one.stop is not None), (None, None))


def _period(content: RecordContent, t: np.ndarray) -> float:
    return content.features.period if content.features is not None else 0.04 * float(t[-1] - t[0])


PLUGIN = Record()
