"""Comparison of the estimators with each other and with published figures."""

from __future__ import annotations

import math
from collections.abc import Callable

from bayesdamp import formatting as fmt
from bayesdamp.report import words
from bayesdamp.report.markup import paragraph, stack
from bayesdamp.report.results.estimators import (
    STAGES,
    EstimatorComparison,
    category_of,
    compare_estimators,
    posterior_of,
    true_models,
)
from bayesdamp.report.results.reading import damping_parameters, truth
from bayesdamp.report.results.run import Row, RunFolder
from bayesdamp.report.sections import Section
from bayesdamp.table import Table, TableLine
from bayesdamp.types import OK

OWN, REFINED = STAGES
FIRST = 3
"""Order of the section in the report of a study with published figures, which was made for this comparison."""


class ComparisonSection(Section):
    """Errors and times of all methods under the model with which each record was simulated."""

    order = 35
    title = "Comparison of the estimators"

    def place(self, run: RunFolder) -> int:
        """Return the first place if the study contains published figures."""
        return FIRST if run.study.get("published") else self.order

    def applies(self, run: RunFolder) -> bool:
        """Return whether several methods have an error, or the study contains published figures."""
        comparison = compare_estimators(run)
        several = len(comparison.methods) > 1 and len(comparison.signals) > 1 and bool(comparison.errors)
        return several or bool(run.study.get("published"))

    def render(self, run: RunFolder) -> str:
        """Return tables of errors and times."""
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
            sentences.append(f"The largest error of the own estimates is {size}.")
        return stack(paragraph(" ".join(sentences)), _errors(run, comparison), _times(comparison))


def _errors(run: RunFolder, comparison: EstimatorComparison) -> Table:
    """Return errors in per cent by method and signal, with the published ones and the posteriors' intervals."""
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
    caption = "Errors in per cent of the truth: the method's own estimate, then the trajectory fit that starts there"
    caption += ", then the published error." if published else "."
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
            " Last line: the difference of the posterior's 95 % interval from the truth, in per cent, for a record "
            "with noise."
        )
    if any(o != OK for o in comparison.outcomes.values()):
        caption += (
            " *: the method reports that this answer is unreliable, for the reason in the estimators' tables."
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


def _times(comparison: EstimatorComparison) -> Table:
    """Return the computing time of each method."""
    columns: dict[str, Callable[[str], str]] = {
        "method": words.method,
        "own estimate": lambda m: fmt.duration(comparison.seconds.get((m, OWN))),
        "trajectory fit": lambda m: fmt.duration(comparison.seconds.get((m, REFINED))),
    }
    if comparison.times:
        columns["published"] = lambda m: comparison.times.get(m, fmt.NONE)
    count = len(comparison.signals)
    signals = f"{count} signals" if count > 1 else "the signal"
    caption = f"Time for {signals} together, including compilation if it was necessary."
    return Table.of(comparison.methods, columns, (0,), caption)


PLUGIN = ComparisonSection()
