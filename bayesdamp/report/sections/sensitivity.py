"""The sensitivity of the evidence to the priors, to the part of the record, and to the noise model."""

from __future__ import annotations

import math
from collections.abc import Callable

from markupsafe import Markup

from bayesdamp import formatting as fmt
from bayesdamp.odds import FURTHER_TERM
from bayesdamp.report import words
from bayesdamp.report.markup import paragraph, stack
from bayesdamp.report.results.reading import EvidenceRanking, mode_of, models_by_rank, over_odds, ranking
from bayesdamp.report.results.run import RunFolder
from bayesdamp.report.sections import SignalSection
from bayesdamp.store import CellResult
from bayesdamp.store.contents import HalfContent, NoisesContent, RatiosContent, WidthsContent
from bayesdamp.table import Table, TableLine
from bayesdamp.types import OK

_ONE_NOISE = (
    'Other noise models are not computed under deviation = "law". There the deviations, and a larger variance of the '
    "noise near the oscillation, explain coloured residuals."
)
_NO_WIDTH = "No damping prior has a width that can be varied, because the scale of the default prior is averaged over."


class SensitivitySection(SignalSection):
    """Bayes factors of a signal's first repeat under other assumptions."""

    order = 62
    title = "What the evidence depends on"

    def shows(self, run: RunFolder, signal: str) -> bool:
        """Return whether evidence was computed under other assumptions too."""
        return any(cell.outcome == OK for cell in run.cells("sensitivity", signal))

    def part(self, run: RunFolder, signal: str) -> Markup:
        """Return Bayes factors by the priors' width, the part of the record, the noise and the prior odds."""
        models, ranked = models_by_rank(run, signal, 0), ranking(run, signal, 0)
        parts = [view(run, signal, models) for view in (_widths, _parts_and_noises)]
        parts.append(_halves(run, signal, models, ranked))
        if ranked:
            parts += [_odds(ranked), _ratios(run, signal, ranked)]
        return stack(*parts, paragraph(_ONE_NOISE, "small") if run.under_law else "")


def _cells(run: RunFolder, signal: str, models: list[str], kind: str) -> dict[str, CellResult]:
    cells = {m: run.cell("sensitivity", signal, 0, m, kind) for m in models}
    return {m: c for m, c in cells.items() if c is not None and c.outcome == OK}


def _widths(run: RunFolder, signal: str, models: list[str]) -> Table | Markup | None:
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
        f"Log Bayes factor (nats) to {words.model(best)} if the scales of all specified damping priors are multiplied "
        f"by this factor. The importance draws are reweighted, with at least {fmt.number(float(min(effective)), 2)} "
        "effective draws, or sampled again if these are too few. ?: the diagnostics are poor."
    )
    return Table.of(cells, columns, caption=caption)


def _odds(ranked: EvidenceRanking) -> Table | None:
    """Return the probability of each damping under other prior odds of further terms."""
    shares = over_odds(ranked)
    columns: dict[str, Callable[[str], str]] = {"damping": words.model}
    for factor, own in shares.items():
        columns[f"factor {fmt.number(factor, 3)}"] = lambda d, own=own: fmt.probability(own[d])
    caption = (
        "Probability of each damping if each further term multiplies the prior probability of a sum by this factor; "
        f"elsewhere in the report the factor is {fmt.number(FURTHER_TERM, 3)}."
    )
    return Table.of(ranked.dampings, columns, caption=caption) if shares else None


