"""Errors of the estimators along noise, sampling and length, with the Cramér–Rao bound."""

from __future__ import annotations

import math
from functools import partial

from bayesdamp import formatting as fmt
from bayesdamp.report import words
from bayesdamp.report.figures.estimators import sweep
from bayesdamp.report.markup import folded, heading, stack
from bayesdamp.report.results.estimators import STAGES, sort_by_category
from bayesdamp.report.results.run import RunFolder
from bayesdamp.report.results.sweeping import FACTORS, ErrorSeries, interval, series
from bayesdamp.report.sections import Section
from bayesdamp.table import Table, TableLine


class SweepsSection(Section):
    """A figure and two tables for each series."""

    order = 37
    title = "Errors against noise, sampling and length"

    def applies(self, run: RunFolder) -> bool:
        """Return whether at least three signals make a series."""
        return len(run.signals) >= 3 and bool(series(run))

    def render(self, run: RunFolder) -> str:
        """Return the errors along each series."""
        parts: list[object] = []
        for along in series(run):
            model, methods = words.model(along.model), sort_by_category(method for method, _ in along.errors)
            counts = sorted({tried for pairs in along.answers.values() for _, tried in pairs if tried})
            repeats = fmt.listing(map(str, counts), "or") if counts else "no"
            caption = (
                f"{model}: root mean square error over {repeats} repeats; the other two factors are constant. An error "
                "below the bound means that the method is biased, or that it uses more information than the record."
            )
            draw = partial(sweep, along, methods)
            figure = run.drawings.add(f"sweep-{along.model}-{along.factor}", caption, draw)
            tables = [_table(along, methods, stage) for stage in STAGES]
            parts += [heading(f"{model}, {along.factor}"), figure, folded("These numbers", *tables)]
        return stack(*parts)


def _table(along: ErrorSeries, methods: list[str], stage: str) -> Table:
    headers = [words.stage(stage), *(fmt.given(v) for v in along.values)]
    lines = [TableLine(["Cramér–Rao bound", *(fmt.number(b, 2) for b in along.bounds)], "best")]
    for method in methods:
        errors = along.errors.get((method, stage))
        if errors is None:
            continue
        cells = []
        each, answers = along.each[method, stage], along.answers[method, stage]
        for error, own, (answered, tried) in zip(errors, each, answers):
            low, high = interval(own)
            limits = f" ({fmt.number(low, 2)} to {fmt.number(high, 2)})" if math.isfinite(low) else ""
            some = f", {answered} of {tried}" if answered < tried and math.isfinite(error) else ""
            cells.append(fmt.number(error, 2) + limits + some)
        lines.append(TableLine([words.method(method), *cells]))
    caption = (
        f"Root mean square error in per cent of the truth, by {FACTORS[along.factor]}. In brackets: its 95 % interval "
        "from the repeats; then the number of repeats with an answer if it is not all of them."
    )
    return Table(headers, lines, (0,), caption)


PLUGIN = SweepsSection()
