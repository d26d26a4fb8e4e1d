"""Show the result of each estimator, the comparison of all, and their errors against noise, sampling and length."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import Any

import numpy as np
from markupsafe import Markup

from bayesdamp import formatting as fmt
from bayesdamp.formatting import Table, TableLine
from bayesdamp.report import words
from bayesdamp.report.figures.estimators import (
    LOWEST_ERROR,
    eigenvalues,
    estimate_panels,
    force,
    sweep,
    traces,
)
from bayesdamp.report.results.estimators import (
    FACTORS,
    STAGES,
    CoefficientEstimates,
    ErrorSeries,
    EstimatorComparison,
    category_of,
    compare_estimators,
    error_interval,
    error_series,
    estimates_of,
    posterior_of,
    sort_by_category,
    true_models,
)
from bayesdamp.report.results.run import (
    Row,
    RunFolder,
    coefficients,
    damping_parameters,
    models_by_rank,
    rows_of,
    truth,
)
from bayesdamp.report.sections import (
    Section,
    SignalSection,
    by_model,
    collapsible,
    heading,
    is_drawn,
    paragraph,
    stack,
)
from bayesdamp.store.contents import EstimateContent
from bayesdamp.types import OK

Details = Mapping[str, Any]
"""Further results of an estimator by name, as it stores them."""
TABULATED = {
    "selected", "coefficients", "chosen", "pareto_chosen", "pareto_length", "pareto_error", "pareto_expression",
    "path_threshold", "path_terms", "path_score",
}  # fmt: skip
"""Names of details that have a table of their own, or that are intermediate steps."""
OTHERS = (
    "Estimates of the parameters of the restoring law and of the initial conditions, with the standard error (±) if "
    "the method gives one."
)
TRACES = (
    "The title of each panel names the method, the stage (initial: the method's own estimate; refined: the trajectory "
    "fit that starts there) and the quantity that is drawn: a damping coefficient, or a measure of the misfit or of "
    "the size of the model. The rms of a trajectory fit is its root mean square residual in the unit of the record. "
    "For SINDy and symbolic regression the axis counts models of different sparsity or length instead of iterations."
)
"""Parts of captions that do not depend on the run."""
FIRST = 3
"""Value of `order` that puts the comparison first, in the report of a study with published errors."""


class EstimatesSection(SignalSection):
    """The section with tables and figures of estimates.csv. Only the content of the best model is unfolded."""

    order = 40
    name = "estimates"
    title = "The estimators"
    lead = Markup(
        "Each estimator first works by itself: its <em>own estimate</em> uses the record alone. A <em>trajectory "
        "fit</em> (output-error fit by least squares) then starts from this estimate. The trajectory fits of all "
        "methods should agree, because the fit has one optimum. The error of a method's own estimate shows how well "
        "the method works on this record."
    )
    nothing = "No estimator ran in this study."

    def shows(self, run: RunFolder, signal: str) -> bool:
        """Return whether estimators ran on a signal."""
        return any(r["signal"] == signal for r in run.estimates)

    def part(self, run: RunFolder, signal: str) -> Markup:
        """Return a figure and a table for each model with estimates.

        Further results of the methods are shown under the model with which the signal was simulated, or else the most
        probable one.
        """
        repeats = run.repeats(signal)
        ranked = models_by_rank(run, signal, repeats[0])
        best = true_models(run).get(signal) or ranked[0]
        models: list[tuple[str, list[object]]] = []
        for place, model in enumerate(ranked):
            rows = rows_of(run.estimates, signal=signal, model=model)
            if not rows:
                continue
            content = _figure(run, signal, model) if is_drawn(run, place) else []
            content.append(_table(run, signal, model, rows, repeats))
            others = [r for r in rows if r["repeat"] == repeats[0] and math.isfinite(r["value"])]
            others = [r for r in others if r["parameter"] not in coefficients(run, model)]
            if others:
                columns: dict[str, Callable[[Row], str]] = {
                    "estimator": lambda r: words.method(r["estimator"]),
                    "stage": lambda r: words.stage(r["stage"]),
                    "parameter": lambda r: words.symbol(r["parameter"]).text,
                    "value": lambda r: fmt.with_error(r["value"], r["stderr"]),
                    "unit": lambda r: words.unit(r["unit"]),
                }
                content.append(
                    collapsible("The other parameters", Table.of(others, columns, (0, 1, 2, 4), OTHERS))
                )
            curves = {
                f"{words.method(task_result.parts.method)}: {name.replace('_', ' ').replace('/', ' ')}": curve
                for task_result in (
                    run.task_results("estimate", signal, repeats[0], model) if is_drawn(run, place) else ()
                )
                for name, curve in task_result.arrays.items()
                if curve.ndim == 1 and curve.size >= 3 and np.issubdtype(curve.dtype, np.number)
            }
            if curves:
                caption = (
                    f"Progress of the iterative methods on the record {signal} under {words.model(model)} damping. "
                    f"{TRACES}"
                )
                draw = partial(traces, curves)
                figure = run.drawings.add(f"traces-{signal}-{model}", caption, draw)
                content.append(collapsible("How the iterative methods converged", figure))
            content += _further_results(run, signal, model) if model == best else []
            models.append((model, content))
        return by_model(models, "Under ")


def _figure(run: RunFolder, signal: str, model: str) -> list[object]:
    """Return the figure of the estimates against the posterior, and a sentence on how many are in its interval.

    The list is empty if no coefficient has estimates by two methods, or an estimate and a posterior.
    """
    estimates = [
        e for e in estimates_of(run, signal, model) if len(e.methods) > 1 or (e.methods and e.posterior)
    ]
    if not estimates:
        return []
    repeats = len(run.repeats(signal))
    caption = [
        f"Coefficients of {words.model(model)} damping, estimated from the record {signal}"
        f"{f' (repeat 1 of {repeats})' if repeats > 1 else ''}: each method's own estimate (open circle) and the "
        "result of the trajectory fit that starts there (filled circle)."
    ]
    if any(math.isfinite(e.truth) for e in estimates):
        caption.append("Dashed line: the true value.")
    if any(e.posterior for e in estimates):
        caption.append(
            "Shaded: the 95 % interval of the posterior. An estimate inside it is as good as the record allows. "
            "Outside it, the error is due to the method."
        )
    if any(e.posterior and e.source != signal for e in estimates):
        caption.append(
            f"A record without noise has no posterior, so the posterior of {estimates[0].source} is drawn."
        )
    if any(e.published for e in estimates):
        caption.append(
            "Ticks: the published error, on both sides of the true value because its sign was not published."
        )
    if any(math.isfinite(value) for e in estimates for value in e.own.values()):
        caption.append("An arrow with a number stands for an estimate that is off the axis.")
    draw = partial(estimate_panels, estimates)
    picture = run.drawings.add(f"estimates-{signal}-{model}", " ".join(caption), draw)
    sentence = coverage_sentence(estimates)
    return [picture, sentence and paragraph(sentence)]


def coverage_sentence(estimates: Sequence[CoefficientEstimates]) -> str:
    """Return a sentence on how many estimates are in the 95 % interval of their own record's posterior.

    Empty if no estimate has such a posterior.
    """
    counts = []
    for name, stage in (("own estimates", "own"), ("trajectory fits", "refined")):
        values = [
            e.posterior[0] <= value <= e.posterior[1]
            for e in estimates
            if e.posterior is not None and e.source == e.signal
            for value in getattr(e, stage).values()
        ]
        counts += [f"{sum(values)} of {len(values)} {name}"] if values else []
    return f"{fmt.listing(counts)} are in the posterior's 95 % interval." if counts else ""


def _table(run: RunFolder, signal: str, model: str, rows: Sequence[Row], repeats: Sequence[int]) -> Table:
    """Return a table of the damping coefficients by each estimator at each stage."""
    names = [n for n in coefficients(run, model) if any(r["parameter"] == n for r in rows)]
    known = {n: truth(run, signal, n) for n in names}
    units = {r["parameter"]: words.unit(r["unit"]) for r in rows}

    def value(rows: Sequence[Row], name: str) -> str:
        own = [r for r in rows_of(rows, parameter=name) if math.isfinite(r["value"])]
        if len(own) == 1:
            return fmt.with_error(own[0]["value"], own[0]["stderr"])
        return fmt.spread([r["value"] for r in own]) if own else fmt.NONE

    def error(rows: Sequence[Row], name: str) -> str:
        own = [r for r in rows_of(rows, parameter=name) if math.isfinite(r["value"])]
        errors = [abs(r["error_pct"]) for r in own if math.isfinite(r["error_pct"])]
        if len(errors) < 2:
            return fmt.number(errors[0], 3) if errors else fmt.NONE
        return f"{fmt.number(min(errors), 2)} to {fmt.number(max(errors), 2)}"

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
        columns[f"{symbol} / ({units.get(name, '')})"] = partial(value, name=name)
        if known[name] and math.isfinite(known[name]):
            header = f"error of {symbol} / %" if len(names) > 1 else "error / %"
            columns[header] = partial(error, name=name)
    columns |= {
        "evaluations": evaluations,
        "time": lambda rows: fmt.duration(max(r["seconds"] for r in rows)),
        "outcome": outcome,
    }
    truths = fmt.listing(
        f"{words.symbol(n).text} = {fmt.as_entered(v)} {units.get(n, '')}"
        for n, v in known.items()
        if math.isfinite(v)
    )
    caption = (
        f"Coefficients of {words.model(model)} damping from the record {signal}, by method and stage, with the "
        "standard error (±) if the method gives one. Evaluations: number of times that the method evaluated its "
        "objective."
    )
    if truths:
        caption += f" Truth: {truths}. Errors are absolute, in % of it."
    if len(repeats) > 1:
        caption += (
            f" Values and errors are ranges over {len(repeats)} repeats; the number of evaluations and the time are "
            "the largest."
        )

    def kind(rows: Sequence[Row]) -> str:
        return "" if any(math.isfinite(r["value"]) for r in rows) else "quiet"

    keys = dict.fromkeys((r["estimator"], r["stage"]) for r in rows)
    each = [rows_of(rows, estimator=estimator, stage=stage) for estimator, stage in keys]
    return Table.of(each, columns, (0, 1, len(columns) - 1), caption, kind)


def _further_results(run: RunFolder, signal: str, model: str) -> list[object]:
    """Return what some methods compute besides the coefficients: terms, expressions, eigenvalues, forces, settings.

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
            damping.append([words.method(method), terms])
    damping += [[words.method(m), str(d["chosen"])] for m, d in by_method.items() if "chosen" in d]
    if damping:
        caption = (
            f"The form of the damping force that each method chose on the record {signal}: the terms of a sparse "
            "regression with their coefficients, or the expression of a symbolic regression in the velocity v."
        )
        parts.append(Table(["method", "damping"], damping, (0, 1), caption))
    for method, details in by_method.items():
        if "pareto_expression" in details:
            front = zip(details["pareto_length"], details["pareto_error"], details["pareto_expression"])
            chosen = details.get("pareto_chosen")
            lines = [
                TableLine([str(length), fmt.number(error, 3), text], "best" if i == chosen else "")
                for i, (length, error, text) in enumerate(front)
            ]
            caption = (
                "The expressions for the damping force that have the smallest error for their length (number of nodes "
                "in the expression tree). v: velocity. Bold: the chosen expression."
            )
            table = Table(["length", "relative error", "expression"], lines, (2,), caption)
            parts.append(collapsible(f"The Pareto front of {words.method(method)}", table))
        name, by = f"{method}-{signal}-{model}", words.method(method)
        if {"generator_eigenvalues_re", "generator_eigenvalues_im"} <= set(details):
            real, imaginary = details["generator_eigenvalues_re"], details["generator_eigenvalues_im"]
            draw = partial(eigenvalues, real, imaginary, model)
            caption = (
                f"Eigenvalues of the linear generator that {by} identified from the record {signal}. Real part: rate "
                "of growth, negative for a decay. Imaginary part: angular frequency."
            )
            parts.append(run.drawings.add(f"eigenvalues-{name}", caption, draw))
        elif {"velocity", "force", "law"} <= set(details):
            curves = (details[k] for k in ("velocity", "force", "law"))
            draw = partial(force, *curves, model, run.unit(signal).base)
            caption = (
                f"Damping force against velocity, from the record {signal}: as learnt by the {by} (solid line), and "
                f"the {words.model(model)} law that was fitted to it (dashed line). The force is divided by the mass "
                "or the moment of inertia."
            )
            parts.append(run.drawings.add(f"force-{name}", caption, draw))
        rest = [
            [name.replace("_", " "), _plain(value)]
            for name, value in details.items()
            if name not in TABULATED
            and (isinstance(value, (str, int, float)) or (isinstance(value, list) and len(value) <= 3))
        ]
        if rest:
            parts.append(
                collapsible(
                    f"Settings and further results: {words.method(method)}",
                    Table(["quantity", "value"], rest, (0, 1)),
                )
            )
    return [Markup("<h4>Further results of the methods</h4>"), stack(*parts)] if parts else []


