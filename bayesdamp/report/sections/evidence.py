"""Which damping: evidence, Bayes factors and probabilities."""

from __future__ import annotations

import math

from markupsafe import Markup

from bayesdamp import formatting as fmt
from bayesdamp.outcomes import Status, reason_of, status_of
from bayesdamp.report import words
from bayesdamp.report.figures.evidence import bars
from bayesdamp.report.html import fill, folded, paragraph, stack
from bayesdamp.report.results.answers import only_answered
from bayesdamp.report.results.reading import label, ranking
from bayesdamp.report.results.run import Run, rows_of
from bayesdamp.report.sections._layout import by_signal
from bayesdamp.report.sections._section import Section
from bayesdamp.table import Line, Table
from bayesdamp.types import OK

COUNTS = (
    "The adopted evidence: nested sampling where it ran as a check (unless the study wants it "
    "always: where the others are more than three standard errors apart or poor), else their mean by inverse variance."
)


class EvidenceSection(Section):
    """A bar per model, and every method's numbers in a table."""

    order = 60
    name = "evidence"
    title = "Which damping: the evidence"

    def applies(self, run: Run) -> bool:
        """Where a study weighed candidates beside the answer, or should have."""
        return bool(run.signals) and not only_answered(run)

    def render(self, run: Run) -> str:
        """Log Bayes factors by method, with probabilities and diagnostics."""
        if not run.evidence:
            return paragraph("No evidence was computed in this study, so no model can be preferred.")
        wanted = [s for s in run.signals if any(r["signal"] == s for r in run.evidence)]
        return fill("evidence.html", body=by_signal(run, _one, wanted))


def _one(run: Run, signal: str) -> Markup:
    repeats = run.repeats(signal)
    repeat = repeats[0]
    found = ranking(run, signal, repeat)
    parts: list[object] = []
    weighed = [r for r in found.rows if status_of(r["outcome"]) is not Status.PRUNED] if found else []
    if found and len(weighed) > 1:
        said = f", repeat 1 of {len(repeats)}" if len(repeats) > 1 else ""
        left = len(found.rows) - len(weighed)
        those = f"; not shown: {left} that {'were' if left > 1 else 'was'} pruned" if left else ""
        caption = (
            f"{signal}{said}: log Bayes factor to the best model (axis logarithmic beyond one nat) and "
            f"probability of each model, by {words.method(found.method)}{those}."
        )
        parts.append(run.drawings.add(f"evidence-{signal}", caption, lambda: bars(weighed)))
    parts.append(_table(run, signal, [repeat]))
    aside = _aside(run, signal, repeat)
    if aside.lines:
        count = f"{len(aside.lines)} model{'s' * (len(aside.lines) > 1)}"
        parts.append(folded(f"{count} pruned by Laplace's evidence, and why", aside))
    if len(repeats) > 1:
        parts.append(folded(f"All {len(repeats)} repeats", _table(run, signal, repeats)))
    return stack(*parts)


def _table(run: Run, signal: str, repeats: list[int]) -> Table:
    """Every method's numbers of the candidates that were weighed."""
    lines = []
    for repeat in repeats:
        rows = rows_of(run.evidence, signal=signal, repeat=repeat)
        out = {r["model"] for r in rows if status_of(r["outcome"]) is Status.PRUNED}
        found = ranking(run, signal, repeat)
        order = [r["model"] for r in found.rows] if found else []
        rows.sort(key=lambda r: order.index(r["model"]) if r["model"] in order else len(order))
        last = None
        for r in rows:
            if r["model"] in out:
                continue
            lead = [str(repeat + 1)] if len(repeats) > 1 else []
            top = r["outcome"] == OK and order[:1] == [r["model"]]
            lines.append(
                Line(
                    [
                        *lead,
                        label(r) if r["model"] != last else "",
                        words.method(r["method"]),
                        fmt.nats(r["log_evidence"], r["stderr"]),
                        fmt.nats(r["log_bayes_factor"]) if r["log_bayes_factor"] else "0",
                        fmt.probability(r["probability"]),
                        (r["diagnostic"].replace(" -", " −") if r["outcome"] == OK else r["outcome"])
                        or fmt.NONE,
                    ],
                    "best" if top else "" if r["outcome"] == OK else "quiet",
                )
            )
            last = r["model"]
    headers = ["model", "method", "log evidence / nats", "log Bayes factor", "probability", "diagnostic"]
    left = {0, 1, 5}
    caption = COUNTS if any(r["method"] == "combined" for r in run.evidence) else ""
    if len(repeats) > 1:
        return Table(["repeat", *headers], lines, frozenset(i + 1 for i in left), caption)
    return Table(headers, lines, frozenset(left), caption)


def _aside(run: Run, signal: str, repeat: int) -> Table:
    """The candidates that were pruned, the likeliest first, each with its cheap evidence where it came so far."""
    rows = rows_of(run.evidence, signal=signal, repeat=repeat)
    why = {r["model"]: r["outcome"] for r in rows if status_of(r["outcome"]) is Status.PRUNED}
    cheap = {r["model"]: r for r in rows if r["method"] == "laplace"}
    first = {r["model"]: r for r in reversed(rows)}

    def height(model: str) -> float:
        value = cheap[model]["log_evidence"] if model in cheap else math.nan
        return value if math.isfinite(value) else -math.inf

    lines = []
    for model in sorted(why, key=height, reverse=True):
        numbers = cheap.get(model, {})
        shown = [fmt.nats(numbers.get(key)) for key in ("log_evidence", "log_bayes_factor")]
        lines.append(Line([label(first[model]), *shown, reason_of(why[model])]))
    headers = ["model", "log evidence / nats", "log Bayes factor", "why"]
    return Table(headers, lines, frozenset({0, 3}), "Laplace's approximation, where the search came so far.")


PLUGIN = EvidenceSection()
