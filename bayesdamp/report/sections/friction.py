"""How sharply friction turns over, where nobody said and the record was asked."""

from __future__ import annotations

import math
from collections.abc import Sequence

from markupsafe import Markup

from bayesdamp import formatting as fmt
from bayesdamp.report import words
from bayesdamp.report.html import fill
from bayesdamp.report.results.run import Run
from bayesdamp.report.sections._layout import by_signal
from bayesdamp.report.sections._section import Section
from bayesdamp.store.contents.records import NoiseContent, WidthTried
from bayesdamp.table import Line, Table
from bayesdamp.types import OK

STAYS = "the usual one stays: no other is clearly ahead"
HARDLY_ANY = "the usual one: the record has hardly any friction, and no other was tried"


class Friction(Section):
    """The evidence of each width ε within which friction was tried to turn over."""

    order = 46
    name = "friction"
    title = "How sharply friction turns over"

    def applies(self, run: Run) -> bool:
        """Where widths of friction were tried."""
        return any(_chosen(run, signal) for signal in run.signals)

    def render(self, run: Run) -> str:
        """A table of the widths for each signal."""
        said = (
            "Friction turns over within a velocity ε, of which a precise record shows something near rest and at each "
            "turning point. Chosen once for each record, under all damping terms together, and taken as known by all "
            "models: their evidence does not pay for the choice, and their intervals are under that ε. How far the "
            "coefficients move with it is seen here, in the fits of all terms together. Estimators take the usual one. "
            "The evidence here is by Laplace's approximation."
        )
        return fill(
            "stack.html", parts=[Markup("<p>{}</p>").format(said), by_signal(run, lambda s: _one(run, s))]
        )


def _chosen(run: Run, signal: str) -> NoiseContent | None:
    """What was chosen, if widths were tried."""
    cell = run.cell("noise", signal, run.repeats(signal)[0])
    chosen = NoiseContent.of(cell) if cell is not None and cell.outcome == OK else None
    return chosen if chosen is not None and chosen.epsilons else None


def _one(run: Run, signal: str) -> Markup:
    chosen = _chosen(run, signal)
    if chosen is None:
        return Markup("<p>ε of this signal was given, or is inferred, or no model has friction.</p>")
    tried, taken = chosen.epsilons, chosen.epsilon or chosen.usual_epsilon
    best = max((t.log_evidence for t in tried if t.outcome == OK), default=math.nan)
    names = list(tried[0].coefficients)
    headers = [
        "share of the peak velocity",
        f"ε / ({chosen.epsilon_unit})",
        "log evidence below the best",
        *(words.symbol(name).text for name in names),
        "",
    ]
    usual = HARDLY_ANY if len(tried) == 1 else STAYS
    why = usual if chosen.epsilon is None else "chosen"
    lines = [_line(t, best, names, why if t.epsilon == taken else "") for t in tried]
    return fill("stack.html", parts=[Table(headers, lines, frozenset({3 + len(names)}))])


def _line(t: WidthTried, best: float, names: Sequence[str], taken: str) -> Line:
    below = fmt.fixed(best - t.log_evidence, 1) if t.outcome == OK else fmt.NONE
    said = t.outcome if t.outcome != OK else taken
    found = [fmt.with_error(*t.coefficients.get(name, (None, None))) for name in names]
    shown = [f"{100 * t.share:g} %", fmt.number(t.epsilon, 3), below, *found, said]
    return Line(shown, "best" if taken else "")


PLUGIN = Friction()