def _plain(value: object) -> str:
    """Return a setting as text: a number, a word, or a list of these."""
    if isinstance(value, list):
        return fmt.listing(map(_plain, value))
    return fmt.number(value, 4) if isinstance(value, float) else str(value)


class ComparisonSection(Section):
    """The section with errors and times of all methods under the model with which each record was simulated."""

    order = 35
    name = "comparison"
    title = "Comparison of the estimators"

    def place(self, run: RunFolder) -> int:
        """Return the number by which the section is sorted: it comes first in a study with published errors."""
        return FIRST if run.study.get("published") else self.order

    def applies(self, run: RunFolder) -> bool:
        """Return whether several methods have errors on several signals, or the study contains published errors."""
        comparison = compare_estimators(run)
        several = len(comparison.methods) > 1 and len(comparison.signals) > 1 and bool(comparison.errors)
        return several or bool(run.study.get("published"))

    def render(self, run: RunFolder) -> str:
        """Return sentences on the largest errors, and tables of errors and times."""
        comparison = compare_estimators(run)
        if not comparison.errors:
            return paragraph("No estimator has an error to compare in this study.")
        own, refined = (
            {key: e for key, e in comparison.errors.items() if key[2] == stage} for stage in STAGES
        )
        sentences = []
        if refined:
            sentences.append(
                f"After the trajectory fit every method is within {fmt.short(max(refined.values()))} % of the truth, "
                "because this fit has one optimum, which does not depend on the starting point. The methods differ in "
                "their own estimates."
            )
        if own:
            worst = max(own, key=lambda key: own[key])
            size = f"{fmt.short(own[worst])} % ({words.method(worst[0])}, {worst[1]})"
            sentences.append(f"Before the trajectory fit, the largest error is {size}.")
        columns: dict[str, Callable[[str], str]] = {
            "method": words.method,
            "own estimate": lambda m: fmt.duration(comparison.seconds.get((m, "initial"))),
            "trajectory fit": lambda m: fmt.duration(comparison.seconds.get((m, "refined"))),
        }
        if comparison.times:
            columns["published"] = lambda m: comparison.times.get(m, fmt.NONE)
        count = len(comparison.signals)
        signals = f"{count} signals" if count > 1 else "the signal"
        caption = (
            f"Computing time of each method for {signals} together: for its own estimate and for the trajectory fit, "
            "including compilation if it was necessary"
        )
        caption += ", and the published time." if comparison.times else "."
        times = Table.of(comparison.methods, columns, (0,), caption)
        return stack(paragraph(" ".join(sentences)), _errors(run, comparison), times)


