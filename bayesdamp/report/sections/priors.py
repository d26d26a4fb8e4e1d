"""What was assumed before the record was seen."""

from __future__ import annotations

from markupsafe import Markup

from bayesdamp.odds import FURTHER_TERM, OTHERS
from bayesdamp.priors import LEAST_SCALE, MOST_SCALE, SharedHalfNormal
from bayesdamp.report import words
from bayesdamp.report.html import paragraph, stack
from bayesdamp.report.results.answers import only_answered
from bayesdamp.report.results.run import Run
from bayesdamp.report.sections._layout import SignalSection, by_signal
from bayesdamp.table import Table

COMPARED = (
    "Before the record is seen single terms are equally probable; each further term of a sum makes it "
    f"{FURTHER_TERM:g} times as probable; restoring laws are equally probable."
)
ANSWERED = (
    COMPARED.removesuffix(".")
    + f". All other forms of damping together are {OTHERS:g} times as probable as one single term."
)
SHARED = (
    "The damping terms of a model have half-normal priors on their equivalent damping ratios. Their common scale is "
    f"unknown, log-uniform between {LEAST_SCALE:g} and {MOST_SCALE:g}, so the evidence does not depend on "
    "how small the damping is."
)


WIDER = (
    "A parameter has the same prior in every model that has it. A wider prior of a coefficient that you give lowers "
    "the evidence of the models that have it, by about the logarithm of the factor."
)


class Priors(SignalSection):
    """The priors of each signal; a parameter with one prior in all models stands once."""

    order = 80
    title = "What was assumed: the priors"

    def shows(self, run: Run, signal: str) -> bool:
        """Return whether something was inferred from a signal."""
        return bool((run.info.get("priors") or {}).get(signal))

    def applies(self, run: Run) -> bool:
        """Return whether something was inferred."""
        return super().applies(run) or bool(run.info.get("assumed"))

    def render(self, run: Run) -> Markup:
        """Return the prior odds, a table of priors for each signal, and what was assumed of envelopes."""
        wanted = [s for s in run.signals if self.shows(run, s)]
        rows = (Markup("<li>{}</li>").format(said) for said in run.info.get("assumed") or ())
        assumed = Markup("<ul>{}</ul>").format(Markup("").join(rows)) if run.info.get("assumed") else ""
        if not wanted:
            return stack(assumed)
        odds = ANSWERED if only_answered(run) else COMPARED
        shared = SHARED if _shared(run, wanted) else ""
        return stack(paragraph(f"{odds} {shared} {WIDER}"), by_signal(run, self.part, wanted), assumed)

    def part(self, run: Run, signal: str) -> Markup:
        """Return a table of the priors."""
        models: dict[str, dict[str, str]] = run.info["priors"][signal]
        lines = []
        for name in dict.fromkeys(name for found in models.values() for name in found):
            texts: dict[str, list[str]] = {}
            for model, found in models.items():
                if name in found:
                    texts.setdefault(str(found[name]), []).append(words.model(model))
            symbol = words.symbol(name)
            for text, where in texts.items():
                everywhere = 1 < len(where) == len(models)
                lines.append([symbol.text, symbol.meaning, text, "all" if everywhere else "; ".join(where)])
        return stack(Table(["parameter", "meaning", "prior", "models"], lines, range(4)))


def _shared(run: Run, signals: list[str]) -> bool:
    """Return whether damping terms of any model have the default prior."""
    every = (found for signal in signals for found in run.info["priors"][signal].values())
    default = SharedHalfNormal(per_ratio=1.0).describe()
    return any(str(prior) == default for p in every for prior in p.values())


PLUGIN = Priors()
