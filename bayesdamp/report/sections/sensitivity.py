"""What the evidence depends on: the priors' width and odds, half the record, and a third check."""

from __future__ import annotations

import math
from collections.abc import Callable

from markupsafe import Markup

from bayesdamp import formatting as fmt
from bayesdamp.odds import FURTHER_TERM
from bayesdamp.report import words
from bayesdamp.report.html import paragraph, stack
from bayesdamp.report.results.reading import Ranking, mode_of, models_by_rank, over_odds, ranking
from bayesdamp.report.results.run import Run
from bayesdamp.report.sections._layout import SignalSection
from bayesdamp.store import CellResult
from bayesdamp.store.contents import HalfContent, NoisesContent, RatiosContent, WidthsContent
from bayesdamp.table import Line, Table
from bayesdamp.types import OK

_ONE_NOISE = (
    'Other noise models are not computed under deviation = "law": what is coloured in the rest is taken by the '
    "deviations there, and by a variance of the noise that is larger near the oscillation."
)


_NO_WIDTH = "No damping prior has a width to vary here: the scale of the default prior is averaged over."


class Sensitivity(SignalSection):
    """Of a signal's first repeat: Bayes factors over prior widths, the first half, Savage and Dickey."""

    order = 62
    title = "What the evidence depends on"

    def shows(self, run: Run, signal: str) -> bool:
        """Return whether a signal was weighed under other assumptions too."""
        return any(cell.outcome == OK for cell in run.cells("sensitivity", signal))

    def part(self, run: Run, signal: str) -> Markup:
        """Return prior widths, odds, halves and other noise."""
        models = models_by_rank(run, signal, 0)
        found = ranking(run, signal, 0)
        views = (_widths, _elsewhere, _halves)
        parts = [view(run, signal, models) for view in views]
        if found:
            parts += [_odds(found), _ratios(run, signal, found)]
        return stack(*parts, paragraph(_ONE_NOISE, "small") if run.under_law else "")


def _cells(run: Run, signal: str, models: list[str], kind: str) -> dict[str, CellResult]:
    found = {m: run.cell("sensitivity", signal, 0, m, kind) for m in models}
    return {m: c for m, c in found.items() if c is not None and c.outcome == OK}


def _widths(run: Run, signal: str, models: list[str]) -> Table | Markup | None:
    """Return log Bayes factors under priors of other widths."""
    cells = _cells(run, signal, models, "widths")
    if len(cells) < 2:
        return None
    if not any(WidthsContent.of(cell).varied for cell in cells.values()):
        return paragraph(_NO_WIDTH)
    best = next(iter(cells))
    reference = cells[best].arrays["log_evidence"]

    def factor(model: str, i: int) -> str:
        arrays = cells[model].arrays
        doubt = "" if arrays["trusted"][i] else " ?"
        return fmt.nats(float(arrays["log_evidence"][i] - reference[i])) + doubt

    columns: dict[str, Callable[[str], str]] = {"model": words.model}
    for i, width in enumerate(cells[best].arrays["factors"]):
        columns[f"× {fmt.number(float(width), 2)}"] = lambda model, i=i: factor(model, i)
    effective = [c.arrays["effective"][~c.arrays["anew"]].min(initial=math.inf) for c in cells.values()]
    caption = (
        f"Log Bayes factor (nats) to {words.model(best)} as the scales of all given damping priors are multiplied: the "
        f"importance draws reweighted, of which {fmt.number(float(min(effective)), 2)} or more are effective, or "
        "sampled again where these are too few. ?: the diagnostics are poor."
    )
    return Table.of(cells, columns, caption=caption)


def _odds(found: Ranking) -> Table | None:
    """Return the probability of each damping under other prior odds of further terms."""
    shares = over_odds(found)
    columns: dict[str, Callable[[str], str]] = {"damping": words.model}
    for factor, own in shares.items():
        columns[f"factor {fmt.number(factor, 3)}"] = lambda d, own=own: fmt.probability(own[d])
    caption = (
        "Probability of each damping where each further term makes a sum so many times as probable before the record "
        f"is seen; everywhere else here the factor is {fmt.number(FURTHER_TERM, 3)}."
    )
    return Table.of(found.dampings, columns, caption=caption) if shares else None


