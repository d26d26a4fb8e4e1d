"""Overview of many records: the specimens' verdicts, a figure of their damping curves, and a table to sort."""

from __future__ import annotations

from dataclasses import replace
from functools import partial

from markupsafe import Markup

from bayesdamp.report.figures.curves import overview
from bayesdamp.report.markup import heading, paragraph, stack
from bayesdamp.report.results.answers import answers, curve_of, overview_table, short_names, specimens
from bayesdamp.report.results.run import RunFolder
from bayesdamp.report.sections import Section
from bayesdamp.verdict.words import energy_of

FEWEST = 3
"""Number of records from which the report has an overview."""
SORTS = (
    "One line for each record; click on a header to sort. The damping ratio is the equivalent viscous one."
)


class OverviewSection(Section):
    """The specimens' verdicts, the damping curves, and a line for each record with a link to it."""

    order = 4
    title = "All records"

    def applies(self, run: RunFolder) -> bool:
        """Return whether many records have an answer, or several are of one specimen."""
        several = len(answers(run)) >= FEWEST or bool(specimens(run))
        return several and not run.study.get("published")

    def render(self, run: RunFolder) -> str:
        """Return the verdicts of specimens, a figure of all damping curves, and a line for each record."""
        records, verdicts = answers(run), specimens(run)
        parts: list[object] = []
        for v in verdicts:
            title = heading(v.record) if len(verdicts) > 1 else ""
            more = Markup("").join(map(paragraph, (*energy_of(v), *v.remarks)))
            block = Markup('<div class="verdict">{}<p class="claim">{}</p>{}</div>')
            parts.append(block.format(title, v.sentence, more))
        curves = {a.signal: curve for a in records if (curve := curve_of(a)) is not None}
        if curves:
            names = short_names(list(curves))
            unit = next(a.verdict.damping_ratio[0].unit for a in records if a.signal in curves)
            caption = (
                "Damping ratio of each record against amplitude, with its 95 % band. Level: viscous damping; falling "
                "towards large amplitudes: friction; rising: drag."
            )
            draw = partial(overview, {names[signal]: curve for signal, curve in curves.items()}, unit)
            parts.append(run.drawings.add("overview", caption, draw))
        return stack(*parts, replace(overview_table(records), caption=SORTS))


PLUGIN = OverviewSection()
