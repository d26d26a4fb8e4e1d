"""How good the fits are, and how far the coefficients move with the window."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from markupsafe import Markup
from scipy.special import expit

from bayesdamp import formatting as fmt
from bayesdamp.report import words
from bayesdamp.report.html import folded, paragraph, stack
from bayesdamp.report.results.answers import only_answered
from bayesdamp.report.results.reading import coefficients, mode_of, models_by_rank
from bayesdamp.report.results.run import Row, Run, rows_of
from bayesdamp.report.sections._layout import SignalSection, drawn
from bayesdamp.store.contents import ModeContent
from bayesdamp.table import Table
from bayesdamp.types import AddedForm, PartialFit

_EXACT = (
    "All of it is of fits under laws that hold exactly, which chains and evidence here do not need: what an exact law "
    "leaves is what the deviations take."
)


class FitQuality(SignalSection):
    """fits.csv, and the fits to parts of the record."""

    order = 70
    title = "How good the fits are"
    lead = (
        "The residual's autocorrelation at lag one tells whether neighbouring samples are as independent as white "
        "noise would have them. Stability over sub-records is how far a coefficient moves when only half of the "
        "record is used, in the standard deviations that such a move has by chance: up to about three is chance; "
        "above that, it and not the posterior's width limits what may be claimed. The predictive p is the share of "
        "records drawn from the model that fit worse than this one."
    )
    nothing = "No model was fitted in this study."

    def shows(self, run: Run, signal: str) -> bool:
        """Return whether modes were fitted."""
        fitted = any(r["signal"] == signal for r in run.fits) or bool(run.cells("mode", signal))
        return fitted and not only_answered(run)

    def part(self, run: Run, signal: str) -> Markup:
        """Return checks of each fit, and fits to parts of the record."""
        repeats = run.repeats(signal)
        ranked = models_by_rank(run, signal, repeats[0])
        parts: list[object] = [paragraph(_EXACT)] if run.under_law else []
        parts.append(_table(run, signal, repeats[:1]))
        if len(repeats) > 1:
            parts.append(folded(f"All {len(repeats)} repeats", _table(run, signal, repeats)))
        for place, model in enumerate(ranked):
            windows = _windows(run, signal, repeats[0], model) if drawn(run, place) else None
            if windows is not None:
                parts.append(folded(f"Windows of {words.model(model)}", windows) if place else windows)
        mode = mode_of(run, signal, repeats[0], ranked[0]) if ranked else None
        if mode is not None and mode.rivals:
            parts.append(
                folded(f"Other forms of damping beside {words.model(ranked[0])}", _other_forms(mode))
            )
        return stack(*parts)


def _table(run: Run, signal: str, repeats: Sequence[int]) -> Table:
    columns: dict[str, Callable[[Row], str]] = {
        "model": lambda r: words.model(r["model"]),
        "rms residual": run.rms,
        "autocorrelation": lambda r: fmt.fixed(r["residual_autocorrelation"], 2),
        "stability over sub-records": lambda r: fmt.number(r["window_spread"], 2),
        "predictive p": lambda r: fmt.number(r["predictive_p"], 2),
        "verdict": lambda r: r["verdict"] or fmt.NONE,
    }
    rows = []
    for repeat in repeats:
        ranked = models_by_rank(run, signal, repeat)
        own = rows_of(run.fits, signal=signal, repeat=repeat)
        rows += sorted(own, key=lambda r: ranked.index(r["model"]))
    if len(repeats) > 1:
        return Table.of(rows, {"repeat": lambda r: str(r["repeat"] + 1), **columns}, (1, 6))
    return Table.of(rows, columns, (0, 5))


def _other_forms(mode: ModeContent) -> Table:
    """Of each form of damping that no candidate has: with it in addition, how likely is the candidate?"""
    columns: dict[str, Callable[[AddedForm], str]] = {
        "what there might be beside it": lambda form: form.words,
        "ln Bayes factor": lambda form: fmt.fixed(form.log_bayes, 2),
        "probability, against none": lambda form: fmt.probability(float(expit(form.log_bayes))),
    }
    return Table.of(sorted(mode.rivals, key=lambda form: -form.log_bayes), columns)


def _windows(run: Run, signal: str, repeat: int, model: str) -> Table | None:
    """Return the damping coefficients from parts of the record; None where there are not two."""
    mode = mode_of(run, signal, repeat, model)
    found = [w for w in mode.windows if w.values] if mode else []
    names = [n for n in coefficients(run, model) if all(n in w.values for w in found)]
    if len(found) < 2 or not names:
        return None
    columns: dict[str, Callable[[PartialFit], str]] = {
        "window": lambda w: w.label,
        "from / s": lambda w: fmt.number(w.start, 4),
        "to / s": lambda w: fmt.number(w.stop, 4),
        **{words.symbol(n).text: lambda w, n=n: fmt.with_error(w.values.get(n), w.sd.get(n)) for n in names},
    }
    caption = (
        f"Damping coefficients of {words.model(model)} from parts of the record. Where they scatter by more than their "
        "standard deviations, the model is not the whole truth and the posterior is too narrow."
    )
    return Table.of(found, columns, caption=caption)


PLUGIN = FitQuality()
