"""What was assumed before the record was seen."""

from __future__ import annotations

from markupsafe import Markup

from bayesdamp.report import words
from bayesdamp.report.html import Line, Table, fill
from bayesdamp.report.results.answers import only_answered
from bayesdamp.report.results.run import Run
from bayesdamp.report.sections._layout import by_signal
from bayesdamp.report.sections._section import Section

ALIKE = "The models are equally probable before the record is seen."
ANSWERED = (
    "Before the record is seen single terms and sums of two are equally probable, the sum of three half as much, all "
    "other forms of damping together a tenth of one sum; restoring laws are alike."
)


class Priors(Section):
    """The priors of each signal; a parameter with one prior in all models stands once."""

    order = 80
    name = "priors"
    title = "What was assumed: the priors"

    def applies(self, run: Run) -> bool:
        """Where something was inferred."""
        return any((run.info.get("priors") or {}).values())

    def render(self, run: Run) -> str:
        """Prior odds, then a table of priors for each signal."""
        wanted = [s for s in run.signals if run.info["priors"].get(s)]
        odds = ANSWERED if only_answered(run) else ALIKE
        return fill("priors.html", odds=odds, body=by_signal(run, lambda signal: _one(run, signal), wanted))


def _one(run: Run, signal: str) -> Markup:
    models: dict[str, dict[str, str]] = run.info["priors"][signal]
    names = dict.fromkeys(name for found in models.values() for name in found)
    lines = []
    for name in names:
        texts: dict[str, list[str]] = {}
        for model, found in models.items():
            if name in found:
                texts.setdefault(str(found[name]), []).append(words.model(model))
        for text, where in texts.items():
            everywhere = len(where) == len(models)
            lines.append(
                Line(
                    [
                        words.symbol(name).text,
                        words.symbol(name).meaning,
                        text,
                        "all" if everywhere and len(models) > 1 else "; ".join(where),
                    ]
                )
            )
    return fill(
        "stack.html",
        parts=[Table(["parameter", "meaning", "prior", "models"], lines, frozenset({0, 1, 2, 3}))],
    )


PLUGIN = Priors()
