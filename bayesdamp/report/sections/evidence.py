"""Which damping: evidence, Bayes factors and probabilities."""

from __future__ import annotations

from markupsafe import Markup

from bayesdamp.report import words
from bayesdamp.report.figures.evidence import Bar, bars
from bayesdamp.report.html import Line, Table, fill, folded
from bayesdamp.report.reading import label, ranking
from bayesdamp.report.run import Run, rows_of
from bayesdamp.report.sections._layout import by_signal
from bayesdamp.report.sections._section import Section
from bayesdamp.types import OK

COUNTS = (
    "What counts is all methods combined: nested sampling where it ran as the referee (unless the study wants it "
    "always: where the others are more than three standard errors apart or poor), else their mean by inverse variance."
)


class EvidenceSection(Section):
    """A bar per model, and every method's numbers in a table."""

    order = 60
    name = "evidence"
    title = "Which damping: the evidence"

    def applies(self, run: Run) -> bool:
        return bool(run.signals)

    def render(self, run: Run) -> str:
        if not run.evidence:
            return Markup("<p>No evidence was computed in this study, so no model can be preferred.</p>")
        wanted = [s for s in run.signals if any(r["signal"] == s for r in run.evidence)]
        return fill("evidence.html", body=by_signal(run, lambda signal: _one(run, signal), wanted))


def _one(run: Run, signal: str) -> Markup:
    repeats = run.repeats(signal)
    repeat = repeats[0]
    found = ranking(run, signal, repeat)
    parts: list[object] = []
    if found and len(found.rows) > 1:
        shown = [
            Bar(r["model"], label(r), r["log_bayes_factor"], r["stderr"], r["probability"])
            for r in found.rows
        ]
        said = f", repeat 1 of {len(repeats)}" if len(repeats) > 1 else ""
        caption = (
            f"{signal}{said}: log Bayes factor to the best model (axis logarithmic beyond one nat) and "
            f"probability of each model, all equally probable at the start, by {words.method(found.method)}."
        )
        parts.append(run.drawings.add(f"evidence-{signal}", caption, lambda: bars(shown)))
    parts.append(_table(run, signal, [repeat]))
    if len(repeats) > 1:
        parts.append(folded(f"All {len(repeats)} repeats", _table(run, signal, repeats)))
    return fill("stack.html", parts=parts)


def _table(run: Run, signal: str, repeats: list[int]) -> Table:
    lines = []
    for repeat in repeats:
        rows = rows_of(run.evidence, signal=signal, repeat=repeat)
        found = ranking(run, signal, repeat)
        order = [r["model"] for r in found.rows] if found else []
        rows.sort(key=lambda r: order.index(r["model"]) if r["model"] in order else len(order))
        for r in rows:
            lead = [str(repeat + 1)] if len(repeats) > 1 else []
            top = r["outcome"] == OK and order[:1] == [r["model"]]
            lines.append(
                Line(
                    [
                        *lead,
                        label(r),
                        words.method(r["method"]),
                        words.nats(r["log_evidence"], r["stderr"]),
                        words.nats(r["log_bayes_factor"]) if r["log_bayes_factor"] else "0",
                        words.probability(r["probability"]),
                        r["diagnostic"] or words.NONE,
                        r["outcome"],
                    ],
                    "best" if top else "" if r["outcome"] == OK else "quiet",
                )
            )
    headers = [
        "model",
        "method",
        "log evidence / nats",
        "log Bayes factor",
        "probability",
        "diagnostic",
        "outcome",
    ]
    left = {0, 1, 5, 6}
    caption = COUNTS if any(r["method"] == "combined" for r in run.evidence) else ""
    if len(repeats) > 1:
        return Table(["repeat", *headers], lines, frozenset(i + 1 for i in left), caption)
    return Table(headers, lines, frozenset(left), caption)


PLUGIN = EvidenceSection()
