"""Every estimator beside the others and beside what was published."""

from __future__ import annotations

import math

from markupsafe import Markup

from bayesdamp import formatting as fmt
from bayesdamp.report import words
from bayesdamp.report.figures.errors import categories, ranking
from bayesdamp.report.html import fill
from bayesdamp.report.results.comparing import STAGES, Comparison, compared
from bayesdamp.report.results.run import Run
from bayesdamp.report.sections._section import Section
from bayesdamp.report.sections.published import times
from bayesdamp.table import Line, Table
from bayesdamp.types import OK


class ComparisonSection(Section):
    """Errors and times of all methods under the model that made each record."""

    order = 35
    name = "comparison"
    title = "The estimators compared"

    def applies(self, run: Run) -> bool:
        """Where several methods have an error, or the study's numbers are published."""
        if run.study.get("published"):
            return True
        found = compared(run)
        return len(found.methods) > 1 and len(found.signals) > 1 and bool(found.errors)

    def render(self, run: Run) -> str:
        """Ranks, errors and times, as figures and tables."""
        found = compared(run)
        if not found.errors:
            return Markup("<p>No estimator has an error to compare in this study.</p>")
        # A study with published figures leads with these two tables.
        parts: list[object] = [] if found.published else [_errors(found)]
        figures = run.drawings
        caption = "Mean error of every method over the signals, at both stages"
        said = caption + (", and the published mean." if found.published else ".")
        parts.append(figures.add("ranking", f"{said} Dashed: 0.1 %.", lambda: ranking(found)))
        said = "Errors by category; each point is one method, the line a category's median. Dashed: 0.1 %."
        parts.append(figures.add("categories", said, lambda: categories(found)))
        parts += [] if found.published else [times(found)]
        return fill("stack.html", parts=parts)


def _errors(found: Comparison) -> Table:
    headers = ["method"]
    for signal in found.signals:
        headers += [signal, "fit"]
    lines = []
    for method in found.methods:
        cells = [words.method(method)]
        for signal in found.signals:
            for stage in STAGES:
                error = found.errors.get((method, signal, stage), math.nan)
                outcome = found.outcomes.get((method, signal, stage), OK)
                cells.append(fmt.short(error) + ("*" if outcome != OK and math.isfinite(error) else ""))
        lines.append(Line(cells))
    starred = any(o != OK for o in found.outcomes.values())
    note = (
        " *: the method itself doubts this answer; its sentence stands in the next section."
        if starred
        else ""
    )
    said = (
        "Errors in per cent of the truth: the method's own estimate under the signal's name, then the trajectory "
        "fit that starts there."
    )
    return Table(headers, lines, frozenset({0}), said + note)


PLUGIN = ComparisonSection()
