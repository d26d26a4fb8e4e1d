"""The assumptions made before the record was seen."""

from __future__ import annotations

from markupsafe import Markup

from bayesdamp.odds import FURTHER_TERM, OTHERS
from bayesdamp.priors import LEAST_SCALE, MOST_SCALE, SharedHalfNormal
from bayesdamp.report import words
from bayesdamp.report.markup import paragraph, stack
from bayesdamp.report.results.answers import only_answered
from bayesdamp.report.results.run import RunFolder
from bayesdamp.report.sections import SignalSection, by_signal
from bayesdamp.table import Table

COMPARED = (
    "All single damping terms have the same prior probability; each further term of a sum multiplies the probability "
    f"by {FURTHER_TERM:g}. All restoring laws have the same prior probability."
)
OTHER_FORMS = f"All other forms of damping together are {OTHERS:g} times as probable as one single term."
SHARED = (
    "The damping terms of a model have half-normal priors on their equivalent damping ratios. Their common scale is "
    f"unknown, with a log-uniform prior between {LEAST_SCALE:g} and {MOST_SCALE:g}, so the evidence does not depend on "
    "how small the damping is."
)
WIDER = (
    "A parameter has the same prior in every model that contains it. If you specify a wider prior for a coefficient, "
    "the log evidence of the models that contain it decreases by about the logarithm of the factor."
)


class PriorsSection(SignalSection):
    """The priors of each signal; a parameter with one prior in all models is listed once."""

    order = 80
    title = "Assumptions: the priors"

    def shows(self, run: RunFolder, signal: str) -> bool:
        """Return whether parameters of a signal were inferred."""
        return bool((run.info.get("priors") or {}).get(signal))

    def applies(self, run: RunFolder) -> bool:
        """Return whether anything was inferred."""
        return super().applies(run) or bool(run.info.get("assumed"))

    def render(self, run: RunFolder) -> Markup:
        """Return the prior odds, a table of priors for each signal, and the assumptions on envelopes."""
        signals = [s for s in run.signals if self.shows(run, s)]
        items = Markup("").join(Markup("<li>{}</li>").format(text) for text in run.info.get("assumed") or ())
        assumed = Markup("<ul>{}</ul>").format(items) if items else ""
        if not signals:
            return stack(assumed)
        tables = (table for signal in signals for table in run.info["priors"][signal].values())
        default = SharedHalfNormal(per_ratio=1.0).describe()
        is_shared = any(str(prior) == default for table in tables for prior in table.values())
        sentences = [COMPARED, OTHER_FORMS * only_answered(run), SHARED * is_shared, WIDER]
        return stack(
            paragraph(" ".join(filter(None, sentences))), by_signal(run, self.part, signals), assumed
        )

    def part(self, run: RunFolder, signal: str) -> Markup:
        """Return a table of the priors."""
        models: dict[str, dict[str, str]] = run.info["priors"][signal]
        lines = []
        for name in dict.fromkeys(name for priors in models.values() for name in priors):
            texts: dict[str, list[str]] = {}
            for model, priors in models.items():
                if name in priors:
                    texts.setdefault(str(priors[name]), []).append(words.model(model))
            symbol = words.symbol(name)
            for text, where in texts.items():
                everywhere = 1 < len(where) == len(models)
                lines.append([symbol.text, symbol.meaning, text, "all" if everywhere else "; ".join(where)])
        return stack(Table(["parameter", "meaning", "prior", "models"], lines, range(4)))


PLUGIN = PriorsSection()
