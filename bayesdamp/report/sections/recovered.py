"""Show whether model probabilities are calibrated, from a run of `bayesdamp calibrate --models`."""

from collections.abc import Callable, Mapping
from typing import Any

from bayesdamp import formatting as fmt
from bayesdamp.report import words
from bayesdamp.report.results.run import RunFolder
from bayesdamp.report.sections import Section, paragraph, stack

MODELS_EXPLAINED = (
    "A damping model is drawn from a uniform prior, its parameters are drawn from their priors, and a record is "
    "simulated. The noise levels and lengths of the records are chosen in advance, and the inference knows them. The "
    "evidence of every model gives its posterior probability. If these probabilities are correct, a model with "
    "probability p is the true one in a fraction p of the records.",
    "Records that show no oscillation are left out. This decision uses the record alone, so the probabilities remain "
    "valid.",
)


class RecoveredSection(Section):
    """The section on model probabilities: how often the most probable model is the true one, and how often expected."""

    order = 12
    title = "Are the models' probabilities calibrated?"

    def applies(self, run: RunFolder) -> bool:
        """Return whether the run is a model recovery (`bayesdamp calibrate --models`)."""
        return run.info.get("kind") == "model recovery"

    def render(self, run: RunFolder) -> str:
        """Return the section's HTML: how often the most probable model is the true one, and which ones are confused."""
        result = run.info["result"]
        own = result["recovery"]
        hits = own["hits"]
        inside = "inside" if hits["low"] <= hits["excess"] <= hits["high"] else "outside"
        low, excess, high = (fmt.fixed_decimals(hits[k], 1) for k in ("low", "excess", "high"))
        share = 100 * hits["hits"] / max(hits["records"], 1)
        interval = f"{100 * hits['share_low']:.1f} to {100 * hits['share_high']:.1f} %"
        claim = (
            f"The most probable model was the true one in {hits['hits']} of {hits['records']} records "
            f"({share:.1f} %, 95 % interval {interval}); {hits['expected']:.1f} are "
            f"expected from the models' probabilities. The difference of {excess} records is {inside} the "
            f"{100 * (1 - result['alarm']):g} % band that is expected by chance, {low} to {high}."
        )
        score, expected = (fmt.fixed_decimals(own[k], 3) for k in ("log_score", "log_score_expected"))
        reasons = "; ".join(f"{n} ({sentence})" for sentence, n in own["refused"].items())
        scores = (
            f"Mean natural-log probability of the true model: {score} nats ({expected} nats are expected from the "
            f"probabilities). Flagged as unreliable, but counted: "
            f"{own['doubtful']} of {own['evidences']} evidence values. Usable: {own['counted']} of {own['tried']} "
            "simulated records"
            f"{f'; left out: {reasons}' if reasons else ''}."
        )
        return stack(*map(paragraph, (*MODELS_EXPLAINED, claim, scores)), *_tables(own))


def _tables(result: Mapping[str, Any]) -> list[fmt.Table]:
    """Return the confusion matrix of the models, and a table that shows whether their probabilities are calibrated.

    result: the result of the model recovery in run.json. For groups of records with similar probabilities of the most
    probable model, the second table compares the mean of this probability with the fraction of records in which the
    model is the true one.
    """
    names = [words.model(m) for m in result["models"]]
    lines = [[name, *map(str, row)] for name, row in zip(names, result["confusion"], strict=True)]
    caption = "Number of simulated records, by true damping model (rows) and most probable one (columns)."
    confusion = fmt.Table(["", *names], lines, caption=caption)

    def fixed(name: str) -> Callable[[Mapping[str, Any]], str]:
        return lambda row: fmt.fixed_decimals(row[name], 3)

    by_probability: dict[str, Callable[[Mapping[str, Any]], str]] = {
        "probability of the most probable model": lambda b: f"{b['from']:g} to {b['to']:g}",
        "records": lambda b: str(b["records"]),
        "mean": fixed("probability"),
        "fraction correct": fixed("share"),
        **{name: fixed(name) for name in ("low", "high")},
        "p": lambda b: fmt.number(b["p"], 2),
        "p (Holm)": lambda b: fmt.number(b["p_holm"], 2),
    }
    caption = (
        "How often the most probable model is the true one, for records grouped by the probability of that model. "
        "Mean: the mean of this probability in the group. If the probabilities are correct, all fractions are between "
        "low and high with 99 % probability; rows outside are coloured. p: the p value of the difference between the "
        "fraction correct and the probabilities; p (Holm): this p value, corrected for the number of groups."
    )

    def kind(b: Mapping[str, Any]) -> str:
        return "" if b["low"] <= b["share"] <= b["high"] else "alert"

    return [confusion, fmt.Table.of(result["bins"], by_probability, (0,), caption, kind)]


PLUGIN = RecoveredSection()
