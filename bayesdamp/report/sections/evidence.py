"""Show the evidence of each damping model, how it depends on the assumptions, and the priors."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace

from markupsafe import Markup

from bayesdamp import formatting as fmt
from bayesdamp.formatting import Table, TableLine
from bayesdamp.outcomes import Status, status_of
from bayesdamp.priors import FURTHER_TERM, LEAST_SCALE, MOST_SCALE, OTHER_FORMS_ODDS, SharedHalfNormal
from bayesdamp.report import words
from bayesdamp.report.results.run import (
    EvidenceRanking,
    Row,
    RunFolder,
    mode_of,
    models_by_rank,
    only_answered,
    probabilities_by_odds,
    rank_models,
    rows_of,
)
from bayesdamp.report.sections import (
    SignalSection,
    bullets,
    by_signal,
    collapsible,
    paragraph,
    repeat_column,
    stack,
)
from bayesdamp.store import TaskResult
from bayesdamp.store.contents import HalfContent, NoisesContent, RatiosContent, WidthsContent
from bayesdamp.types import OK

EVIDENCE = (
    "Natural-log evidence of each model by each method, with its standard error (±); log Bayes factor (nats) relative "
    "to the best model by the same method; posterior probability among the models of this table; and a diagnostic of "
    "how reliable the computation is. Bold: the best model. Grey: a value that is unreliable or was not computed."
)
PRUNED = (
    "Models that were left out of further computations, because they are much less probable than the best one. The "
    "last column gives the reason for each method that was not run. The evidence by Laplace's approximation is shown "
    "if the posterior mode had been found before."
)
ADOPTED = (
    'The "adopted evidence" is that of nested sampling if it was computed as a check, otherwise the mean of the other '
    "methods, weighted by inverse variance. Nested sampling is computed if the study requires it, or if the other "
    "methods are unreliable or differ by more than three standard errors."
)
ANSWER = (
    "The answer uses the evidence from sequential Monte Carlo. This method takes the noise variance as known, "
    "which shifts the log evidence of all models by the same amount. If it averages a long record in short blocks, it "
    "also penalises models that fit badly less than the other methods do. Therefore compare log Bayes factors within "
    "one method only."
)
_ONE_NOISE = (
    'With the setting deviation = "law" the evidence is computed for one noise model only. Deviations, and a larger '
    "noise variance near the oscillation frequency, then account for coloured residuals."
)
_NO_WIDTH = "No damping prior has a width that can be varied: the scale of default priors is unknown and averaged out."
COMPARED = (
    "All single damping terms have the same prior probability; each further term of a sum multiplies the probability "
    f"by {FURTHER_TERM:g}. All restoring laws have the same prior probability."
)
OTHER_FORMS = (
    f"All other forms of damping together are {OTHER_FORMS_ODDS:g} times as probable as one single term."
)
COMMON_SCALE = (
    "The damping terms of a model have half-normal priors on their equivalent damping ratios. Their common scale is "
    f"unknown, with a log-uniform prior between {LEAST_SCALE:g} and {MOST_SCALE:g}, so the evidence does not depend on "
    "how small the damping is."
)
WIDE_PRIOR = (
    "A parameter has the same prior in every model that contains it. If you specify a prior that is wider by a factor, "
    "the log evidence of the models with this parameter decreases by about the logarithm of the factor."
)


PRIORS = (
    "Prior of each inferred parameter, in the units of the equation of motion (rad or m, and s), and the models that "
    "have it."
)


class EvidenceSection(SignalSection):
    """The section with the evidence of each model by every method."""

    order = 60
    name = "evidence"
    title = "Evidence of the damping models"
    lead = (
        "The evidence of a model is the probability with which it predicts the record, averaged over the prior of its "
        "parameters. A log "
        "Bayes factor of one nat is hardly worth mentioning, three nats are positive evidence, and five or more are "
        "strong, if the noise model is correct and the priors below are accepted."
    )

    def shows(self, run: RunFolder, signal: str) -> bool:
        """Return whether the study computed evidence of its own models, and not only the answer."""
        return any(r["signal"] == signal for r in run.evidence) and not only_answered(run)

    def part(self, run: RunFolder, signal: str) -> Markup:
        """Return a table of log Bayes factors by method, and a folded one of the models that were pruned."""
        rows = rows_of(run.evidence, signal=signal)
        pruned = {(r["repeat"], r["model"]) for r in rows if status_of(r["outcome"]) is Status.PRUNED}
        kept = [r for r in rows if (r["repeat"], r["model"]) not in pruned]
        left_out = [r for r in rows if (r["repeat"], r["model"]) in pruned]
        table = _table(run, signal, kept)
        if not pruned:
            return stack(table)
        count = len({model for _, model in pruned})
        title = f"Not computed further: {count} model{'s' * (count > 1)}, and why"
        return stack(table, collapsible(title, replace(_table(run, signal, left_out), caption=PRUNED)))


def _table(run: RunFolder, signal: str, rows: Sequence[Row]) -> Table:
    """Return a table of rows of evidence.csv on a record, by repeat and rank."""
    repeats = run.repeats(signal)
    ranked = {repeat: rank_models(run, signal, repeat) for repeat in repeats}
    order = {i: [row["model"] for row in ranking.rows] if ranking else [] for i, ranking in ranked.items()}

    def rank(r: Row) -> tuple[int, int]:
        models = order[r["repeat"]]
        return r["repeat"], models.index(r["model"]) if r["model"] in models else len(models)

    def diagnostic(r: Row) -> str:
        return (r["diagnostic"].replace(" -", " −") if r["outcome"] == OK else r["outcome"]) or fmt.NONE

    def kind(r: Row) -> str:
        return "quiet" if r["outcome"] != OK else "best" if order[r["repeat"]][:1] == [r["model"]] else ""

    columns: dict[str, Callable[[Row], str]] = {
        **repeat_column(repeats),
        "model": lambda r: words.model(r["model"]),
        "method": lambda r: words.method(r["method"]),
        "log evidence / nats": lambda r: fmt.nats(r["log_evidence"], r["stderr"]),
        "log Bayes factor": lambda r: fmt.nats(r["log_bayes_factor"]) if r["log_bayes_factor"] else "0",
        "probability": lambda r: fmt.probability(r["probability"]),
        "diagnostic": diagnostic,
    }
    methods = {r["method"] for r in rows}
    captions = [EVIDENCE, ADOPTED * ("combined" in methods), ANSWER * ("smc" in methods)]
    left = (len(columns) - 6, len(columns) - 5, len(columns) - 1)
    return Table.of(sorted(rows, key=rank), columns, left, " ".join(filter(None, captions)), kind)


class SensitivitySection(SignalSection):
    """The section with the Bayes factors of a signal's first repeat under other assumptions."""

    order = 62
    name = "sensitivity"
    title = "What the evidence depends on"

    def shows(self, run: RunFolder, signal: str) -> bool:
        """Return whether the evidence was also computed under other assumptions, such as wider priors."""
        return any(task_result.outcome == OK for task_result in run.task_results("sensitivity", signal))

    def part(self, run: RunFolder, signal: str) -> Markup:
        """Return Bayes factors for other prior widths, parts of the record, noise models and prior odds."""
        models, ranked = models_by_rank(run, signal, 0), rank_models(run, signal, 0)
        parts: list[object] = [
            _widths(run, signal, models),
            _parts_and_noises(run, signal, models),
            _halves(run, signal, models, ranked),
        ]
        shares = probabilities_by_odds(ranked) if ranked else {}
        if ranked and shares:
            columns: dict[str, Callable[[str], str]] = {"damping": words.model}
            for factor, own in shares.items():
                columns[f"factor {fmt.number(factor, 3)}"] = lambda d, own=own: fmt.probability(own[d])
            caption = (
                "Posterior probability of each damping model if each term after the first multiplies the model's prior "
                "probability by the factor in the column's header. The rest of the report uses the factor "
                f"{fmt.number(FURTHER_TERM, 3)}."
            )
            parts.append(Table.of(ranked.dampings, columns, caption=caption))
        if ranked:
            parts.append(_ratios(run, signal, ranked))
        return stack(*parts, paragraph(_ONE_NOISE, "small") if run.under_law else "")


