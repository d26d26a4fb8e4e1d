"""Show the prior probabilities of the models and the priors of their parameters."""

from markupsafe import Markup

from bayesdamp.formatting import Table
from bayesdamp.priors import FURTHER_TERM, LEAST_SCALE, MOST_SCALE, OTHER_FORMS_ODDS, SharedHalfNormal
from bayesdamp.report import words
from bayesdamp.report.results.run import RunFolder
from bayesdamp.report.sections import SignalSection, bullets, paragraph, stack

COMPARED = (
    "All single damping terms have the same prior probability; each further term of a sum multiplies the probability "
    f"by {FURTHER_TERM:g}. All restoring laws have the same prior probability."
)
OTHER_FORMS = (
    f"All other forms of damping together are {OTHER_FORMS_ODDS:g} times as probable as one single term."
)
COMMON_SCALE = (
    "The damping terms of a model have half-normal priors on their equivalent damping ratios. Their common scale is "
    f"unknown, with a log-uniform prior between {LEAST_SCALE:g} and {MOST_SCALE:g}, and is integrated out. Such "
    "default priors therefore have no width to choose, and the evidence does not depend on how small the damping is."
)
WIDE_PRIOR = (
    "A parameter has the same prior in every model that contains it. If you specify a prior that is wider by a factor, "
    "the log evidence of the models with this parameter decreases by about the logarithm of the factor."
)


PRIORS = "Prior of each inferred parameter (in units of rad or m, and s), and the models that have it."


class PriorsSection(SignalSection):
    """The section with the priors of each signal. Equal priors of a parameter are listed once, with their models."""

    order = 80
    title = "Assumptions: the priors"

    def shows(self, run: RunFolder, signal: str) -> bool:
        """Return whether run.json lists priors of a signal."""
        return bool((run.info.get("priors") or {}).get(signal))

    def applies(self, run: RunFolder) -> bool:
        """Return whether run.json lists priors, or assumptions on envelopes."""
        return super().applies(run) or bool(run.info.get("assumed"))

    def render(self, run: RunFolder) -> Markup:
        """Return the prior odds, a table of priors for each signal, and the assumptions on envelopes."""
        signals = [s for s in run.signals if self.shows(run, s)]
        assumed = bullets(run.info.get("assumed") or ())
        if not signals:
            return stack(assumed)
        tables = (table for signal in signals for table in run.info["priors"][signal].values())
        default = SharedHalfNormal(per_ratio=1.0).describe()
        is_shared = any(str(prior) == default for table in tables for prior in table.values())
        sentences = [COMPARED, OTHER_FORMS * run.only_answered, COMMON_SCALE * is_shared, WIDE_PRIOR]
        return stack(paragraph(" ".join(filter(None, sentences))), self.by_signal(run, signals), assumed)

    def part(self, run: RunFolder, signal: str) -> Markup:
        """Return a table of a signal's priors: parameter, meaning, prior in words, and the models that have it."""
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
        return stack(Table(["parameter", "meaning", "prior", "models"], lines, range(4), PRIORS))


PLUGIN = PriorsSection()
