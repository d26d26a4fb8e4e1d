"""The width within which friction changes its sign, where it was not known."""

from __future__ import annotations

from markupsafe import Markup

from bayesdamp import formatting as fmt
from bayesdamp.report import words
from bayesdamp.report.html import stack
from bayesdamp.report.results.answers import content_of
from bayesdamp.report.results.run import Run
from bayesdamp.report.sections._layout import SignalSection
from bayesdamp.table import Line, Table

HOW = (
    "Friction changes its sign within a velocity ε, of which a precise record shows something near rest and at each "
    "turning point. The widths are compared once for each record, with all damping terms, and all damping models are "
    "then under one width. The table shows how far the coefficients of the fit of all terms move with it. "
    "Estimators use 2 % of the peak velocity."
)


class Friction(SignalSection):
    """The probability of each width ε, and the coefficients under it."""

    order = 46
    name = "friction"
    title = "How sharply friction turns over"
    lead = HOW

    def shows(self, run: Run, signal: str) -> bool:
        """Return whether widths of friction were tried."""
        content = content_of(run, signal)
        return content is not None and bool(content.frictions)

    def part(self, run: Run, signal: str) -> Markup:
        """Return a table of the widths."""
        content = content_of(run, signal)
        assert content is not None
        lines = []
        for width in content.frictions:
            used = width.epsilon == content.epsilon
            numbers = [fmt.number(value, 4) for value in width.coefficients]
            cells = [fmt.number(width.epsilon, 3), fmt.fixed(width.weight, 3), *numbers]
            lines.append(Line([*cells, "used for the answer" if used else ""], "best" if used else ""))
        names = [words.model(term) for term in content.terms]
        headers = [f"ε / ({run.unit(signal).base}/s)", "probability", *names, ""]
        return stack(Table(headers, lines, {2 + len(names)}))


PLUGIN = Friction()
