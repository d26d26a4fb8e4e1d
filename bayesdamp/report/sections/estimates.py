"""The estimators: what each one found, by itself and refined."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import Any

import numpy as np
from markupsafe import Markup

from bayesdamp import formatting as fmt
from bayesdamp.report import words
from bayesdamp.report.figures.estimators import against, eigenvalues, force, traces
from bayesdamp.report.html import folded, paragraph, stack
from bayesdamp.report.results.comparing import true_models
from bayesdamp.report.results.estimates import CoefficientEstimates, estimates_of
from bayesdamp.report.results.reading import coefficients, models_by_rank, truth
from bayesdamp.report.results.run import Row, Run, rows_of
from bayesdamp.report.sections._layout import SignalSection, by_model, drawn
from bayesdamp.store.contents import EstimateContent
from bayesdamp.table import Line, Table
from bayesdamp.types import OK

Details = Mapping[str, Any]
TOLD = {
    "selected", "coefficients", "chosen", "pareto_chosen", "pareto_length", "pareto_error", "pareto_expression",
    "path_threshold", "path_terms", "path_score",
}  # fmt: skip
"""Details that stand in tables of their own, or are steps on the way to them."""


class Estimates(SignalSection):
    """Tables and figures of estimates.csv, the best model open, the others folded."""

    order = 40
    title = "The estimators"
    lead = Markup(
        "Each estimator first works by itself (its <em>own estimate</em>, from the record alone), then its result "
        "starts a <em>trajectory fit</em> (output-error fit). Fitted values should agree, for there is one optimum; "
        "how far its own estimate is off tells what its method is worth on this record."
    )
    nothing = "No estimator ran in this study."

    def shows(self, run: Run, signal: str) -> bool:
        """Return whether estimators ran on a signal."""
        return any(r["signal"] == signal for r in run.estimates)

    def part(self, run: Run, signal: str) -> Markup:
        """Return a figure and a table for each model, and what methods found besides under the best one."""
        repeats = run.repeats(signal)
        ranked = models_by_rank(run, signal, repeats[0])
        besides = true_models(run).get(signal) or ranked[0]
        models: list[tuple[str, list[object]]] = []
        for place, model in enumerate(ranked):
            rows = rows_of(run.estimates, signal=signal, model=model)
            if not rows:
                continue
            content = _figure(run, signal, model) if drawn(run, place) else []
            content.append(_table(run, signal, model, rows, repeats))
            others = [r for r in rows if r["repeat"] == repeats[0] and math.isfinite(r["value"])]
            others = [r for r in others if r["parameter"] not in coefficients(run, model)]
            if others:
                content.append(folded("The other parameters", _others(others)))
            curves = _traces(run, signal, repeats[0], model) if drawn(run, place) else None
            if curves:
                content.append(folded("How the iterative methods converged", curves))
            content += _besides(run, signal, model) if model == besides else []
            models.append((model, content))
        return by_model(models, "Under ")


def _figure(run: Run, signal: str, model: str) -> list[object]:
    """Return the picture of the estimates against the posterior, and how many of them lie in its interval."""
    every = estimates_of(run, signal, model)
    found = [one for one in every if len(one.methods) > 1 or (one.methods and one.posterior)]
    if not found:
        return []
    repeats = len(run.repeats(signal))
    caption = [
        f"{signal}, {words.model(model)}{f', repeat 1 of {repeats}' if repeats > 1 else ''}. What each method found by "
        "itself (open) and after the trajectory fit that starts there (filled)."
    ]
    if any(one.posterior for one in found):
        caption.append(
            "An estimate inside the shaded interval is as good as the record allows; outside it, the method adds an "
            "error of its own."
        )
    if any(one.posterior and one.source != signal for one in found):
        caption.append(f"A record without noise has no posterior and shows that of {found[0].source}.")
    if any(one.published for one in found):
        caption.append("Published errors have no sign: a tick on each side of the truth.")
    if any(math.isfinite(value) for one in found for value in one.own.values()):
        caption.append("Arrows: off the axis.")
    name, draw = f"estimates-{signal}-{model}", partial(against, found)
    picture = run.drawings.add(name, " ".join(caption), draw, narrow=True)
    said = inside(found)
    return [picture, said and paragraph(said)]


def inside(found: Sequence[CoefficientEstimates]) -> str:
    """Return a sentence on how many of the estimates lie in the interval of their own record."""
    said = []
    for name, stage in (("own estimates", "own"), ("trajectory fits", "refined")):
        values = [
            one.posterior[0] <= value <= one.posterior[1]
            for one in found
            if one.posterior is not None and one.source == one.signal
            for value in getattr(one, stage).values()
        ]
        said += [f"{sum(values)} of the {len(values)} {name}"] if values else []
    return f"{fmt.listing(said)} lie in the posterior's 95 % interval." if said else ""


def _table(run: Run, signal: str, model: str, rows: Sequence[Row], repeats: Sequence[int]) -> Table:
    names = [n for n in coefficients(run, model) if any(r["parameter"] == n for r in rows)]
    known = {n: truth(run, signal, n) for n in names}
    units = {r["parameter"]: words.unit(r["unit"]) for r in rows}

    def of(rows: Sequence[Row], name: str) -> list[Row]:
        return [r for r in rows if r["parameter"] == name and math.isfinite(r["value"])]

    def outcome(rows: Sequence[Row]) -> str:
        bad = [r["outcome"] for r in rows if r["outcome"] != OK]
        return OK if not bad else bad[0] if len(repeats) == 1 else f"{len(bad)} × {bad[0]}"

    def evaluations(rows: Sequence[Row]) -> str:
        counts = [r["evaluations"] for r in rows if r["evaluations"] is not None]
        return f"{max(counts):,}".replace(",", "\u202f") if counts else fmt.NONE

    columns: dict[str, Callable[[Sequence[Row]], str]] = {
        "estimator": lambda rows: words.method(rows[0]["estimator"]),
        "stage": lambda rows: words.stage(rows[0]["stage"]),
    }
    for name in names:
        symbol = words.symbol(name).text
        columns[f"{symbol} / ({units.get(name, '')})"] = lambda rows, name=name: _value(of(rows, name))
        if known[name] and math.isfinite(known[name]):
            of_one = f"error of {symbol} / %" if len(names) > 1 else "error / %"
            columns[of_one] = lambda rows, name=name: _error(of(rows, name))
    columns |= {
        "evaluations": evaluations,
        "time": lambda rows: fmt.duration(max(r["seconds"] for r in rows)),
        "outcome": outcome,
    }
    pairs = dict.fromkeys((r["estimator"], r["stage"]) for r in rows)
    truths = fmt.listing(
        f"{words.symbol(n).text} = {fmt.given(v)} {units.get(n, '')}"
        for n, v in known.items()
        if math.isfinite(v)
    )
    many = (
        f"Range over {len(repeats)} repeats; evaluations and time: the largest." if len(repeats) > 1 else ""
    )
    return Table.of(
        [rows_of(rows, estimator=estimator, stage=stage) for estimator, stage in pairs],
        columns,
        (0, 1, len(columns) - 1),
        (f"Truth: {truths}. " if truths else "") + many,
        lambda rows: "" if any(math.isfinite(r["value"]) for r in rows) else "quiet",
    )


def _value(found: Sequence[Row]) -> str:
    if len(found) == 1:
        return fmt.with_error(found[0]["value"], found[0]["stderr"])
    values = [r["value"] for r in found]
    return fmt.spread(values) if values else fmt.NONE


def _error(found: Sequence[Row]) -> str:
    errors = [abs(r["error_pct"]) for r in found if math.isfinite(r["error_pct"])]
    if len(errors) < 2:
        return fmt.number(errors[0], 3) if errors else fmt.NONE
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


def _besides(run: Run, signal: str, model: str) -> list[object]:
    """Return what methods found besides the coefficients: terms, expressions, eigenvalues, forces."""
    found: dict[str, Details] = {}
    for cell in run.cells("estimate", signal, run.repeats(signal)[0], model):
        for stage in EstimateContent.of(cell).stages:
            if stage.details:
                found[cell.place.method] = stage.details
    parts: list[object] = []
    chosen = [Line([words.method(m), _terms(d)]) for m, d in found.items() if "selected" in d]
    chosen += [Line([words.method(m), str(d["chosen"])]) for m, d in found.items() if "chosen" in d]
    if chosen:
        said = "Structure by itself: the terms that a sparse regression kept, the expression that was bred."
        parts.append(Table(["method", "damping found"], chosen, (0, 1), said))
    for method, details in found.items():
        if "pareto_expression" in details:
            parts.append(folded(f"The Pareto front of {words.method(method)}", _front(details)))
        parts.append(_drawn(run, signal, model, method, details))
        rest = [Line([k.replace("_", " "), _plain(v)]) for k, v in details.items() if _is_plain(k, v)]
        if rest:
            parts.append(folded(f"Settings that {words.method(method)} took", Table(["", ""], rest, (0, 1))))
    return [Markup("<h4>What the methods found besides</h4>"), stack(*parts)] if parts else []


def _terms(details: Details) -> str:
    pairs = zip(details["selected"], details.get("coefficients") or [math.nan] * len(details["selected"]))
    return " + ".join(f"{fmt.number(c, 4)}·{name}" for name, c in pairs) or "none"


def _front(details: Details) -> Table:
    front = zip(details["pareto_length"], details["pareto_error"], details["pareto_expression"])
    lines = [
        Line([str(length), fmt.number(error, 3), text], "best" if i == details.get("pareto_chosen") else "")
        for i, (length, error, text) in enumerate(front)
    ]
    return Table(["length", "relative error", "expression"], lines, (2,))


def _drawn(run: Run, signal: str, model: str, method: str, details: Details) -> Markup | str:
    name = f"{method}-{signal}-{model}"
    if {"generator_eigenvalues_re", "generator_eigenvalues_im"} <= set(details):
        real, imaginary = details["generator_eigenvalues_re"], details["generator_eigenvalues_im"]
        said = f"{signal}: eigenvalues of the generator that {words.method(method)} found."
        return run.drawings.add(f"eigenvalues-{name}", said, lambda: eigenvalues(real, imaginary, model))
    if {"velocity", "force", "law"} <= set(details):
        velocity, learnt, law = (details[k] for k in ("velocity", "force", "law"))
        unit = run.unit(signal).base
        said = f"{signal}: the damping force that the {words.method(method)} learnt, and the law it is projected on."
        return run.drawings.add(f"force-{name}", said, lambda: force(velocity, learnt, law, model, unit))
    return ""


def _is_plain(name: str, value: object) -> bool:
    short = isinstance(value, list) and len(value) <= 3
    return name not in TOLD and (isinstance(value, (str, int, float)) or short)


def _plain(value: object) -> str:
    if isinstance(value, list):
        return fmt.listing(_plain(v) for v in value)
    return fmt.number(value, 4) if isinstance(value, float) else str(value)


PLUGIN = Estimates()