def _errors(run: RunFolder, comparison: EstimatorComparison) -> Table:
    """Return a table of errors by method and signal.

    If the study contains published errors, the table also has these, and the intervals of the posteriors.
    """
    published = bool(comparison.published)
    headers = ["own", "fit", *["published"] * published]
    groups = [(name, len(headers)) for name in (*comparison.signals, "mean")]
    lines = []
    for method in comparison.methods:
        cells = [words.method(method), category_of(method)]
        for signal in comparison.signals:
            for stage in STAGES:
                error = comparison.errors.get((method, signal, stage), math.nan)
                outcome = comparison.outcomes.get((method, signal, stage), OK)
                cells.append(fmt.short(error) + "*" * (outcome != OK and math.isfinite(error)))
            if published:
                cells.append(comparison.published.get((method, signal), fmt.NONE))
        cells += [fmt.short(comparison.mean(method, stage)) for stage in STAGES]
        cells += [fmt.short(comparison.mean_published(method))] * published
        lines.append(TableLine(cells))
    caption = (
        "Error of the damping coefficients on each signal, in % of the true values (absolute; over several values, the "
        "root mean square): the method's own estimate (own), then the trajectory fit that starts there (fit)"
    )
    caption += ", then the published error." if published else "."
    caption += " Last columns: the mean over the signals."
    posteriors: list[Row] = []
    differences: list[tuple[str, int]] = []
    for signal in comparison.signals if published else ():
        model = true_models(run)[signal]
        parameter = damping_parameters(run).get(model)
        row = posterior_of(run, signal, model, parameter) if parameter else None
        true = truth(run, signal, row["parameter"]) if row else math.nan
        limits = fmt.NONE
        if row and math.isfinite(true) and true:
            percent = (f"{100 * (row[q] / true - 1):+.2f}" for q in ("q2.5", "q97.5"))
            limits = " to ".join(percent).replace("-", "−")
        posteriors += [row] if row else []
        differences.append((limits, len(headers)))
    foot: list[tuple[str, int]] = []
    if posteriors:
        foot = [("posterior, 95 %", 2), *differences, ("", len(headers))]
        caption += (
            " Last line: where the 95 % interval of the posterior begins and ends, relative to the true value, for a "
            "record with noise."
        )
    if any(o != OK for o in comparison.outcomes.values()):
        caption += (
            " *: the method reports that this value is unreliable; the tables of the section on the estimators give "
            "the reason."
        )
    values = [
        f"{words.symbol(row['parameter']).text} {row['q2.5']:.5g} to {row['q97.5']:.5g} {row['unit']} ({row['signal']})"
        for row in posteriors
    ]
    return Table(
        ["method", "category", *headers * len(groups)],
        lines,
        {0, 1},
        caption,
        [("", 2), *groups],
        foot,
        [f"95 % intervals of the posteriors: {'; '.join(values)}."] if values else [],
    )


