"""Show each record, the part of it that is used, and the fits of models."""

import math
from functools import partial

import numpy as np
from markupsafe import Markup

from bayesdamp import formatting as fmt
from bayesdamp.report import words
from bayesdamp.report.figures.record import ModelFit, draw_raw_record, record
from bayesdamp.report.results.run import RunFolder, answer_of, models_not_pruned, rms_of, rows_of
from bayesdamp.report.sections import SignalSection, bullets, is_drawn, paragraph, stack
from bayesdamp.store.results import RecordContent
from bayesdamp.types import OK

WHOLE = (
    "the whole record as it was read. The used part, which may be all of it, is shaded. Other free decays are shaded "
    "in another colour (see the legend)."
)
FITTED = (
    "the part that is used (grey; time counts from its start), and the fits of the most probable models (one or more, "
    "see the legend) at their posterior modes. Top: the best fit. Middle: the first and the last cycles with all fits. "
    "Below: the residual of each fit, the best first, with its root mean square (rms). Right of it: the "
    "autocorrelation of the residual after whitening by the noise model; for white noise, about 95 % of it is in the "
    "grey band (± 2 standard deviations)."
)
WITHOUT_FITS = "all of it is used."
"""Captions of the figures of a record; "Record", its name and a colon precede them."""
NOT_STORED = "The samples of this record are not stored with the run; run the study again."


class RecordSection(SignalSection):
    """The section with each signal as it was read, as it is used, and with the fits of the most probable models."""

    order = 30
    title = "The record and the fits"
    draws_models = True

    def shows(self, run: RunFolder, signal: str) -> bool:
        """Return whether the signal is an oscillation. Envelopes are shown in the section on the answer."""
        return run.quantity(signal) != "envelope"

    def part(self, run: RunFolder, signal: str) -> Markup:
        """Return notes on the record, and figures of the record and of the most probable fits."""
        repeats = run.repeats(signal)
        task_result = run.task_result("signal", signal, repeats[0])
        about, own = run.about(signal), run.provenance(signal)
        notes = list(own.sentences)
        if about.get("epsilon_note") and not run.only_answered:  # the answer compares several values of ε
            notes.append(str(about["epsilon_note"]))
        if about.get("noise"):
            notes.append(f"The answer uses the noise model {words.method(about['noise'])}.")
        if about.get("outcome", OK) != OK:
            notes.append(str(about["outcome"]))
        if len(repeats) > 1:
            notes.append(f"The figures show repeat 1 of {len(repeats)}.")
        if task_result is None or "t" not in task_result.arrays:
            why = task_result.outcome if task_result else NOT_STORED
            return stack(bullets(notes), paragraph(why, "quiet"))
        content = RecordContent.of(task_result)
        unit, quantity = run.unit(signal), run.quantity(signal)
        answer = answer_of(run, signal, ("answer",))
        width = answer.content.epsilon if answer and not run.only_answered else None
        if width is not None and not math.isclose(width, content.known.get("epsilon", width), rel_tol=1e-3):
            size = f"{fmt.number(width, 3)} {unit.base}/s"
            notes.append(
                f"The damping models are compared with ε = {size}. This width of the velocity range in which friction "
                "changes its sign is clearly more probable than the default, 2 % of the peak velocity."
            )
        factor, name = unit.scale, unit.of(quantity)
        axis = f"{unit.quantity_name(quantity)} / {words.divisor(name)}"
        t, y = task_result.arrays["t"], task_result.arrays["y"] * factor
        parts: list[Markup] = [bullets(notes)]
        raw_t, raw_y = (task_result.arrays.get(f"raw_{which}", np.empty(0)) for which in "ty")
        if len(raw_t) > 1 and not np.array_equal(raw_y, task_result.arrays["y"]):
            draw = partial(draw_raw_record, raw_t, raw_y * factor, axis, own.start, own.stop, own.decays)
            parts.append(run.drawings.add(f"raw-{signal}", f"Record “{signal}”: {WHOLE}", draw))
        fits, missing = [], []
        for place, model in enumerate(models_not_pruned(run, signal, repeats[0])):
            mode = run.task_result("mode", signal, repeats[0], model)
            if not is_drawn(run, place) or (mode is None and run.only_answered):
                continue
            if mode is None:
                missing.append(f"No fit of {words.model(model)} is stored.")
            elif len(mode.arrays.get("fit", ())) != len(t):
                missing.append(f"No fit of {words.model(model)}: {mode.outcome}")
            else:
                rows = rows_of(run.fits, signal=signal, repeat=repeats[0], model=model)
                rms = rms_of(rows[0]) if rows else "not in fits.csv"
                autocorrelation = np.asarray(mode.arrays.get("autocorrelation", []), float)
                fit, residual = (mode.arrays[array] * factor for array in ("fit", "residual"))
                fits.append(ModelFit(model, fit, residual, autocorrelation, rms))
        # For a record that was averaged over cycles, the answer shows only the amplitudes, which are positive.
        is_in_answer = answer is not None and np.min(answer.arrays.get("record", 0.0)) < 0
        if fits:
            period = content.features.period if content.features else float(t[-1] - t[0])
            draw = partial(record, t, y, fits, axis, words.divisor(name), period)
            parts.append(run.drawings.add(f"record-{signal}", f"Record “{signal}”: {FITTED}", draw))
        elif len(parts) == 1 and not is_in_answer:
            draw = partial(draw_raw_record, t, y, axis)
            parts.append(run.drawings.add(f"record-{signal}", f"Record “{signal}”: {WITHOUT_FITS}", draw))
        return stack(*parts, *(paragraph(sentence, "quiet") for sentence in missing))


PLUGIN = RecordSection()
