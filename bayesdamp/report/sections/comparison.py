"""Every estimator beside the others and beside what was published."""

from __future__ import annotations

from bayesdamp.report.figures.errors import categories, ranking
from bayesdamp.report.html import paragraph, stack
from bayesdamp.report.results.comparing import compared
from bayesdamp.report.results.run import Run
from bayesdamp.report.sections._section import Section
from bayesdamp.report.sections.published import errors, times


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
            return paragraph("No estimator has an error to compare in this study.")
        # A study with published figures leads with these two tables.
        parts: list[object] = [] if found.published else [errors(run, found, {})]
        figures = run.drawings
        caption = "Mean error of every method over the signals, at both stages"
        said = caption + (", and the published mean." if found.published else ".")
        parts.append(figures.add("ranking", f"{said} Dashed: 0.1 %.", lambda: ranking(found)))
        said = "Errors by category; each point is one method, the line a category's median. Dashed: 0.1 %."
        parts.append(figures.add("categories", said, lambda: categories(found)))
        parts += [] if found.published else [times(found)]
        return stack(*parts)


PLUGIN = ComparisonSection()
