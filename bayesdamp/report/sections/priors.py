"""What was assumed before the record was seen."""

from __future__ import annotations

from markupsafe import Markup

from bayesdamp.odds import FURTHER_TERM, OTHERS
from bayesdamp.priors import LEAST_SCALE, MOST_SCALE, SharedHalfNormal
from bayesdamp.report import words
from bayesdamp.report.html import fill, stack
from bayesdamp.report.results.answers import only_answered
from bayesdamp.report.results.run import Run
from bayesdamp.report.sections._layout import by_signal
from bayesdamp.report.sections._section import Section
from bayesdamp.table import Line, Table

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


class Priors(Section):
    """The priors of each signal; a parameter with one prior in all models stands once."""

    order = 80
    name = "priors"
    title = "What was assumed: the priors"

    def applies(self, run: Run) -> bool:
        """Where something was inferred."""
        return any((run.info.get("priors") or {}).values()) or bool(run.info.get("assumed"))

    def render(self, run: Run) -> str:
        """Prior odds, then a table of priors for each signal."""
        wanted = [s for s in run.signals if run.info["priors"].get(s)]
        rows = (Markup("<li>{}</li>").format(said) for said in run.info.get("assumed") or ())
        assumed = Markup("<ul>{}</ul>").format(Markup("").join(rows))
        if not wanted:
            return assumed
        odds = ANSWERED if only_answered(run) else COMPARED
        shared = SHARED if _shared(run, wanted) else ""
        return fill(
            "priors.html",
            odds=odds,
            shared=shared,
            body=by_signal(run, _one, wanted) + (assumed if run.info.get("assumed") else ""),
        )


def _shared(run: Run, signals: list[str]) -> bool:
    """Whether damping terms of any model have the default prior."""
    every = (found for signal in signals for found in run.info["priors"][signal].values())
    return any(
        str(prior) == SharedHalfNormal(per_ratio=1.0).describe() for p in every for prior in p.values()
    )


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
    return stack(Table(["parameter", "meaning", "prior", "models"], lines, frozenset({0, 1, 2, 3})))


PLUGIN = Priors()
