"""Which damping: evidence, Bayes factors and probabilities."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

from markupsafe import Markup

from bayesdamp import formatting as fmt
from bayesdamp.outcomes import Status, reason_of, status_of
from bayesdamp.report import words
from bayesdamp.report.html import folded, stack
from bayesdamp.report.results.answers import only_answered
from bayesdamp.report.results.reading import label, ranking
from bayesdamp.report.results.run import Row, Run, rows_of
from bayesdamp.report.sections._layout import SignalSection
from bayesdamp.table import Table
from bayesdamp.types import OK

COUNTS = (
    "The adopted evidence: nested sampling where it ran as a check (unless the study wants it "
    "always: where the others are more than three standard errors apart or poor), else their mean by inverse variance."
)


class EvidenceSection(SignalSection):
    """A bar per model, and every method's numbers in a table."""

    order = 60
    title = "Which damping: the evidence"
    lead = (
        "The evidence weighs how well a model predicts the record against how much it could have predicted. A log "
        "Bayes factor of one nat is barely worth a mention, three is positive, five and more is strong, as long as the "
        "noise model is right and the priors below are accepted."
    )
    nothing = "No evidence was computed in this study, so no model can be preferred."

    def shows(self, run: Run, signal: str) -> bool:
        """Return whether a study weighed candidates beside the answer."""
        return any(r["signal"] == signal for r in run.evidence) and not only_answered(run)

    def part(self, run: Run, signal: str) -> Markup:
        """Return log Bayes factors by method, with probabilities and diagnostics."""
        repeats = run.repeats(signal)
        parts: list[object] = [_table(run, signal, repeats[:1])]
        aside = _aside(run, signal, repeats[0])
        if aside.lines:
            count = f"{len(aside.lines)} model{'s' * (len(aside.lines) > 1)}"
            parts.append(folded(f"{count} pruned by Laplace's evidence, and why", aside))
        if len(repeats) > 1:
            parts.append(folded(f"All {len(repeats)} repeats", _table(run, signal, repeats)))
        return stack(*parts)


def _table(run: Run, signal: str, repeats: Sequence[int]) -> Table:
    """Return every method's numbers of the candidates that were weighed."""
    wanted: list[Row] = []
    best = []
    for repeat in repeats:
        rows = rows_of(run.evidence, signal=signal, repeat=repeat)
        out = {r["model"] for r in rows if status_of(r["outcome"]) is Status.PRUNED}
        found = ranking(run, signal, repeat)
        order = [r["model"] for r in found.rows] if found else []
        best += [(repeat, model) for model in order[:1]]
        rows.sort(key=lambda r: order.index(r["model"]) if r["model"] in order else len(order))
        wanted += [r for r in rows if r["model"] not in out]
    columns: dict[str, Callable[[Row], str]] = {
        "model": label,
        "method": lambda r: words.method(r["method"]),
        "log evidence / nats": lambda r: fmt.nats(r["log_evidence"], r["stderr"]),
        "log Bayes factor": lambda r: fmt.nats(r["log_bayes_factor"]) if r["log_bayes_factor"] else "0",
        "probability": lambda r: fmt.probability(r["probability"]),
        "diagnostic": lambda r: (
            (r["diagnostic"].replace(" -", " −") if r["outcome"] == OK else r["outcome"]) or fmt.NONE
        ),
    }
    if len(repeats) > 1:
        columns = {"repeat": lambda r: str(r["repeat"] + 1), **columns}
    left = [i for i, header in enumerate(columns) if header in ("model", "method", "diagnostic")]

    def kind(r: Row) -> str:
        return "quiet" if r["outcome"] != OK else "best" if (r["repeat"], r["model"]) in best else ""

    caption = COUNTS if any(r["method"] == "combined" for r in run.evidence) else ""
    return Table.of(wanted, columns, left, caption, kind)


def _aside(run: Run, signal: str, repeat: int) -> Table:
    """The candidates that were pruned, the likeliest first, each with its cheap evidence where it came so far."""
    rows = rows_of(run.evidence, signal=signal, repeat=repeat)
    why = {r["model"]: r["outcome"] for r in rows if status_of(r["outcome"]) is Status.PRUNED}
    cheap = {r["model"]: r for r in rows if r["method"] == "laplace"}

    def height(model: str) -> float:
        value = cheap[model]["log_evidence"] if model in cheap else math.nan
        return value if math.isfinite(value) else -math.inf

    columns: dict[str, Callable[[str], str]] = {
        "model": words.model,
        "log evidence / nats": lambda model: fmt.nats(cheap.get(model, {}).get("log_evidence")),
        "log Bayes factor": lambda model: fmt.nats(cheap.get(model, {}).get("log_bayes_factor")),
        "why": lambda model: reason_of(why[model]),
    }
    said = "Laplace's approximation, where the search came so far."
    return Table.of(sorted(why, key=height, reverse=True), columns, (0, 3), said)


PLUGIN = EvidenceSection()
