"""The width within which friction changes its sign, where it was not known."""

from __future__ import annotations

from markupsafe import Markup

from bayesdamp import formatting as fmt
from bayesdamp.report import words
from bayesdamp.report.html import fill
from bayesdamp.report.results.answers import content_of
from bayesdamp.report.results.run import Run
from bayesdamp.report.sections._layout import by_signal
from bayesdamp.report.sections._section import Section
from bayesdamp.store.contents.answers import AnswerContent
from bayesdamp.table import Line, Table

HOW = (
    "Friction changes its sign within a velocity ε, of which a precise record shows something near rest and at each "
    "turning point. The widths are compared once for each record, with all damping terms, and all damping models are "
    "then under one width. The table shows how far the coefficients of the fit of all terms move with it. "
    "Estimators use 2 % of the peak velocity."
)


class Friction(Section):
    """The probability of each width ε, and the coefficients under it."""

    order = 46
    name = "friction"
    title = "How sharply friction turns over"

    def applies(self, run: Run) -> bool:
        """Return whether widths of friction were tried."""
        return any(_tried(run, signal) for signal in run.signals)

    def render(self, run: Run) -> str:
        """Show a table of the widths for each signal."""
        parts = [Markup("<p>{}</p>").format(HOW), by_signal(run, lambda s: _one(run, s))]
        return fill("stack.html", parts=parts)


def _tried(run: Run, signal: str) -> AnswerContent | None:
    """The answer, if widths were tried for it."""
    content = content_of(run, signal, run.repeats(signal)[0])
    return content if content is not None and content.frictions else None


def _one(run: Run, signal: str) -> Markup:
    content = _tried(run, signal)
    if content is None:
        return Markup("<p>ε of this signal is specified, or the record shows hardly any friction.</p>")
    names = [words.model(term) for term in content.terms]
    lines = []
    for one in content.frictions:
        used = one.epsilon == content.epsilon
        numbers = [fmt.number(value, 4) for value in one.coefficients]
        shown = [fmt.number(one.epsilon, 3), fmt.fixed(one.weight, 3), *numbers]
        lines.append(Line([*shown, "used for the answer" if used else ""], "best" if used else ""))
    unit = run.unit(signal).base
    headers = [f"ε / ({unit}/s)", "probability", *names, ""]
    return fill("stack.html", parts=[Table(headers, lines, frozenset({2 + len(names)}))])


PLUGIN = Friction()