def _elsewhere(run: Run, signal: str, models: list[str]) -> Table | None:
    """Over windows of the record, and under each noise model."""
    found: dict[str, dict[str, float]] = {}
    noises = _cells(run, signal, models, "noises")
    if run.under_law or len(_cells(run, signal, models, "widths")) < 2:
        return None
    for model in models:
        mode = mode_of(run, signal, 0, model)
        windows = mode.windows if mode else ()
        of_parts = {w.label: w.log_evidence for w in windows if math.isfinite(w.log_evidence)}
        if not of_parts:
            continue
        found[model] = of_parts
        if model in noises:
            under = NoisesContent.of(noises[model])
            found[model] |= {
                f"{words.method(n)}{', chosen' * (n == under.chosen)}": e.log_evidence
                for n, e in under.evidence.items()
            }
    best: dict[str, float] = {}
    for label, log_evidence in (item for logs in found.values() for item in logs.items()):
        best[label] = max(log_evidence, best.get(label, -math.inf))
    headers = [label for label, log_evidence in best.items() if math.isfinite(log_evidence)]
    if not headers:
        return None
    lines = [
        Line([words.model(model), *(fmt.fixed(logs.get(h, math.nan) - best[h], 1) for h in headers)])
        for model, logs in found.items()
    ]
    caption = (
        "Log Bayes factors (nats) to the best of each column, by Laplace's approximation: of parts of the record, "
        "and of all of it under each noise model (the likelier models only)."
    )
    return Table(["model", *headers], lines, frozenset({0}), caption)


def _halves(run: Run, signal: str, models: list[str]) -> Table | None:
    """Return what the first half of the record says, as far as it was sampled, and how it predicts the second."""
    halves = {m: HalfContent.of(cell) for m, cell in _cells(run, signal, models, "half").items()}
    if not halves:
        return None
    found = ranking(run, signal, 0)
    whole = {r["model"]: r["log_bayes_factor"] for r in found.rows} if found else {}
    logs = {
        m: math.nan if h.evidence.log_evidence is None else h.evidence.log_evidence for m, h in halves.items()
    }
    best = max(logs.values())
    # What is not to be trusted has no density.
    ahead = max(
        (h.log_predictive for h in halves.values() if math.isfinite(h.log_predictive)), default=math.nan
    )
    columns: dict[str, Callable[[tuple[str, HalfContent]], str]] = {
        "model": lambda half: words.model(half[0]),
        "log Bayes factor": lambda half: fmt.nats(whole.get(half[0])),
        "from the first half": lambda half: fmt.nats(logs[half[0]] - best, half[1].evidence.stderr),
        "error / expected": lambda half: fmt.number(half[1].rms / half[1].expected, 3),
        "inside 95 %": lambda half: f"{100 * half[1].coverage:.0f} %",
        "log predictive density": lambda half: fmt.nats(
            half[1].log_predictive - ahead, half[1].log_predictive_stderr
        ),
        "diagnostic": lambda half: half[1].evidence.diagnostic,
    }
    caption = (
        "The first half of the record alone: what it says of the models, and how well it predicts the second half. "
        "Error (rms) in units of what its interval expects, share of the samples inside their 95 % interval, and log "
        "density of the second half given the first, against the best (nats)."
    )
    return Table.of(
        halves.items(),
        columns,
        (0, 6),
        caption,
        lambda half: "" if half[1].evidence.outcome == OK else "alert",
    )


def _ratios(run: Run, signal: str, found: Ranking) -> Table | None:
    logs = {frozenset(r["model"].split("+")): r for r in found.rows}
    cells = _cells(run, signal, [r["model"] for r in found.rows], "savage_dickey")
    lines = []
    for model, cell in cells.items():
        for smaller, factor in RatiosContent.of(cell).against.items():
            one, other = (logs.get(frozenset(m.split("+"))) for m in (smaller, model))
            if one is None or other is None:
                continue
            valid = factor.outcome == OK
            weighed = one["log_evidence"] - other["log_evidence"], math.hypot(one["stderr"], other["stderr"])
            shown = [
                f"{words.model(smaller)} to {words.model(model)}",
                fmt.nats(factor.log_bayes_factor, factor.stderr) if valid else fmt.NONE,
                fmt.nats(*weighed),
                factor.outcome,
            ]
            lines.append(Line(shown, "" if valid else "quiet"))
    caption = (
        "A third check of nested pairs: the log Bayes factor by Savage and Dickey, from the density of the larger "
        "model's posterior where the term is zero, beside the difference of the log evidences."
    )
    headers = ["pair", "Savage–Dickey / nats", "evidence / nats", "outcome"]
    return Table(headers, lines, (0, 3), caption) if lines else None


PLUGIN = Sensitivity()