class SweepsSection(Section):
    """The section with the errors against noise, sampling and length: a figure and two tables for each series."""

    order = 37
    name = "sweeps"
    title = "Errors against noise, sampling and length"

    def applies(self, run: RunFolder) -> bool:
        """Return whether the run has a series of at least three signals."""
        return len(run.signals) >= 3 and bool(error_series(run))

    def render(self, run: RunFolder) -> str:
        """Return a figure and tables of the errors along each series."""
        parts: list[object] = []
        for along in error_series(run):
            model, methods = words.model(along.model), sort_by_category(method for method, _ in along.errors)
            counts = sorted({tried for pairs in along.answers.values() for _, tried in pairs if tried})
            over = f", over {fmt.listing(map(str, counts), 'or')} repeats" if counts else ""
            others = fmt.listing([factor for factor in FACTORS if factor != along.factor])
            caption = (
                f"Root mean square error of the coefficients of {model} damping, in % of the true values{over}, "
                f"against the {along.factor} of simulated records; {others} are constant. Left: the methods' own "
                "estimates; right: the trajectory fits that start there. Dashed: the Cramér–Rao bound, the smallest "
                "standard error of an unbiased estimate. An error below it means that the method is biased, or that "
                "it uses information from outside the record. The legend gives the number of repeats of each method. "
                f"Errors below {fmt.short(LOWEST_ERROR)} % are drawn at this value, and a noise of 0 at the left edge."
            )
            draw = partial(sweep, along, methods)
            figure = run.drawings.add(f"sweep-{along.model}-{along.factor}", caption, draw)
            tables = [_error_table(along, methods, stage) for stage in STAGES]
            parts += [
                heading(f"{model}: errors against the {along.factor}"),
                figure,
                collapsible("The numbers of this figure", *tables),
            ]
        return stack(*parts)


