"""Show the result of each estimator, the comparison of all, and their errors against noise, sampling and length."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import Any

from markupsafe import Markup

from bayesdamp import formatting as fmt
from bayesdamp.formatting import Table
from bayesdamp.report import words
from bayesdamp.report.figures.estimators import (
    LOWEST_ERROR,
    estimate_panels,
    force,
    sweep,
)
from bayesdamp.report.results.estimators import (
    FACTORS,
    STAGES,
    category_of,
    compare_estimators,
    error_series,
    estimates_of,
    printed_error,
    sort_by_category,
    true_models,
)
from bayesdamp.report.results.run import (
    Row,
    RunFolder,
    coefficients,
    models_by_rank,
    rows_of,
    truth,
)
from bayesdamp.report.sections import (
    Section,
    SignalSection,
    by_model,
    heading,
    is_drawn,
    stack,
)
from bayesdamp.store.contents import EstimateContent
from bayesdamp.types import OK

Details = Mapping[str, Any]
"""Further results of an estimator by name, as it stores them."""
PANELS = (
    "Each method's own estimate (open circle) and the result of the trajectory fit that starts there (filled circle); "
    "of several repeats, the first is shown. An arrow with a number: an estimate that is off the axis. Dashed line "
    "(where the true value is known): the true value. Shaded (where there is a posterior): its 95 % interval. An "
    "estimate in this interval agrees with the record within its uncertainty; one far outside has an error of its own."
)
TABLE = (
    "Estimates by method and stage, with the standard error (±) if the method gives one. The error is absolute, in % "
    "of the true value. With several repeats, values and errors are ranges over them; the time and the number of "
    "evaluations of the method's objective are the largest."
)
ERRORS = (
    "Absolute error of the damping coefficients that each method estimates on each signal, in % of the true values "
    "(the root mean square over several coefficients or repeats); the mean of these errors over the signals; and the "
    "published error if the study states it. *: the method reports that this value is unreliable; the tables of the "
    "section on the estimators give the reason."
)
TIMES = (
    "Computing time of each method for all signals of the table of errors together, including the compilation of its "
    "code if that was necessary, and the published time if the study states it."
)
"""Captions, or parts of them, that do not depend on the run."""


class EstimatesSection(SignalSection):
    """The section with tables and figures of estimates.csv. Only the content of the best model is unfolded."""

    order = 40
    name = "estimates"
    title = "The estimators"
    draws_models = True
    lead = Markup(
        "Each estimator first works by itself: its <em>own estimate</em> uses the record alone. A <em>trajectory "
        "fit</em> (output-error fit by least squares) then starts from this estimate. The trajectory fits of all "
        "methods should agree, because the fit has one optimum. The error of a method's own estimate shows how well "
        "the method works on this record."
    )

    def shows(self, run: RunFolder, signal: str) -> bool:
        """Return whether estimators ran on a signal."""
        return any(r["signal"] == signal for r in run.estimates)

    def part(self, run: RunFolder, signal: str) -> Markup:
        """Return a figure and a table for each model with estimates.

        Further results of the methods are shown under the model with which the signal was simulated, or else the most
        probable one.
        """
        repeat = run.repeats(signal)[0]
        ranked = models_by_rank(run, signal, repeat)
        best = true_models(run).get(signal) or ranked[0]
        models: dict[str, list[object]] = {}
        for place, model in enumerate(ranked):
            rows = rows_of(run.estimates, signal=signal, model=model)
            if not rows:
                continue
            models[model] = [_table(run, signal, model, rows)]
            if is_drawn(run, place):
                models[model] = [*_drawn(run, signal, model), *models[model]]
            models[model] += _further_results(run, signal, model) if model == best else []
        return by_model(models)


def _drawn(run: RunFolder, signal: str, model: str) -> list[object]:
    """Return the figure of the estimates for one model; an empty list without two values to compare."""
    compared = [e for e in estimates_of(run, signal, model) if len(e.methods) + bool(e.posterior) > 1]
    if not compared:
        return []
    caption = f"Coefficients of {words.model(model)} damping, estimated from the record {signal}. {PANELS}"
    return [run.drawings.add(f"estimates-{signal}-{model}", caption, partial(estimate_panels, compared))]


def _table(run: RunFolder, signal: str, model: str, rows: Sequence[Row]) -> Table:
    """Return a table of the estimated parameters by each method at each stage, the damping coefficients first.

    A cell is an estimate with its standard error, or the range of the estimates for several repeats.
    """
    estimated = {r["parameter"]: words.unit(r["unit"]) for r in rows if r["parameter"]}
    damping = [name for name in coefficients(run, model) if name in estimated]
    known = {n: truth(run, signal, n) for n in damping}
    several = len({r["repeat"] for r in rows}) > 1

    def value(rows: Sequence[Row], name: str) -> str:
        own = [r for r in rows_of(rows, parameter=name) if math.isfinite(r["value"])]
        if len(own) == 1:
            return fmt.with_error(own[0]["value"], own[0]["stderr"])
        return fmt.spread([r["value"] for r in own]) if own else fmt.NONE

    def error(rows: Sequence[Row], name: str) -> str:
        own = rows_of(rows, parameter=name)
        errors = [abs(r["error_pct"]) for r in own if math.isfinite(r["value"] + r["error_pct"])]
        if len(errors) < 2:
            return fmt.number(errors[0], 3) if errors else fmt.NONE
        return f"{fmt.number(min(errors), 2)} to {fmt.number(max(errors), 2)}"

    def outcome(rows: Sequence[Row]) -> str:
        bad = [r["outcome"] for r in rows if r["outcome"] != OK]
        return f"{len(bad)} × {bad[0]}" if bad and several else next(iter(bad), OK)

    def evaluations(rows: Sequence[Row]) -> str:
        counts = [r["evaluations"] for r in rows if r["evaluations"] is not None]
        return f"{max(counts):,}".replace(",", "\u202f") if counts else fmt.NONE

    columns: dict[str, Callable[[Sequence[Row]], str]] = {
        "estimator": lambda rows: words.method(rows[0]["estimator"]),
        "stage": lambda rows: words.stage(rows[0]["stage"]),
    }
    for name in dict.fromkeys([*damping, *estimated]):
        symbol = words.symbol(name).text
        columns[f"{symbol} / {words.divisor(estimated[name])}"] = partial(value, name=name)
        if math.isfinite(known.get(name, math.nan)) and known[name]:
            header = f"error of {symbol} / %" if len(damping) > 1 else "error / %"
            columns[header] = partial(error, name=name)
    columns |= {
        "evaluations": evaluations,
        "time": lambda rows: fmt.duration(max(r["seconds"] for r in rows)),
        "outcome": outcome,
    }
    truths = [
        f"{words.symbol(n).text} = {fmt.digits(v, n=6)} {estimated[n]}"
        for n, v in known.items()
        if math.isfinite(v)
    ]
    caption = f"Record {signal}, {words.model(model)} damping{': truth ' * bool(truths)}{fmt.listing(truths)}. {TABLE}"

    def kind(rows: Sequence[Row]) -> str:
        return "" if any(math.isfinite(r["value"]) for r in rows) else "quiet"

    keys = dict.fromkeys((r["estimator"], r["stage"]) for r in rows)
    each = [rows_of(rows, estimator=estimator, stage=stage) for estimator, stage in keys]
    return Table.of(each, columns, (0, 1, len(columns) - 1), caption, kind)


def _further_results(run: RunFolder, signal: str, model: str) -> list[object]:
    """Return what some methods compute besides the coefficients: terms, expressions, forces.

    The list is empty if no method stored any.
    """
    by_method: dict[str, Details] = {}
    for task_result in run.task_results("estimate", signal, run.repeats(signal)[0], model):
        for stage in EstimateContent.of(task_result).stages:
            if stage.details:
                by_method[task_result.parts.method] = stage.details
    parts: list[object] = []
    damping = []
    for method, d in by_method.items():
        if "selected" in d:
            pairs = zip(d["selected"], d.get("coefficients") or [math.nan] * len(d["selected"]))
            terms = " + ".join(f"{fmt.number(c, 4)}·{name}" for name, c in pairs) or "none"
            terms = terms.replace("+ −", "− ")
            damping.append([words.method(method), terms])
        elif "chosen" in d:
            damping.append([words.method(method), str(d["chosen"])])
    if damping:
        caption = (
            f"The form of the damping force that each method chose on the record {signal}: the terms of a sparse "
            "regression with their coefficients, or the expression of a symbolic regression in the velocity v."
        )
        parts.append(Table(["method", "damping"], damping, (0, 1), caption))
    for method, details in by_method.items():
        if {"velocity", "force", "law"} <= set(details):
            curves = (details[k] for k in ("velocity", "force", "law"))
            draw = partial(force, *curves, model, run.unit(signal).base)
            caption = (
                f"Damping force against velocity, from the record {signal}: as learnt by the {words.method(method)} "
                f"(solid line), and the {words.model(model)} law that was fitted to it (dashed line). The force is "
                "divided by the mass or the moment of inertia."
            )
            parts.append(run.drawings.add(f"force-{method}-{signal}-{model}", caption, draw))
    return [Markup("<h4>Further results of the methods</h4>"), stack(*parts)] if parts else []


class ComparisonSection(Section):
    """The section with errors and times of all methods under the model with which each record was simulated."""

    order = 35
    name = "comparison"
    title = "Comparison of the estimators"

    def applies(self, run: RunFolder) -> bool:
        """Return whether several methods have errors on several signals, or published errors are given."""
        comparison = compare_estimators(run)
        several = len(comparison.signals) > 1 and len(comparison.methods) > 1
        return comparison.errors.notna().any(axis=None) and (several or comparison.published.size > 0)

    def render(self, run: RunFolder) -> str:
        """Return tables of errors and times."""
        comparison = compare_estimators(run)
        published = comparison.published

        def error_of(method: str, signal: str, stage: str) -> str:
            error = comparison.errors.at[method, (signal, stage)]
            doubted = (method, signal, stage) in comparison.doubted and math.isfinite(error)
            return fmt.number(error, 2) + "*" * doubted

        errors: dict[str, Callable[[str], str]] = {"method": words.method, "category": category_of}
        for signal in comparison.signals:
            for stage in STAGES:
                errors[f"{signal}, {words.stage(stage)}"] = partial(error_of, signal=signal, stage=stage)
            if published.size:
                errors[f"{signal}, published"] = lambda m, s=signal: published.at[m, s] or fmt.NONE
        times: dict[str, Callable[[str], str]] = {"method": words.method}
        for stage in STAGES:
            name, means = words.stage(stage), comparison.at_stage(stage).mean(axis=1)
            errors[f"mean, {name}"] = lambda m, means=means: fmt.number(means[m], 2)
            times[name] = lambda m, stage=stage: fmt.duration(comparison.seconds.at[m, stage])
        if published.size:
            printed = published.map(printed_error).mean(axis=1)
            errors["mean, published"] = lambda m: fmt.number(printed[m], 2)
            times["published"] = lambda m: comparison.times.get(m, fmt.NONE)
        return stack(
            Table.of(comparison.methods, errors, (0, 1), ERRORS),
            Table.of(comparison.methods, times, (0,), TIMES),
        )


class SweepsSection(Section):
    """The section with the errors against noise, sampling and length: a figure for each series."""

    order = 37
    name = "sweeps"
    title = "Errors against noise, sampling and length"

    def applies(self, run: RunFolder) -> bool:
        """Return whether the run has a series of at least three signals."""
        return len(run.signals) >= 3 and bool(error_series(run))

    def render(self, run: RunFolder) -> str:
        """Return a figure of the errors along each series."""
        parts: list[object] = []
        for along in error_series(run):
            model, methods = words.model(along.model), sort_by_category(along.errors.index.unique(0))
            counts = sorted(along.repeats.unique())
            over = f", over {fmt.listing(map(str, counts), 'or')} repeats" if counts else ""
            others = fmt.listing([factor for factor in FACTORS if factor != along.factor])
            caption = (
                f"Root mean square error of the coefficients of {model} damping, in % of the true values{over}, "
                f"against the {along.factor} of simulated records; {others} are constant. Left: the methods' own "
                "estimates; right: the trajectory fits that start there. Dashed: the Cramér–Rao bound, the smallest "
                "standard error of an unbiased estimate. An error below it means that the method is biased, or that "
                "it uses information from outside the record. The legend gives the number of repeats of each method. "
                f"Errors below {fmt.number(LOWEST_ERROR, 2)} % are drawn at this value, and a noise of 0 at the left "
                "edge."
            )
            draw = partial(sweep, along, methods)
            figure = run.drawings.add(f"sweep-{along.model}-{along.factor}", caption, draw)
            parts += [heading(f"{model}: errors against the {along.factor}"), figure]
        return stack(*parts)


PLUGINS = (EstimatesSection(), ComparisonSection(), SweepsSection())
