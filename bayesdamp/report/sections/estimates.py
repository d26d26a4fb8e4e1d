"""The estimators: what each one found, by itself and refined."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

import numpy as np
from markupsafe import Markup

from bayesdamp import formatting as fmt
from bayesdamp.report import words
from bayesdamp.report.figures.iterations import traces
from bayesdamp.report.html import fill, folded, paragraph
from bayesdamp.report.results.answers import only_answered
from bayesdamp.report.results.comparing import compared
from bayesdamp.report.results.estimates import covered, estimates_of
from bayesdamp.report.results.reading import coefficients, models_by_rank, truth
from bayesdamp.report.results.run import Row, Run, rows_of
from bayesdamp.report.sections._layout import by_model, by_signal, drawn
from bayesdamp.report.sections._section import Section
from bayesdamp.report.sections.against import picture
from bayesdamp.table import Line, Table
from bayesdamp.types import OK


class Estimates(Section):
    """Tables and figures of estimates.csv, the best model open, the others folded."""

    order = 40
    name = "estimates"
    title = "The estimators"

    def applies(self, run: Run) -> bool:
        """Where estimators ran, or went without a word in a study that weighs."""
        return bool(run.estimates) or (bool(run.signals) and not only_answered(run))

    def render(self, run: Run) -> str:
        """A figure and a table a signal and model."""
        if not run.estimates:
            return paragraph("No estimator ran in this study.")
        wanted = [s for s in run.signals if any(r["signal"] == s for r in run.estimates)]
        return fill("estimates.html", body=by_signal(run, _one, wanted))


def _one(run: Run, signal: str) -> Markup:
    repeats = run.repeats(signal)
    models: list[tuple[str, list[object]]] = []
    for place, model in enumerate(models_by_rank(run, signal, repeats[0])):
        rows = rows_of(run.estimates, signal=signal, model=model)
        if not rows:
            continue
        shown = len(repeats) == 1 and covered(run, signal, model)  # in the section that compares them
        content: list[object] = [_figure(run, signal, model)] if drawn(run, place) and not shown else []
        content.append(_table(run, signal, model, rows, repeats))
        others = [r for r in rows if r["repeat"] == repeats[0] and math.isfinite(r["value"])]
        others = [r for r in others if r["parameter"] not in coefficients(run, model)]
        if others:
            content.append(folded("The other parameters", _others(others)))
        curves = _traces(run, signal, repeats[0], model) if drawn(run, place) else None
        if curves:
            content.append(folded("How the iterative methods converged", curves))
        models.append((model, content))
    return by_model(models, "Under ")


def _figure(run: Run, signal: str, model: str) -> Markup:
    every = (estimates_of(run, compared(run), signal, model, name) for name in coefficients(run, model))
    found = [one for one in every if len(one.methods) > 1 or (one.methods and one.posterior)]
    repeats = len(run.repeats(signal))
    lead = f"{signal}, {words.model(model)}{f', repeat 1 of {repeats}' if repeats > 1 else ''}. "
    return picture(run, found, f"estimates-{signal}-{model}", lead) if found else Markup("")


def _table(run: Run, signal: str, model: str, rows: Sequence[Row], repeats: Sequence[int]) -> Table:
    names = [n for n in coefficients(run, model) if any(r["parameter"] == n for r in rows)]
    known = {n: truth(run, signal, n) for n in names}
    units = {r["parameter"]: words.unit(r["unit"]) for r in rows}
    headers = ["estimator", "stage"]
    for name in names:
        headers.append(f"{words.symbol(name).text} / ({units.get(name, '')})")
        if known[name] and math.isfinite(known[name]):
            headers.append("error / %")
    headers += ["evaluations", "time", "outcome"]
    left = frozenset({0, 1, len(headers) - 1})
    lines = []
    for estimator, stage in dict.fromkeys((r["estimator"], r["stage"]) for r in rows):
        own = rows_of(rows, estimator=estimator, stage=stage)
        cells = [words.method(estimator), words.stage(stage)]
        for name in names:
            found = [r for r in own if r["parameter"] == name and math.isfinite(r["value"])]
            cells.append(_value(found))
            if known[name] and math.isfinite(known[name]):
                cells.append(_error(found))
        bad = [r["outcome"] for r in own if r["outcome"] != OK]
        outcome = OK if not bad else bad[0] if len(repeats) == 1 else f"{len(bad)} × {bad[0]}"
        seconds = [r["seconds"] for r in own]
        counts = [r["evaluations"] for r in own if r["evaluations"] is not None]
        cells += [
            f"{max(counts):,}".replace(",", "\u202f") if counts else fmt.NONE,
            fmt.duration(max(seconds)),
        ]
        lines.append(
            Line([*cells, outcome], "quiet" if not any(math.isfinite(r["value"]) for r in own) else "")
        )
    caption = "Truth: " + fmt.listing(
        f"{words.symbol(n).text} = {fmt.given(v)} {units.get(n, '')}"
        for n, v in known.items()
        if math.isfinite(v)
    )
    many = (
        f"Range over {len(repeats)} repeats; evaluations and time: the largest." if len(repeats) > 1 else ""
    )
    said = caption + ". " if any(math.isfinite(v) for v in known.values()) else ""
    return Table(headers, lines, left, said + many)


def _value(found: Sequence[Row]) -> str:
    if not found:
        return fmt.NONE
    if len(found) == 1:
        return fmt.with_error(found[0]["value"], found[0]["stderr"])
    values = [r["value"] for r in found if math.isfinite(r["value"])]
    return fmt.spread(min(values), max(values)) if values else fmt.NONE


def _error(found: Sequence[Row]) -> str:
    errors = [abs(r["error_pct"]) for r in found if math.isfinite(r["error_pct"])]
    if not errors:
        return fmt.NONE
    if len(errors) == 1:
        return fmt.number(errors[0], 3)
    return f"{fmt.number(min(errors), 2)} to {fmt.number(max(errors), 2)}"


def _others(rows: Sequence[Row]) -> Table:
    columns: dict[str, Callable[[Row], str]] = {
        "estimator": lambda r: words.method(r["estimator"]),
        "stage": lambda r: words.stage(r["stage"]),
        "parameter": lambda r: words.symbol(r["parameter"]).text,
        "value": lambda r: fmt.with_error(r["value"], r["stderr"]),
        "unit": lambda r: words.unit(r["unit"]),
    }
    return Table.of(rows, columns, (0, 1, 2, 4))


def _traces(run: Run, signal: str, repeat: int, model: str) -> Markup | None:
    curves: dict[str, np.ndarray] = {}
    for cell in run.cells("estimate", signal, repeat, model):
        estimator = cell.place.method
        for name, curve in cell.arrays.items():
            if curve.ndim == 1 and curve.size >= 3 and np.issubdtype(curve.dtype, np.number):
                curves[f"{words.method(estimator)}: {name.replace('_', ' ').replace('/', ' ')}"] = curve
    if not curves:
        return None
    caption = f"{signal}, {words.model(model)}: progress of the iterative methods."
    return run.drawings.add(f"traces-{signal}-{model}", caption, lambda: traces(curves))


PLUGIN = Estimates()
