"""How good the fits are, and how far the coefficients move with the window."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from markupsafe import Markup
from scipy.special import expit

from bayesdamp import formatting as fmt
from bayesdamp.report import words
from bayesdamp.report.figures.posterior import Panel, intervals
from bayesdamp.report.html import fill, folded, paragraph, stack
from bayesdamp.report.results.answers import only_answered
from bayesdamp.report.results.reading import coefficients, mode_of, models_by_rank
from bayesdamp.report.results.run import Row, Run, rows_of
from bayesdamp.report.sections._layout import by_signal, drawn
from bayesdamp.report.sections._section import Section
from bayesdamp.report.style import colour
from bayesdamp.store.contents.candidates import ModeContent
from bayesdamp.table import Table
from bayesdamp.types import AddedForm, PartialFit

_EXACT = (
    "All of it is of fits under laws that hold exactly, which chains and evidence here do not need: what an exact law "
    "leaves is what the deviations take."
)


class FitQuality(Section):
    """fits.csv, and the fits to parts of the record."""

    order = 70
    name = "fit_quality"
    title = "How good the fits are"

    def applies(self, run: Run) -> bool:
        """Where modes were fitted, or should have been."""
        return bool(run.signals) and not only_answered(run)

    def render(self, run: Run) -> str:
        """Checks of each fit, and fits to parts of the record."""
        if not run.fits and not any(run.cells("mode", s) for s in run.signals):
            return paragraph("No model was fitted in this study.")
        body: object = by_signal(run, _one)
        if run.under_law:
            body = stack(paragraph(_EXACT), body)
        return fill("fit_quality.html", body=body)


def _one(run: Run, signal: str) -> Markup:
    repeats = run.repeats(signal)
    repeat = repeats[0]
    ranked = models_by_rank(run, signal, repeat)
    parts: list[object] = []
    if rows_of(run.fits, signal=signal, repeat=repeat):
        parts.append(_table(run, signal, [repeat]))
        if len(repeats) > 1:
            parts.append(folded(f"All {len(repeats)} repeats", _table(run, signal, repeats)))
    shown = 0
    for place, model in enumerate(ranked):
        if not drawn(run, place):
            continue
        content = _windows(run, signal, repeat, model)
        if content is None:
            continue
        parts.append(content if shown == 0 else folded(f"Windows of {words.model(model)}", content))
        shown += 1
    mode = mode_of(run, signal, repeat, ranked[0]) if ranked else None
    if mode is not None and mode.rivals:
        parts.append(folded(f"Other forms of damping beside {words.model(ranked[0])}", _other_forms(mode)))
    return stack(*(parts or [paragraph("No model was fitted to this signal.")]))


def _table(run: Run, signal: str, repeats: list[int]) -> Table:
    columns: dict[str, Callable[[Row], str]] = {
        "model": lambda r: words.model(r["model"]),
        "rms residual": lambda r: fmt.rms(*run.rms(r)),
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


def _windows(run: Run, signal: str, repeat: int, model: str) -> Markup | None:
    mode = mode_of(run, signal, repeat, model)
    found = [w for w in mode.windows if w.values] if mode else []
    names = [n for n in coefficients(run, model) if all(n in w.values for w in found)]
    if len(found) < 2 or not names:
        return None
    units = {r["parameter"]: r["unit"] for r in (*run.posteriors, *run.estimates) if r["model"] == model}
    caption = (
        f"{signal}, {words.model(model)}: damping coefficients from parts of the record. Where they "
        "scatter by more than their bars, the model is not the whole truth and the posterior is too narrow."
    )
    panels = []
    for name in names:
        each = [(w.values[name], float(np.nan_to_num(w.sd.get(name, 0.0)))) for w in found]
        rows = [(value - sd, value, value + sd) for value, sd in each]
        panels.append(Panel(words.axis(name, units.get(name, "")), rows, rows[0]))
    drawing = run.drawings.add(
        f"windows-{signal}-{model}",
        caption,
        lambda: intervals([w.label for w in found], panels, colour(model)),
    )
    columns: dict[str, Callable[[PartialFit], str]] = {
        "window": lambda w: w.label,
        "from / s": lambda w: fmt.number(w.start, 4),
        "to / s": lambda w: fmt.number(w.stop, 4),
        **{words.symbol(n).text: lambda w, n=n: fmt.with_error(w.values.get(n), w.sd.get(n)) for n in names},
    }
    return stack(drawing, folded("These numbers", Table.of(found, columns)))


PLUGIN = FitQuality()
