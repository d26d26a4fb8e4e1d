"""The noise model, and the velocity within which friction changes its sign, if several were compared."""

from __future__ import annotations

from collections.abc import Callable

from markupsafe import Markup

from bayesdamp import formatting as fmt
from bayesdamp.report import words
from bayesdamp.report.markup import stack
from bayesdamp.report.results.answers import answer_content
from bayesdamp.report.results.run import RunFolder
from bayesdamp.report.sections import SignalSection
from bayesdamp.store.contents import WeighedNoise
from bayesdamp.table import Table
from bayesdamp.types import Friction

USED = "used for the answer"


class NoiseSection(SignalSection):
    """The probabilities of the noise models and of the widths of friction, and which are used."""

    order = 45
    title = "Noise model, and width of friction"
    lead = (
        "The noise models are compared once for each record, on the residual of the fit of all damping terms, and all "
        "damping models use the result. The evidence is Laplace's approximation. Densities of rounded values are "
        "probabilities divided by the recording step, so that all models are on one scale. If correlated noise is the "
        "most probable, the answer uses Gaussian noise with the variance of the residual near the oscillation. "
        "Friction changes its sign within a velocity ε, which affects a precise record near rest and at each turning "
        "point. If ε was not given, several widths are compared once for each record, with all damping terms, and all "
        "damping models use one width. The table shows how the coefficients of the fit of all terms change with it. "
        "Estimators use 2 % of the peak velocity."
    )

    def shows(self, run: RunFolder, signal: str) -> bool:
        """Return whether several noise models or widths of friction were compared on a record."""
        content = answer_content(run, signal)
        return content is not None and (len(content.noises) > 1 or bool(content.frictions))

    def part(self, run: RunFolder, signal: str) -> Markup:
        """Return a table of the noise models and of the widths."""
        content = answer_content(run, signal)
        assert content is not None
        noises = sorted(content.noises, key=lambda noise: -noise.log_evidence)
        of_noise: dict[str, Callable[[WeighedNoise], str]] = {
            "noise": lambda n: words.method(n.name),
            "log evidence below the best": lambda n: fmt.fixed(noises[0].log_evidence - n.log_evidence, 1),
            "its parameters": lambda n: ", ".join(
                f"{words.symbol(name).text} {fmt.number(value, 3)}" for name, value in n.values.items()
            ),
            "": lambda n: USED if n.name == content.noise else "",
        }
        of_width: dict[str, Callable[[Friction], str]] = {
            f"ε / ({run.unit(signal).base}/s)": lambda width: fmt.number(width.epsilon, 3),
            "probability": lambda width: fmt.fixed(width.weight, 3),
        }
        for i, term in enumerate(content.terms):
            of_width[words.model(term)] = lambda width, i=i: fmt.number(width.coefficients[i], 4)
        of_width[""] = lambda width: USED if width.epsilon == content.epsilon else ""
        tables: list[Table] = []
        if len(noises) > 1:
            best = {content.noise: "best"}
            tables.append(Table.of(noises, of_noise, (0, 2, 3), kind=lambda n: best.get(n.name, "")))
        if content.frictions:
            width = {content.epsilon: "best"}
            left = (len(of_width) - 1,)
            tables.append(
                Table.of(content.frictions, of_width, left, kind=lambda w: width.get(w.epsilon, ""))
            )
        return stack(*tables)


PLUGIN = NoiseSection()
