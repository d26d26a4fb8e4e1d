"""Show the evidence of each damping model, and how it depends on the prior odds."""

from collections.abc import Callable, Sequence
from dataclasses import replace

from markupsafe import Markup

from bayesdamp import formatting as fmt
from bayesdamp.priors import FURTHER_TERM
from bayesdamp.report import words
from bayesdamp.report.results.run import Row, RunFolder, probabilities_by_odds, rank_models, rows_of
from bayesdamp.report.sections import SignalSection, collapsible, repeat_column, stack
from bayesdamp.types import OK, Status, status_of

EVIDENCE = (
    "Natural-log evidence of each model by each method, with its standard error (±); log Bayes factor (nats) relative "
    "to the best model by the same method; posterior probability among the models of this table; and a diagnostic of "
    "how reliable the computation is. Bold: the best model. Grey: a value that is unreliable or was not computed."
)
PRUNED = (
    "Models that were left out of further computations, because they are much less probable than the best one. The "
    "last column gives the reason for each method that was not run."
)
ADOPTED = (
    'The "adopted evidence" is from nested sampling if this was run as a check, otherwise it is the mean of the other '
    "methods, weighted by inverse variance. Nested sampling is computed if the study requires it, or if the other "
    "methods are unreliable or differ by more than three standard errors."
)
ANSWER = (
    "The verdict on the kind of damping uses the evidence from sequential Monte Carlo. This method assumes that the "
    "noise variance is known, which shifts the log evidence of all models by the same amount. If a long record is "
    "averaged over short windows, this method also penalises a bad fit less than the other methods do. Therefore "
    "compare log Bayes factors only within one method."
)
ODDS = (
    "Posterior probability of each damping model if each term after the first multiplies the model's prior "
    "probability by the factor in the column's header. The rest of the report uses the factor "
    f"{fmt.number(FURTHER_TERM, 3)}."
)


class EvidenceSection(SignalSection):
    """The section with the evidence of each model by every method."""

    order = 60
    title = "Evidence of the damping models"
    lead = (
        "The evidence of a model is the probability with which it predicts the record, averaged over the prior of its "
        "parameters. A log "
        "Bayes factor of one nat is hardly worth mentioning, three nats are positive evidence, and five or more are "
        "strong, if the noise model is correct and the priors below are accepted."
    )

    def shows(self, run: RunFolder, signal: str) -> bool:
        """Return whether the run has evidence on `signal`; False if it contains only answers (`only_answered`)."""
        return any(r["signal"] == signal for r in run.evidence) and not run.only_answered

    def part(self, run: RunFolder, signal: str) -> Markup:
        """Return tables of each model's evidence, of models that were left out, and of probabilities by prior odds."""
        rows = rows_of(run.evidence, signal=signal)
        pruned = {(r["repeat"], r["model"]) for r in rows if status_of(r["outcome"]) is Status.PRUNED}
        kept = [r for r in rows if (r["repeat"], r["model"]) not in pruned]
        left_out = [r for r in rows if (r["repeat"], r["model"]) in pruned]
        parts: list[object] = [_table(run, signal, kept)]
        if pruned:
            count = len({model for _, model in pruned})
            title = f"Not computed further: {count} model{'s' * (count > 1)}, and why"
            parts.append(collapsible(title, replace(_table(run, signal, left_out), caption=PRUNED)))
        ranked = rank_models(run, signal, 0)
        shares = probabilities_by_odds(ranked) if ranked else {}
        if ranked and shares:  # else all damping models have the same number of terms
            columns: dict[str, Callable[[str], str]] = {"damping": words.model}
            for factor, own in shares.items():
                columns[f"factor {fmt.number(factor, 3)}"] = lambda d, own=own: fmt.probability(own[d])
            parts.append(fmt.Table.of(ranked.dampings, columns, caption=ODDS))
        return stack(*parts)


def _table(run: RunFolder, signal: str, rows: Sequence[Row]) -> fmt.Table:
    """Return a table of rows of evidence.csv on a record, sorted by repeat and by the rank of the model."""
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
    return fmt.Table.of(sorted(rows, key=rank), columns, left, " ".join(filter(None, captions)), kind)


PLUGIN = EvidenceSection()