def _cells(run: RunFolder, signal: str, models: list[str], kind: str) -> dict[str, TaskResult]:
    """Return the results of one kind of sensitivity task for the first repeat, by model, if their outcome is `ok`.

    The kinds are "widths" (wider and narrower priors), "noises" (each noise model), "half" (the first half of the
    record) and "savage_dickey" (density ratios of nested models).
    """
    task_results = {m: run.task_result("sensitivity", signal, 0, m, kind) for m in models}
    return {m: c for m, c in task_results.items() if c is not None and c.outcome == OK}


def _widths(run: RunFolder, signal: str, models: list[str]) -> Table | Markup | None:
    """Return a table of log Bayes factors under wider and narrower priors; None for fewer than two models.

    They are relative to the first of `models` with results. If no model has a prior whose width can be varied, return a
    sentence that says so.
    """
    task_results = _cells(run, signal, models, "widths")
    if len(task_results) < 2:
        return None
    if not any(WidthsContent.of(task_result).varied for task_result in task_results.values()):
        return paragraph(_NO_WIDTH)
    best = next(iter(task_results))
    reference = task_results[best].arrays["log_evidence"]

    def factor(model: str, i: int) -> str:
        arrays = task_results[model].arrays
        doubt = "" if arrays["trusted"][i] else " ?"
        return fmt.nats(float(arrays["log_evidence"][i] - reference[i])) + doubt

    columns: dict[str, Callable[[str], str]] = {"model": words.model}
    for i, width in enumerate(task_results[best].arrays["factors"]):
        columns[f"× {fmt.number(float(width), 2)}"] = lambda model, i=i: factor(model, i)
    effective = [
        c.arrays["effective"][~c.arrays["anew"]].min(initial=math.inf) for c in task_results.values()
    ]
    caption = (
        f"Log Bayes factor (nats) relative to {words.model(best)} if the scales of all specified damping priors are "
        "multiplied by the factor in the column's header. The draws of importance sampling are reweighted (effective "
        f"sample size at least {fmt.number(float(min(effective)), 2)}); where that is not enough, new draws are made. "
        'A "?" marks a value whose diagnostics are poor.'
    )
    return Table.of(task_results, columns, caption=caption)