def _parts_and_noises(run: RunFolder, signal: str, models: list[str]) -> Table | None:
    """Return log Bayes factors from parts of the record, and under each noise model."""
    noises = _cells(run, signal, models, "noises")
    if run.under_law or len(_cells(run, signal, models, "widths")) < 2:
        return None
    rows: dict[str, dict[str, float]] = {}
    for model in models:
        mode = mode_of(run, signal, 0, model)
        windows = mode.windows if mode else ()
        logs = {w.label: w.log_evidence for w in windows if math.isfinite(w.log_evidence)}
        if not logs:
            continue
        if model in noises:
            under = NoisesContent.of(noises[model])
            for name, evidence in under.evidence.items():
                logs[f"{words.method(name)}{', chosen' * (name == under.chosen)}"] = evidence.log_evidence
        rows[model] = logs
    best: dict[str, float] = {}
    for label, log_evidence in (item for logs in rows.values() for item in logs.items()):
        best[label] = max(log_evidence, best.get(label, -math.inf))
    columns: dict[str, Callable[[str], str]] = {
        label: lambda model, label=label: fmt.fixed(rows[model].get(label, math.nan) - best[label], 1)
        for label, log_evidence in best.items()
        if math.isfinite(log_evidence)
    }
    caption = (
        "Log Bayes factors (nats) to the best of each column, by Laplace's approximation: from parts of the record, "
        "and from the whole record under each noise model (only for the more probable models)."
    )
    return Table.of(rows, {"model": words.model, **columns}, caption=caption) if columns else None


def _halves(run: RunFolder, signal: str, models: list[str], ranked: EvidenceRanking | None) -> Table | None:
    """Return the evidence from the first half of the record, as far as it was sampled, and its prediction."""
    halves = {m: HalfContent.of(cell) for m, cell in _cells(run, signal, models, "half").items()}
    if not halves:
        return None
    whole = {r["model"]: r["log_bayes_factor"] for r in ranked.rows} if ranked else {}
    logs = {
        m: math.nan if h.evidence.log_evidence is None else h.evidence.log_evidence for m, h in halves.items()
    }
    best = max(logs.values())
    # A density that is not reliable is not stored.
    densities = [h.log_predictive for h in halves.values() if math.isfinite(h.log_predictive)]
    highest = max(densities, default=math.nan)
    columns: dict[str, Callable[[str], str]] = {
        "model": words.model,
        "log Bayes factor": lambda m: fmt.nats(whole.get(m)),
        "from the first half": lambda m: fmt.nats(logs[m] - best, halves[m].evidence.stderr),
        "error / expected": lambda m: fmt.number(halves[m].rms / halves[m].expected, 3),
        "inside 95 %": lambda m: f"{100 * halves[m].coverage:.0f} %",
        "log predictive density": lambda m: fmt.nats(
            halves[m].log_predictive - highest, halves[m].log_predictive_stderr
        ),
        "diagnostic": lambda m: halves[m].evidence.diagnostic,
    }
    caption = (
        "Results from the first half of the record alone: the log Bayes factors, and how well each model predicts the "
        "second half: its rms error over the expected error, the share of samples inside their 95 % interval, and the "
        "log density of the second half given the first, relative to the best (nats)."
    )

    def kind(model: str) -> str:
        return "" if halves[model].evidence.outcome == OK else "alert"

    return Table.of(halves, columns, (0, 6), caption, kind)


def _ratios(run: RunFolder, signal: str, ranked: EvidenceRanking) -> Table | None:
    """Return the Savage–Dickey ratios of nested pairs."""
    rows = {frozenset(r["model"].split("+")): r for r in ranked.rows}
    cells = _cells(run, signal, [r["model"] for r in ranked.rows], "savage_dickey")
    lines = []
    for model, cell in cells.items():
        for smaller, factor in RatiosContent.of(cell).against.items():
            first, second = (rows.get(frozenset(m.split("+"))) for m in (smaller, model))
            if first is None or second is None:
                continue
            valid = factor.outcome == OK
            difference = first["log_evidence"] - second["log_evidence"]
            cells_of_line = [
                f"{words.model(smaller)} to {words.model(model)}",
                fmt.nats(factor.log_bayes_factor, factor.stderr) if valid else fmt.NONE,
                fmt.nats(difference, math.hypot(first["stderr"], second["stderr"])),
                factor.outcome,
            ]
            lines.append(TableLine(cells_of_line, "" if valid else "quiet"))
    caption = (
        "A third check of nested pairs: the log Bayes factor by the Savage–Dickey ratio, which is the posterior "
        "density of the larger model where the term is zero over its prior density, and the difference of the log "
        "evidences."
    )
    headers = ["pair", "Savage–Dickey / nats", "evidence / nats", "outcome"]
    return Table(headers, lines, (0, 3), caption) if lines else None


PLUGIN = SensitivitySection()
