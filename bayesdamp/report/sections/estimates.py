"""Show the result of each estimator."""

import math
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import Any

from markupsafe import Markup

from bayesdamp import formatting as fmt
from bayesdamp.report import words
from bayesdamp.report.figures.estimators import estimate_panels, force
from bayesdamp.report.results.estimators import estimates_of, true_models
from bayesdamp.report.results.run import Row, RunFolder, coefficients, models_by_rank, rows_of, truth
from bayesdamp.report.sections import SignalSection, by_model, is_drawn, stack
from bayesdamp.store.results import EstimateContent
from bayesdamp.types import OK, candidate_parts

Details = Mapping[str, Any]
"""Results of an estimator besides parameter values, by name: selected terms, an expression, or a force."""
PANELS = (
    "Open circle: each method's own estimate. Filled circle: the trajectory fit that starts at this estimate. If "
    "the record was simulated several times with different random numbers (repeats), the first repeat is shown. An "
    "arrow with a number: an estimate that is off the axis. Dashed line (where the true value is known): the true "
    "value. Shaded (where there is a posterior): its 95 % interval."
)
TABLE = (
    "Estimates by method and stage, with the standard error (±) if the method gives one. The error is without "
    "its sign, in % of the true value. If the record was simulated several times with different random numbers "
    "(repeats), values and errors are ranges over the repeats, and the time and the number of evaluations of the "
    "method's objective are the largest of all repeats."
)
"""Parts of the captions of figures (`PANELS`) and tables (`TABLE`) that are the same for every run."""


class EstimatesSection(SignalSection):
    """The section with tables and figures of the estimates. Only the first model is visible without a click."""

    order = 40
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

        Further results of the methods are shown under the most probable model: for a simulated signal, among the models
        with the true damping if there are any.
        """
        ranked = models_by_rank(run, signal, run.repeats(signal)[0])
        true = true_models(run).get(signal)
        best = next((model for model in ranked if candidate_parts(model)[0] == true), ranked[0])
        models: dict[str, list[object]] = {}
        for place, model in enumerate(ranked):
            rows = rows_of(run.estimates, signal=signal, model=model)
            if not rows:
                continue
            content = models[model] = list[object]()
            compared = [e for e in estimates_of(run, signal, model) if len(e.methods) + bool(e.posterior) > 1]
            if compared and is_drawn(run, place):
                caption = f"Estimates of {words.model(model)} damping from the record “{signal}”. {PANELS}"
                draw = partial(estimate_panels, compared)
                content.append(run.drawings.add(f"estimates-{signal}-{model}", caption, draw))
            content.append(_table(run, signal, model, rows))
            if model == best:
                content += _further_results(run, signal, model)
        return by_model(models)


def _table(run: RunFolder, signal: str, model: str, rows: Sequence[Row]) -> fmt.Table:
    """Return a table of the estimated parameters, with a row for each method and stage.

    The cell of a parameter is an estimate with its standard error, or the range of the estimates for several repeats.
    The damping coefficients come first; errors, time and outcome follow.
    """
    estimated = {r["parameter"]: words.unit(r["unit"]) for r in rows if r["parameter"]}
    damping = [name for name in coefficients(run, model) if name in estimated]
    known = {n: true for n in damping if math.isfinite(true := truth(run, signal, n))}
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
        if known.get(name):
            header = f"error of {symbol} / %" if len(damping) > 1 else "error / %"
            columns[header] = partial(error, name=name)
    columns |= {
        "evaluations": evaluations,
        "time": lambda rows: fmt.duration(max(r["seconds"] for r in rows)),
        "outcome": outcome,
    }
    truths = [f"{words.symbol(n).text} = {fmt.digits(v, n=6)} {estimated[n]}" for n, v in known.items()]
    record = f"Record “{signal}”, {words.model(model)} damping"
    caption = f"{record}{': truth ' * bool(truths)}{fmt.listing(truths)}. {TABLE}"

    def kind(rows: Sequence[Row]) -> str:
        return "" if any(math.isfinite(r["value"]) for r in rows) else "quiet"

    keys = dict.fromkeys((r["estimator"], r["stage"]) for r in rows)
    each = [rows_of(rows, estimator=estimator, stage=stage) for estimator, stage in keys]
    return fmt.Table.of(each, columns, (0, 1, len(columns) - 1), caption, kind)


def _further_results(run: RunFolder, signal: str, model: str) -> list[object]:
    """Return a table and figures of what some methods compute besides coefficients: terms, expressions, forces.

    The list is empty if no method stored such results.
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
            terms = " + ".join(f"{fmt.number(c, 4)}·{name}" for name, c in pairs).replace("+ −", "− ")
            damping.append([words.method(method), terms or "none"])
        elif "chosen" in d:
            damping.append([words.method(method), str(d["chosen"])])
    if damping:
        caption = (
            f"The form of the damping force that each method chose on the record “{signal}”: the terms of a sparse "
            "regression with their coefficients, or the expression of a symbolic regression in the velocity v."
        )
        parts.append(fmt.Table(["method", "damping"], damping, (0, 1), caption))
    for method, details in by_method.items():
        if {"velocity", "force", "law"} <= set(details):
            curves = (details[k] for k in ("velocity", "force", "law"))
            draw = partial(force, *curves, model, run.unit(signal).base)
            caption = (
                f"Damping force / (mass or moment of inertia) against velocity, record “{signal}”. Solid: learnt by "
                f"the {words.method(method)}. Dashed: the {words.model(model)} law, fitted to the mean power that "
                "the learnt force dissipates in each segment of the record. Dry friction, if the law contains any, is "
                "smoothed as tanh(v/ε)."
            )
            parts.append(run.drawings.add(f"force-{method}-{signal}-{model}", caption, draw))
    return [Markup("<h4>Further results of the methods</h4>"), stack(*parts)] if parts else []


PLUGIN = EstimatesSection()