def _parts_and_noises(run: RunFolder, signal: str, models: list[str]) -> Table | None:
    """Return a table of log Bayes factors from parts of the record, and under each noise model.

    They are in nats relative to the best model of the column. None for a study with deviations, for fewer than two
    models with evidence under other widths, or without values.
    """
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
        label: lambda model, label=label: fmt.fixed_decimals(
            rows[model].get(label, math.nan) - best[label], 1
        )
        for label, log_evidence in best.items()
        if math.isfinite(log_evidence)
    }
    caption = (
        "Log Bayes factors (nats) of the models by Laplace's approximation, each relative to the best model of its "
        "column: first from parts of the record, then from the whole record under each noise model (only for the more "
        "probable models)."
    )
    return Table.of(rows, {"model": words.model, **columns}, caption=caption) if columns else None


def _halves(run: RunFolder, signal: str, models: list[str], ranked: EvidenceRanking | None) -> Table | None:
    """Return a table of the evidence from the first half of the record, and of how well it predicts the second half.

    Log Bayes factors and log predictive densities are in nats, relative to the best model. None if there are no results
    of the task `half`.
    """
    halves = {
        m: HalfContent.of(task_result) for m, task_result in _cells(run, signal, models, "half").items()
    }
    if not halves:
        return None
    whole = {r["model"]: r["log_bayes_factor"] for r in ranked.rows} if ranked else {}
    logs = {
        m: math.nan if h.evidence.log_evidence is None else h.evidence.log_evidence for m, h in halves.items()
    }
    best = max(logs.values())
    # Only reliable predictive densities are stored.
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
        "Log Bayes factors (nats) from the whole record and from its first half alone, and how well each model, "
        "fitted to the first half, predicts the second: the root mean square error divided by the expected one, the "
        "percentage of samples inside their 95 % prediction interval, and the log density of the second half given "
        "the first, relative to the best model (nats). Coloured: the evidence from the first half is unreliable."
    )

    def kind(model: str) -> str:
        return "" if halves[model].evidence.outcome == OK else "alert"

    return Table.of(halves, columns, (0, 6), caption, kind)


def _ratios(run: RunFolder, signal: str, ranked: EvidenceRanking) -> Table | None:
    """Return a table of Savage–Dickey density ratios of nested models, as log Bayes factors in nats; None without any.

    The difference of the models' log evidence is in the next column.
    """
    rows = {frozenset(r["model"].split("+")): r for r in ranked.rows}
    task_results = _cells(run, signal, [r["model"] for r in ranked.rows], "savage_dickey")
    lines = []
    for model, task_result in task_results.items():
        for smaller, factor in RatiosContent.of(task_result).against.items():
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
        "A check of the evidence for pairs of nested models: the log Bayes factor of the smaller model against the "
        "larger, computed in two ways, which should agree. "
        "Savage–Dickey: the logarithm of the larger model's posterior density at zero coefficient, divided by its "
        "prior density there. Evidence: the log evidence of the smaller model minus that of the larger."
    )
    headers = ["pair", "Savage–Dickey / nats", "evidence / nats", "outcome"]
    return Table(headers, lines, (0, 3), caption) if lines else None


class PriorsSection(SignalSection):
    """The section with the priors of each signal. Equal priors of a parameter are listed once, with their models."""

    order = 80
    name = "priors"
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
        sentences = [COMPARED, OTHER_FORMS * only_answered(run), COMMON_SCALE * is_shared, WIDE_PRIOR]
        return stack(
            paragraph(" ".join(filter(None, sentences))), by_signal(run, self.part, signals), assumed
        )

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


PLUGINS = (EvidenceSection(), SensitivitySection(), PriorsSection())
