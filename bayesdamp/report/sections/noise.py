"""Which noise a record has, where several models were weighed."""

from __future__ import annotations

from collections.abc import Callable

from markupsafe import Markup

from bayesdamp import formatting as fmt
from bayesdamp.report import words
from bayesdamp.report.html import stack
from bayesdamp.report.results.answers import content_of
from bayesdamp.report.results.run import Run
from bayesdamp.report.sections._layout import SignalSection
from bayesdamp.store.contents.answers import WeighedNoise
from bayesdamp.table import Table

HOW = (
    "The noise models are compared once for each record, on the residuals of the fit of all damping terms, and all "
    "damping models share the result. The evidence is by Laplace's approximation; densities of rounded values are "
    "probabilities divided by the recording step, so that all are on one scale. Where correlated noise is likeliest, "
    "the answer is under Gaussian noise whose variance is that of the residual near the oscillation."
)


class Noise(SignalSection):
    """The evidence of the noise models, and the one that all dampings of the record share."""

    order = 45
    name = "noise"
    title = "Which noise"
    lead = HOW

    def shows(self, run: Run, signal: str) -> bool:
        """Return whether several noise models were weighed on a record."""
        content = content_of(run, signal)
        return content is not None and len(content.noises) > 1

    def part(self, run: Run, signal: str) -> Markup:
        """Return a table of the noise models."""
        content = content_of(run, signal)
        assert content is not None
        ranked = sorted(content.noises, key=lambda noise: -noise.log_evidence)
        columns: dict[str, Callable[[WeighedNoise], str]] = {
            "noise": lambda n: words.method(n.name),
            "log evidence below the best": lambda n: fmt.fixed(ranked[0].log_evidence - n.log_evidence, 1),
            "its parameters": lambda n: ", ".join(
                f"{words.symbol(name).text} {fmt.number(value, 3)}" for name, value in n.values.items()
            ),
            "": lambda n: "used for the answer" if n.name == content.noise else "",
        }
        return stack(
            Table.of(ranked, columns, {0, 2, 3}, kind=lambda n: "best" if n.name == content.noise else "")
        )


PLUGIN = Noise()
