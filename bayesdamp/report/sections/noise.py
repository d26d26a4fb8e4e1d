"""Which noise a record has, and how sharply friction changes its sign, where several were weighed."""

from __future__ import annotations

from collections.abc import Callable

from markupsafe import Markup

from bayesdamp import formatting as fmt
from bayesdamp.report import words
from bayesdamp.report.html import stack
from bayesdamp.report.results.answers import content_of
from bayesdamp.report.results.run import Run
from bayesdamp.report.sections._layout import SignalSection
from bayesdamp.store.contents import AnswerContent, WeighedNoise
from bayesdamp.table import Table
from bayesdamp.types import Friction

USED = "used for the answer"


class Noise(SignalSection):
    """The noise models and the widths of friction with their probabilities, and which are used."""

    order = 45
    title = "Which noise, and how sharp friction is"
    lead = (
        "The noise models are compared once for each record, on the residuals of the fit of all damping terms, and all "
        "damping models share the result. The evidence is by Laplace's approximation; densities of rounded values are "
        "probabilities divided by the recording step, so that all are on one scale. Where correlated noise is "
        "likeliest, the answer is under Gaussian noise whose variance is that of the residual near the oscillation. "
        "Friction changes its sign within a velocity ε, of which a precise record shows something near rest and at "
        "each turning point. Where ε was not given, widths are compared once for each record, with all damping terms, "
        "and all damping models are then under one width; a table shows how far the coefficients of the fit of all "
        "terms move with it. Estimators use 2 % of the peak velocity."
    )

    def shows(self, run: Run, signal: str) -> bool:
        """Return whether several noise models or widths of friction were weighed on a record."""
        content = content_of(run, signal)
        return content is not None and (len(content.noises) > 1 or bool(content.frictions))

    def part(self, run: Run, signal: str) -> Markup:
        """Return a table of each."""
        content = content_of(run, signal)
        assert content is not None
        noises = _noises(content) if len(content.noises) > 1 else ""
        return stack(noises, _widths(content, run.unit(signal).base) if content.frictions else "")


def _noises(content: AnswerContent) -> Table:
    ranked = sorted(content.noises, key=lambda noise: -noise.log_evidence)
    columns: dict[str, Callable[[WeighedNoise], str]] = {
        "noise": lambda n: words.method(n.name),
        "log evidence below the best": lambda n: fmt.fixed(ranked[0].log_evidence - n.log_evidence, 1),
        "its parameters": lambda n: ", ".join(
            f"{words.symbol(name).text} {fmt.number(value, 3)}" for name, value in n.values.items()
        ),
        "": lambda n: USED if n.name == content.noise else "",
    }
    return Table.of(ranked, columns, (0, 2, 3), kind=lambda n: "best" if n.name == content.noise else "")


def _widths(content: AnswerContent, unit: str) -> Table:
    columns: dict[str, Callable[[Friction], str]] = {
        f"ε / ({unit}/s)": lambda width: fmt.number(width.epsilon, 3),
        "probability": lambda width: fmt.fixed(width.weight, 3),
    }
    for i, term in enumerate(content.terms):
        columns[words.model(term)] = lambda width, i=i: fmt.number(width.coefficients[i], 4)
    columns[""] = lambda width: USED if width.epsilon == content.epsilon else ""
    used = content.epsilon
    return Table.of(
        content.frictions, columns, (len(columns) - 1,), kind=lambda w: "best" if w.epsilon == used else ""
    )


PLUGIN = Noise()
