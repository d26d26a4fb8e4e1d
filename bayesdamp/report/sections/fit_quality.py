"""Quality of the fits, and how far the coefficients change with the part of the record."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from markupsafe import Markup
from scipy.special import expit

from bayesdamp import formatting as fmt
from bayesdamp.report import words
from bayesdamp.report.markup import folded, paragraph, stack
from bayesdamp.report.results.answers import only_answered
from bayesdamp.report.results.reading import coefficients, mode_of, models_by_rank
from bayesdamp.report.results.run import Row, RunFolder, rows_of
from bayesdamp.report.sections import SignalSection, is_drawn
from bayesdamp.table import Table
from bayesdamp.types import AddedForm, PartialFit

_EXACT = (
    "All these fits assume that the laws hold exactly. Chains and evidence in this study do not assume this: their "
    "deviations explain what an exact law leaves."
)


class FitQualitySection(SignalSection):
    """fits.csv, and the fits to parts of the record."""

    order = 70
    title = "Quality of the fits"
    lead = (
        "The autocorrelation of the residual at lag one shows whether neighbouring samples are independent, as for "
        "white noise. The stability over sub-records is the change of a coefficient when only half of the record is "
        "used, in units of the standard deviation that is expected by chance. Up to about three it can be chance; "
        "above that, this change limits the accuracy, not the width of the posterior. The predictive p is the share of "
        "records, simulated from the model, that fit worse than this one."
    )
    nothing = "No model was fitted in this study."

    def shows(self, run: RunFolder, signal: str) -> bool:
        """Return whether models were fitted."""
        fitted = any(r["signal"] == signal for r in run.fits) or bool(run.cells("mode", signal))
        return fitted and not only_answered(run)

    def part(self, run: RunFolder, signal: str) -> Markup:
        """Return checks of each fit, and fits to parts of the record."""
        repeats = run.repeats(signal)
        ranked = models_by_rank(run, signal, repeats[0])
        parts: list[object] = [paragraph(_EXACT)] if run.under_law else []
        parts.append(_table(run, signal, repeats[:1]))
        if len(repeats) > 1:
            parts.append(folded(f"All {len(repeats)} repeats", _table(run, signal, repeats)))
        for place, model in enumerate(ranked):
            windows = _windows(run, signal, repeats[0], model) if is_drawn(run, place) else None
            if windows is not None:
                parts.append(
                    folded(f"Parts of the record: {words.model(model)}", windows) if place else windows
                )
        mode = mode_of(run, signal, repeats[0], ranked[0]) if ranked else None
        if mode is not None and mode.rivals:
            columns: dict[str, Callable[[AddedForm], str]] = {
                "additional form": lambda form: form.words,
                "ln Bayes factor": lambda form: fmt.fixed(form.log_bayes, 2),
                "probability, against none": lambda form: fmt.probability(float(expit(form.log_bayes))),
            }
            table = Table.of(sorted(mode.rivals, key=lambda form: -form.log_bayes), columns)
            parts.append(folded(f"Other forms of damping in addition to {words.model(ranked[0])}", table))
        return stack(*parts)


def _table(run: RunFolder, signal: str, repeats: Sequence[int]) -> Table:
    """Return the checks of each model's fit."""
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
        "autocorrelation": lambda r: fmt.fixed(r["residual_autocorrelation"], 2),
        "stability over sub-records": lambda r: fmt.number(r["window_spread"], 2),
        "predictive p": lambda r: fmt.number(r["predictive_p"], 2),
        "verdict": lambda r: r["verdict"] or fmt.NONE,
    }
    return Table.of(rows, columns, (len(columns) - 6, len(columns) - 1))


def _windows(run: RunFolder, signal: str, repeat: int, model: str) -> Table | None:
    """Return the damping coefficients from parts of the record; None if there are fewer than two parts."""
    mode = mode_of(run, signal, repeat, model)
    windows = [w for w in mode.windows if w.values] if mode else []
    names = [n for n in coefficients(run, model) if all(n in w.values for w in windows)]
    if len(windows) < 2 or not names:
        return None
    columns: dict[str, Callable[[PartialFit], str]] = {
        "part": lambda w: w.label,
        "from / s": lambda w: fmt.number(w.start, 4),
        "to / s": lambda w: fmt.number(w.stop, 4),
        **{words.symbol(n).text: lambda w, n=n: fmt.with_error(w.values.get(n), w.sd.get(n)) for n in names},
    }
    caption = (
        f"Damping coefficients of {words.model(model)} from parts of the record. If they differ by more than their "
        "standard deviations, the model is not complete and the posterior is too narrow."
    )
    return Table.of(windows, columns, caption=caption)


PLUGIN = FitQualitySection()
