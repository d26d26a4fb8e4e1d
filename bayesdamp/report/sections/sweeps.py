"""Errors along noise, sampling and length, one factor at a time, beside what no method can beat."""

from __future__ import annotations

import math

from markupsafe import Markup

from bayesdamp import formatting as fmt
from bayesdamp.report import words
from bayesdamp.report.figures.errors import sweep
from bayesdamp.report.html import folded, stack
from bayesdamp.report.results.comparing import STAGES, in_order
from bayesdamp.report.results.places import interval
from bayesdamp.report.results.run import Run
from bayesdamp.report.results.sweeping import FACTORS, Series, series
from bayesdamp.report.sections._layout import Section
from bayesdamp.table import Line, Table


class Sweeps(Section):
    """One figure and two tables a series."""

    order = 37
    title = "Errors against noise, sampling and length"

    def applies(self, run: Run) -> bool:
        """Where three signals and more make a series."""
        return len(run.signals) >= 3 and bool(series(run))

    def render(self, run: Run) -> str:
        """Errors along each series."""
        parts: list[object] = []
        for found in series(run):
            methods = in_order(method for method, _ in found.errors)
            counts = sorted({tried for pairs in found.answers.values() for _, tried in pairs if tried})
            repeats = fmt.listing(map(str, counts), "or") if counts else "no"
            caption = (
                f"{words.model(found.model)}: root mean square error over {repeats} repeats, the other two factors "
                "held. Below the bound only a biased method or one that uses more than the record can be."
            )
            name = f"sweep-{found.model}-{found.factor}"
            parts.append(Markup("<h3>{}, {}</h3>").format(words.model(found.model), found.factor))
            parts.append(run.drawings.add(name, caption, lambda f=found, m=methods: sweep(f, m)))
            parts.append(folded("These numbers", *(_table(found, methods, stage) for stage in STAGES)))
        return stack(*parts)


def _table(found: Series, methods: list[str], stage: str) -> Table:
    headers = [words.stage(stage), *(fmt.given(v) for v in found.values)]
    lines = [Line(["Cramér–Rao bound", *(fmt.number(b, 2) for b in found.bounds)], "best")]
    for method in methods:
        errors = found.errors.get((method, stage))
        if errors is None:
            continue
        cells = []
        each = found.each[method, stage]
        for error, own, (had, tried) in zip(errors, each, found.answers[method, stage]):
            low, high = interval(own)
            luck = f" ({fmt.number(low, 2)} to {fmt.number(high, 2)})" if math.isfinite(low) else ""
            some = f", {had} of {tried}" if had < tried and math.isfinite(error) else ""
            cells.append(fmt.number(error, 2) + luck + some)
        lines.append(Line([words.method(method), *cells]))
    said = f"Root mean square error in per cent of the truth, by {FACTORS[found.factor]}."
    said += " In brackets its 95 % interval, by the repeats; then how many of them had an answer, if not all."
    return Table(headers, lines, frozenset({0}), said)


PLUGIN = Sweeps()