def _error_table(along: ErrorSeries, methods: list[str], stage: str) -> Table:
    """Return a table of the errors of one stage by method, at each value of the factor, with the Cramér–Rao bound."""
    headers = [words.stage(stage), *(fmt.as_entered(v) for v in along.values)]
    lines = [TableLine(["Cramér–Rao bound", *(fmt.number(b, 2) for b in along.bounds)], "best")]
    for method in methods:
        errors = along.errors.get((method, stage))
        if errors is None:
            continue
        cells = []
        each, answers = along.each[method, stage], along.answers[method, stage]
        for error, own, (answered, tried) in zip(errors, each, answers):
            low, high = error_interval(own)
            limits = f" ({fmt.number(low, 2)} to {fmt.number(high, 2)})" if math.isfinite(low) else ""
            some = f", {answered} of {tried}" if answered < tried and math.isfinite(error) else ""
            cells.append(fmt.number(error, 2) + limits + some)
        lines.append(TableLine([words.method(method), *cells]))
    caption = (
        f"Root mean square error of the coefficients of {words.model(along.model)} damping, in % of the true values. "
        f"Each column is a value of: {FACTORS[along.factor]}. In brackets: the 95 % interval of the error, from the "
        'repeats. "3 of 5" after it means that only 3 of 5 repeats gave an estimate.'
    )
    return Table(headers, lines, (0,), caption)


PLUGINS = (EstimatesSection(), ComparisonSection(), SweepsSection())
