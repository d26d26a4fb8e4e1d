"""Which noise a record has, where several models were weighed."""

from __future__ import annotations

from markupsafe import Markup

from bayesdamp import formatting as fmt
from bayesdamp.report import words
from bayesdamp.report.html import fill
from bayesdamp.report.results.answers import content_of
from bayesdamp.report.results.run import Run
from bayesdamp.report.sections._layout import by_signal
from bayesdamp.report.sections._section import Section
from bayesdamp.table import Line, Table

HOW = (
    "The noise models are compared once for each record, on the residuals of the fit of all damping terms, and all "
    "damping models share the result. The evidence is by Laplace's approximation; densities of rounded values are "
    "probabilities divided by the recording step, so that all are on one scale. Where correlated noise is likeliest, "
    "the answer is under Gaussian noise whose variance is that of the residual near the oscillation."
)


class Noise(Section):
    """The evidence of the noise models, and the one that all dampings of the record share."""

    order = 45
    name = "noise"
    title = "Which noise"

    def applies(self, run: Run) -> bool:
        """Return whether several noise models were weighed on a record."""
        return any(_weighed(run, signal) for signal in run.signals)

    def render(self, run: Run) -> str:
        """Show a table of the noise models for each signal."""
        parts = [Markup("<p>{}</p>").format(HOW), by_signal(run, lambda s: _one(run, s))]
        return fill("stack.html", parts=parts)


def _weighed(run: Run, signal: str) -> bool:
    content = content_of(run, signal, run.repeats(signal)[0])
    return content is not None and len(content.noises) > 1


def _one(run: Run, signal: str) -> Markup:
    content = content_of(run, signal, run.repeats(signal)[0])
    if content is None or not content.noises:
        return Markup("<p>No noise models were compared on this signal.</p>")
    order = sorted(content.noises, key=lambda one: -one.log_evidence)
    lines = []
    for one in order:
        values = ", ".join(f"{words.symbol(n).text} {fmt.number(v, 3)}" for n, v in one.values.items())
        used = one.name == content.noise
        below = fmt.fixed(order[0].log_evidence - one.log_evidence, 1)
        said = "used for the answer" if used else ""
        lines.append(Line([words.method(one.name), below, values, said], "best" if used else ""))
    headers = ["noise", "log evidence below the best", "its parameters", ""]
    return fill("stack.html", parts=[Table(headers, lines, frozenset({0, 2, 3}))])


PLUGIN = Noise()
