"""Which noise the record has, where the study left that open."""

from __future__ import annotations

import math

from markupsafe import Markup

from bayesdamp import formatting as fmt
from bayesdamp.report import words
from bayesdamp.report.html import fill
from bayesdamp.report.results.run import Run
from bayesdamp.report.sections._layout import by_signal
from bayesdamp.report.sections._section import Section
from bayesdamp.store.contents.records import NoiseContent, NoiseTried
from bayesdamp.table import Line, Table
from bayesdamp.types import OK


class Noise(Section):
    """The evidence of the noise models, and the one that all dampings of the record share."""

    order = 45
    name = "noise"
    title = "Which noise"

    def applies(self, run: Run) -> bool:
        """Where the noise was chosen for a record."""
        return any(run.cells("noise", signal) for signal in run.signals)

    def render(self, run: Run) -> str:
        """A table of the noise models for each signal."""
        said = (
            "Chosen once for each record, under all damping terms together and the restoring law that fits best, "
            "and shared by all models. The evidence is by Laplace's approximation; densities of rounded values "
            "are probabilities divided by the recording step, so that all are on one scale."
        )
        if run.under_law:
            said += (
                " It is that of fits under laws that hold exactly; chains and evidence have the answer's own."
            )
        return fill(
            "stack.html", parts=[Markup("<p>{}</p>").format(said), by_signal(run, lambda s: _one(run, s))]
        )


def _one(run: Run, signal: str) -> Markup:
    repeats = run.repeats(signal)
    cell = run.cell("noise", signal, repeats[0])
    if cell is None:
        return Markup("<p>No noise was chosen for this signal.</p>")
    if cell.outcome != OK:
        return Markup("<p>{}</p>").format(cell.outcome)
    found = NoiseContent.of(cell)
    best = max((w.log_evidence for w in found.weighed if w.outcome == OK), default=math.nan)
    lines = [_line(w, best, found.chosen) for w in sorted(found.weighed, key=lambda w: -w.log_evidence)]
    headers = ["noise", "log evidence below the best", "its parameters", ""]
    others = _others(run, signal, repeats)
    return fill("stack.html", parts=[Table(headers, lines, frozenset({0, 2, 3})), others])


def _line(w: NoiseTried, best: float, chosen: str) -> Line:
    name = words.method(w.noise)
    if w.outcome != OK:
        return Line([name, fmt.NONE, fmt.NONE, w.outcome], "quiet")
    values = ", ".join(f"{words.symbol(n).text} {fmt.number(v, 3)}" for n, v in w.values.items())
    mine = w.noise == chosen
    below = fmt.fixed(best - w.log_evidence, 0 if w.held else 1)
    said = "chosen" if mine else "far behind on the residuals of another's fit" if w.held else ""
    return Line([name, below, values, said], "best" if mine else "")


def _others(run: Run, signal: str, repeats: list[int]) -> Markup:
    cells = [run.cell("noise", signal, r) for r in repeats]
    chosen = [NoiseContent.of(c).chosen for c in cells if c is not None and c.outcome == OK]
    if len(chosen) < 2:
        return Markup("")
    said = fmt.listing(f"{words.method(n)} in {chosen.count(n)}" for n in dict.fromkeys(chosen))
    return Markup("<p>Over {} repeats: {}.</p>").format(len(chosen), said)


PLUGIN = Noise()
