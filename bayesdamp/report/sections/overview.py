"""Many records at a glance: what they say together, a picture of their damping curves, a table to sort."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from markupsafe import Markup

from bayesdamp.report.figures.curves import overview
from bayesdamp.report.html import paragraph, stack
from bayesdamp.report.results.answers import Answer, answers, specimens
from bayesdamp.report.results.overview import curve_of, overview_table, short_names
from bayesdamp.report.results.run import Run
from bayesdamp.report.sections._layout import Section
from bayesdamp.verdict.types import Verdict
from bayesdamp.verdict.words import energy_of

FEWEST = 3
"""Records from which an overview stands before them."""
SORTS = "A line a record; a click on a header sorts. Damping ratio: equivalent viscous."


class Overview(Section):
    """The specimens' verdicts, their damping curves, and a line a record with a link to it."""

    order = 4
    title = "All records"

    def applies(self, run: Run) -> bool:
        """Where many records have an answer, or several are of one specimen."""
        many = len(answers(run)) >= FEWEST or bool(specimens(run))
        return many and not run.study.get("published")

    def render(self, run: Run) -> str:
        """Show specimens, a picture of all damping curves, and a line a record."""
        found = answers(run)
        together = specimens(run)
        cards = [_together(v, v.record if len(together) > 1 else "") for v in together]
        return stack(*cards, _picture(run, found), replace(overview_table(found), caption=SORTS))


def _together(v: Verdict, name: str) -> Markup:
    head = Markup("<h3>{}</h3>").format(name) if name else ""
    more = Markup("").join(map(paragraph, (*energy_of(v), *v.remarks)))
    return Markup('<div class="verdict">{}<p class="claim">{}</p>{}</div>').format(head, v.sentence, more)


def _picture(run: Run, found: Sequence[Answer]) -> Markup:
    """Draw each record's damping ratio against amplitude on the same axes."""
    shown = {a.signal: curve for a in found if (curve := curve_of(a)) is not None}
    if not shown:
        return Markup("")
    names = short_names(list(shown))
    unit = next(a.verdict.damping_ratio[0].unit for a in found if a.signal in shown)
    caption = (
        "Damping ratio of each record against amplitude, with its 95 % band. Level: viscous; falling to the right: "
        "friction; rising: drag."
    )
    curves = {names[signal]: curve for signal, curve in shown.items()}
    return run.drawings.add("overview", caption, lambda: overview(curves, unit))


PLUGIN = Overview()
