"""The evidence of each damping model: Bayes factors and probabilities."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

from markupsafe import Markup

from bayesdamp import formatting as fmt
from bayesdamp.outcomes import Status, reason_of, status_of
from bayesdamp.report import words
from bayesdamp.report.markup import folded, stack
from bayesdamp.report.results.answers import only_answered
from bayesdamp.report.results.reading import ranking
from bayesdamp.report.results.run import Row, RunFolder, rows_of
from bayesdamp.report.sections import SignalSection
from bayesdamp.table import Table
from bayesdamp.types import OK

ADOPTED = (
    "The adopted evidence is that of nested sampling if it was computed as a check, otherwise the mean of the other "
    "methods, weighted by inverse variance. Unless the study always requires it, nested sampling runs if the others "
    "are unreliable or differ by more than three standard errors."
)

ANSWER = (
    "Sequential Monte Carlo gives the answer its evidence. It takes the estimated size of the noise, and where there "
    "are many samples it averages them in short blocks. Its log evidence therefore has another level, and with blocks "
    "a model that does not fit loses fewer nats. Compare log Bayes factors within one method only."
)


class EvidenceSection(SignalSection):
    """A table with the numbers of every method."""

    order = 60
    title = "Which damping: the evidence"
    lead = (
        "The evidence of a model is the probability with which it predicts the record, averaged over its prior. A log "
        "Bayes factor of one nat is hardly worth mentioning, three nats are positive evidence, and five or more are "
        "strong, if the noise model is correct and the priors below are accepted."
    )
    nothing = "No evidence was computed in this study, so no model can be preferred."

    def shows(self, run: RunFolder, signal: str) -> bool:
        """Return whether the study computed evidence besides the answer."""
        return any(r["signal"] == signal for r in run.evidence) and not only_answered(run)

    def part(self, run: RunFolder, signal: str) -> Markup:
        """Return log Bayes factors by method, with probabilities and diagnostics."""
        repeats = run.repeats(signal)
        parts: list[object] = [_table(run, signal, repeats[:1])]
        pruned = _pruned(run, signal, repeats[0])
        if pruned.lines:
            count = f"{len(pruned.lines)} model{'s' * (len(pruned.lines) > 1)}"
            parts.append(folded(f"{count} pruned by Laplace's evidence, and why", pruned))
        if len(repeats) > 1:
            parts.append(folded(f"All {len(repeats)} repeats", _table(run, signal, repeats)))
        return stack(*parts)


def _table(run: RunFolder, signal: str, repeats: Sequence[int]) -> Table:
    """Return every method's numbers of the models that were not pruned."""
    lines: list[Row] = []
    best = []
    for repeat in repeats:
        rows = rows_of(run.evidence, signal=signal, repeat=repeat)
        pruned = {r["model"] for r in rows if status_of(r["outcome"]) is Status.PRUNED}
        ranked = ranking(run, signal, repeat)
        order = [r["model"] for r in ranked.rows] if ranked else []
        best += [(repeat, model) for model in order[:1]]
        rows.sort(key=lambda r: order.index(r["model"]) if r["model"] in order else len(order))
        lines += [r for r in rows if r["model"] not in pruned]

    def diagnostic(r: Row) -> str:
        return (r["diagnostic"].replace(" -", " −") if r["outcome"] == OK else r["outcome"]) or fmt.NONE

    def kind(r: Row) -> str:
        return "quiet" if r["outcome"] != OK else "best" if (r["repeat"], r["model"]) in best else ""

    columns: dict[str, Callable[[Row], str]] = {"repeat": lambda r: str(r["repeat"] + 1)}
    columns = columns if len(repeats) > 1 else {}
    columns |= {
        "model": lambda r: words.model(r["model"]),
        "method": lambda r: words.method(r["method"]),
        "log evidence / nats": lambda r: fmt.nats(r["log_evidence"], r["stderr"]),
        "log Bayes factor": lambda r: fmt.nats(r["log_bayes_factor"]) if r["log_bayes_factor"] else "0",
        "probability": lambda r: fmt.probability(r["probability"]),
        "diagnostic": diagnostic,
    }
    left = [i for i, header in enumerate(columns) if header in ("model", "method", "diagnostic")]
    methods = {r["method"] for r in lines}
    captions = [text for method, text in (("combined", ADOPTED), ("smc", ANSWER)) if method in methods]
    return Table.of(lines, columns, left, " ".join(captions), kind)


def _pruned(run: RunFolder, signal: str, repeat: int) -> Table:
    """Return the models that were pruned, the most probable first, with their Laplace evidence if it is known."""
    rows = rows_of(run.evidence, signal=signal, repeat=repeat)
    why = {r["model"]: r["outcome"] for r in rows if status_of(r["outcome"]) is Status.PRUNED}
    laplace = {r["model"]: r for r in rows if r["method"] == "laplace"}

    def log_evidence(model: str) -> float:
        value = laplace[model]["log_evidence"] if model in laplace else math.nan
        return value if math.isfinite(value) else -math.inf

    columns: dict[str, Callable[[str], str]] = {
        "model": words.model,
        "log evidence / nats": lambda model: fmt.nats(laplace.get(model, {}).get("log_evidence")),
        "log Bayes factor": lambda model: fmt.nats(laplace.get(model, {}).get("log_bayes_factor")),
        "why": lambda model: reason_of(why[model]),
    }
    caption = "Laplace's approximation, for models whose mode was found before they were pruned."
    return Table.of(sorted(why, key=log_evidence, reverse=True), columns, (0, 3), caption)


PLUGIN = EvidenceSection()
