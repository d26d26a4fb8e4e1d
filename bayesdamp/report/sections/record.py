"""Show each record with its fits, the choice of the noise model, and the quality of the fits."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial

import numpy as np
import scipy  # loads its modules when they are used
from markupsafe import Markup

from bayesdamp import formatting as fmt
from bayesdamp.formatting import Table
from bayesdamp.report import words
from bayesdamp.report.figures.record import ModelFit, draw_raw_record, record
from bayesdamp.report.results.run import (
    Row,
    RunFolder,
    answer_content,
    coefficients,
    mode_of,
    models_by_rank,
    models_not_pruned,
    only_answered,
    rows_of,
)
from bayesdamp.report.sections import SignalSection, collapsible, fill, is_drawn, paragraph, stack
from bayesdamp.store.contents import NoiseEvidence, RecordContent
from bayesdamp.types import OK, AddedForm, Friction, PartialFit, Provenance

USED = "used for the answer"
NOISES = (
    "Noise models: by how many nats the log evidence of each is below that of the best one, and its fitted parameters, "
    "in the units of the equation of motion."
)
WIDTHS = (
    "Widths ε that were compared: the posterior probability of each, and the coefficients of all damping terms in the "
    "fit with this width."
)
CHECKS = (
    "Checks of the fit of each model at its posterior mode: root mean square residual, autocorrelation of the residual "
    "at lag one, stability over sub-records (in standard deviations), predictive p, and the conclusion."
)
NOT_STORED = "The samples of this record are not stored with the run; run the study again."
_EXACT = (
    "All these fits assume that the laws hold exactly. The chains and the evidence of this study allow deviations from "
    "the laws, which account for systematic residuals of these fits."
)


class RecordSection(SignalSection):
    """The section with each signal as it was read, as it is used, and with the fits of the most probable models."""

    order = 30
    name = "record"
    title = "The record and the fits"

    def shows(self, run: RunFolder, signal: str) -> bool:
        """Return whether the signal is an oscillation; the section on the answer shows envelopes."""
        return run.quantity(signal) != "envelope"

    def part(self, run: RunFolder, signal: str) -> Markup:
        """Return notes on the record, and figures of the record and of the most probable fits."""
        repeats = run.repeats(signal)
        task_result, about, own = (
            run.task_result("signal", signal, repeats[0]),
            run.about(signal),
            run.provenance(signal),
        )
        notes = list(own.sentences)
        if about.get("epsilon_note") and not only_answered(run):  # the answer compares several widths
            notes.append(str(about["epsilon_note"]))
        if about.get("noise"):
            notes.append(f"The answer uses the noise model {words.method(about['noise'])}; see below.")
        if about.get("outcome", OK) != OK:
            notes.append(str(about["outcome"]))
        if task_result is None or "t" not in task_result.arrays:
            why = task_result.outcome if task_result else NOT_STORED
            return fill("record.html", notes=notes, figures=[], missing=[why], repeats=len(repeats))
        content = RecordContent.of(task_result)
        unit, quantity = run.unit(signal), run.quantity(signal)
        factor, name = unit.scale, unit.of(quantity)
        ratio = f"({name})" if "/" in name else name
        axis = f"{unit.quantity_name(quantity)} / {ratio}"
        t, y = task_result.arrays["t"], task_result.arrays["y"] * factor
        fits, missing, figures = [], [], []
        for place, model in enumerate(models_not_pruned(run, signal, repeats[0])):
            mode = run.task_result("mode", signal, repeats[0], model)
            if not is_drawn(run, place) or (mode is None and only_answered(run)):
                continue
            if mode is None:
                missing.append(f"No fit of {words.model(model)} is stored.")
            elif len(mode.arrays.get("fit", ())) != len(t):
                missing.append(f"No fit of {words.model(model)}: {mode.outcome}")
            else:
                rows = rows_of(run.fits, signal=signal, repeat=repeats[0], model=model)
                rms = run.rms(rows[0]) if rows else f"not in fits.csv (axis in {name})"
                autocorrelation = np.asarray(mode.arrays.get("autocorrelation", []), float)
                fit, residual = (mode.arrays[array] * factor for array in ("fit", "residual"))
                fits.append(ModelFit(model, fit, residual, autocorrelation, rms))
        raw_t, raw_y = (task_result.arrays.get(f"raw_{which}", np.empty(0)) for which in "ty")
        if len(raw_t) > 1 and not np.array_equal(raw_y, task_result.arrays["y"]):
            origin = Provenance.of(content.provenance)
            window = next(((o.start, o.stop) for o in (own, origin) if o.stop is not None), (None, None))
            draw = partial(draw_raw_record, raw_t, raw_y * factor, axis, *window, origin.decays)
            caption = f"{signal}: the whole record as it was read."
            if window[0] is not None:
                caption += " Shaded: the part that is used and, in a lighter shade, other free decays."
            figures.append(run.drawings.add(f"raw-{signal}", caption, draw))
        if fits:
            caption = (
                f"{signal}: the used part of the record (grey; time counts from its start) and the fits of the most "
                "probable models at their posterior modes. Top: the best fit. Middle: the first and the last cycles "
                "with all fits. Below: the residual of each fit, the best first, with its root mean square (rms)."
            )
            if any(len(fit.autocorrelation) for fit in fits):
                caption += (
                    " Right of it: the autocorrelation of the residual, whitened by the noise model; white noise stays "
                    "in the grey band (± 2 standard deviations)."
                )
            period = content.features.period if content.features is not None else 0.04 * float(t[-1] - t[0])
            draw = partial(record, t, y, fits, axis, ratio, period)
            figures.append(run.drawings.add(f"record-{signal}", caption, draw))
        elif not figures:
            draw = partial(draw_raw_record, t, y, axis)
            figures.append(
                run.drawings.add(
                    f"record-{signal}",
                    f"{signal}: the used part of the record. Time counts from its start.",
                    draw,
                )
            )
        return fill("record.html", notes=notes, figures=figures, missing=missing, repeats=len(repeats))


class NoiseSection(SignalSection):
    """The section with the evidence of the noise models and of the widths of friction, and the ones that are used.

    The width of friction is the velocity within which Coulomb friction changes its sign.
    """

    order = 45
    name = "noise"
    title = "Noise model, and width ε of friction"
    lead = (
        "The noise models are compared once for each record, on the residual of the fit of all damping terms, and all "
        "damping models use the chosen noise model. The evidence is Laplace's approximation. For the noise model of "
        "rounded values, probabilities are divided by the recording step, so that all noise models are on one scale. "
        "If correlated noise is the most probable, the answer uses Gaussian noise with the variance of the residual "
        "near the oscillation frequency. The sign of dry friction changes gradually, within a range of velocities of "
        "width ε. This affects a precise record at small amplitudes and at each turning point. If ε was not given, "
        "several values are compared once for each record, with all damping terms. The damping models are compared and "
        "sampled with 2 % of the peak velocity, or with the most probable value if it is clearly more probable. The "
        "damping ratios of the answer are averaged over all these values. Estimators use 2 %."
    )

    def shows(self, run: RunFolder, signal: str) -> bool:
        """Return whether several noise models or widths of friction were compared on a record."""
        content = answer_content(run, signal)
        return content is not None and (len(content.noises) > 1 or bool(content.frictions))

    def part(self, run: RunFolder, signal: str) -> Markup:
        """Return a table of the noise models with their evidence, and a table of the widths of friction."""
        content = answer_content(run, signal)
        assert content is not None
        noises = sorted(content.noises, key=lambda noise: -noise.log_evidence)
        of_noise: dict[str, Callable[[NoiseEvidence], str]] = {
            "noise": lambda n: words.method(n.name),
            "log evidence below the best": lambda n: fmt.fixed_decimals(
                noises[0].log_evidence - n.log_evidence, 1
            ),
            "fitted parameters": lambda n: ", ".join(
                f"{words.symbol(name).text} {fmt.number(value, 3)}" for name, value in n.values.items()
            ),
            "": lambda n: USED if n.name == content.noise else "",
        }
        of_width: dict[str, Callable[[Friction], str]] = {
            f"ε / ({run.unit(signal).base}/s)": lambda width: fmt.number(width.epsilon, 3),
            "probability": lambda width: fmt.fixed_decimals(width.weight, 3),
        }
        for i, term in enumerate(content.terms):
            of_width[words.model(term)] = lambda width, i=i: fmt.number(width.coefficients[i], 4)
        of_width[""] = lambda width: "used for the models" if width.epsilon == content.epsilon else ""
        tables: list[Table] = []
        if len(noises) > 1:
            best = {content.noise: "best"}
            tables.append(Table.of(noises, of_noise, (0, 2, 3), NOISES, lambda n: best.get(n.name, "")))
        if content.frictions:
            width = {content.epsilon: "best"}
            left = (len(of_width) - 1,)
            tables.append(
                Table.of(content.frictions, of_width, left, WIDTHS, lambda w: width.get(w.epsilon, ""))
            )
        return stack(*tables)


class FitQualitySection(SignalSection):
    """The section with the checks of each fit, as in fits.csv, and with fits to parts of the record."""

    order = 70
    name = "fit_quality"
    title = "Quality of the fits"
    lead = (
        "The autocorrelation of the residual at lag one shows whether neighbouring samples are independent, as for "
        "white noise (then it is near 0). The stability over sub-records is the largest change of a damping "
        "coefficient when only half of the record is used, in units of the standard deviation that is expected by "
        "chance. Up to about three it can be chance; above that, the accuracy is limited by this change and not by "
        "the width of the posterior. The predictive p is the fraction of simulated white noise that is as strongly "
        "autocorrelated as the residual, averaged over the posterior; a small value means that structure remains in "
        "the residual."
    )
    nothing = "No model was fitted in this study."

    def shows(self, run: RunFolder, signal: str) -> bool:
        """Return whether models were fitted."""
        fitted = any(r["signal"] == signal for r in run.fits) or bool(run.task_results("mode", signal))
        return fitted and not only_answered(run)

    def part(self, run: RunFolder, signal: str) -> Markup:
        """Return checks of each fit, fits to parts of the record, and the evidence for additional forms of damping."""
        repeats = run.repeats(signal)
        ranked = models_by_rank(run, signal, repeats[0])
        parts: list[object] = [paragraph(_EXACT)] if run.under_law else []
        parts.append(_table(run, signal, repeats[:1]))
        if len(repeats) > 1:
            parts.append(collapsible(f"All {len(repeats)} repeats", _table(run, signal, repeats)))
        for place, model in enumerate(ranked):
            mode = mode_of(run, signal, repeats[0], model) if is_drawn(run, place) else None
            windows = [w for w in mode.windows if w.values] if mode else []
            names = [n for n in coefficients(run, model) if all(n in w.values for w in windows)]
            if len(windows) < 2 or not names:
                continue
            of_part: dict[str, Callable[[PartialFit], str]] = {
                "part": lambda w: w.label,
                "from / s": lambda w: fmt.number(w.start, 4),
                "to / s": lambda w: fmt.number(w.stop, 4),
            }
            for n in names:
                of_part[words.symbol(n).text] = lambda w, n=n: fmt.with_error(w.values.get(n), w.sd.get(n))
            caption = (
                f"Coefficients of {words.model(model)} damping from parts of the record, with their standard "
                "deviations (±). If they differ by much more than these, the model is incomplete and the posterior is "
                "too narrow."
            )
            table = Table.of(windows, of_part, caption=caption)
            parts.append(
                collapsible(f"Coefficients of {words.model(model)} from parts of the record", table)
                if place
                else table
            )
        mode = mode_of(run, signal, repeats[0], ranked[0]) if ranked else None
        if mode is not None and mode.rivals:
            columns: dict[str, Callable[[AddedForm], str]] = {
                "additional form": lambda form: form.words,
                "log Bayes factor": lambda form: fmt.fixed_decimals(form.log_bayes, 2),
                "probability at equal prior odds": lambda form: fmt.probability(
                    float(scipy.special.expit(form.log_bayes))
                ),
            }
            caption = (
                f"Log Bayes factor (nats) of {words.model(ranked[0])} with each additional form of damping against "
                f"{words.model(ranked[0])} alone, and the probability that this gives if both are equally probable in "
                "advance."
            )
            forms = sorted(mode.rivals, key=lambda form: -form.log_bayes)
            table = Table.of(forms, columns, caption=caption)
            parts.append(
                collapsible(f"Other forms of damping in addition to {words.model(ranked[0])}", table)
            )
        return stack(*parts)


def _table(run: RunFolder, signal: str, repeats: Sequence[int]) -> Table:
    """Return a table with the checks of each model's fit."""
    rows = []
    for repeat in repeats:
        ranked = models_by_rank(run, signal, repeat)
        own = rows_of(run.fits, signal=signal, repeat=repeat)
        rows += sorted(own, key=lambda r: ranked.index(r["model"]))
    first: dict[str, Callable[[Row], str]] = {"repeat": lambda r: str(r["repeat"] + 1)}
    columns: dict[str, Callable[[Row], str]] = {
        **(first if len(repeats) > 1 else {}),
        "model": lambda r: words.model(r["model"]),
        "rms residual": run.rms,
        "autocorrelation": lambda r: fmt.fixed_decimals(r["residual_autocorrelation"], 2),
        "stability over sub-records": lambda r: fmt.number(r["window_spread"], 2),
        "predictive p": lambda r: fmt.number(r["predictive_p"], 2),
        "verdict": lambda r: r["verdict"] or fmt.NONE,
    }
    return Table.of(rows, columns, (len(columns) - 6, len(columns) - 1), CHECKS)


PLUGINS = (RecordSection(), NoiseSection(), FitQualitySection())
