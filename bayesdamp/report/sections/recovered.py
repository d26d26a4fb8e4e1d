"""The calibration of the models' probabilities: confusion, reliability, log score."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

from bayesdamp import formatting as fmt
from bayesdamp.report import words
from bayesdamp.report.markup import heading, paragraph, stack
from bayesdamp.report.results.run import RunFolder
from bayesdamp.report.sections import Section
from bayesdamp.table import Table

SERIES = {
    "recovery": "All models, over noise and length",
    "single": "Single dampings that lose a good part of their amplitude",
}
EXPLAINED = (
    "A model is drawn from the uniform prior, its parameters are drawn from their priors, and a record is simulated. "
    "The noise level and the length are part of a design that the inference knows. The evidence of every model gives "
    "probabilities. If they are correct, the most probable model is the true one as often as its probability says.",
    "Records that show no oscillation are left out. This decision uses the record alone, so the probabilities remain "
    "valid.",
)


class RecoveredSection(Section):
    """Hits against the expected number by the probabilities, for all models and for single dampings."""

    order = 12
    title = "Are the models' probabilities calibrated?"

    def applies(self, run: RunFolder) -> bool:
        """Return whether the run is a model recovery."""
        return run.info.get("kind") == "model recovery"

    def render(self, run: RunFolder) -> str:
        """Return expected against observed probabilities, and the confusion of models."""
        result = run.info["result"]
        parts: list[object] = [paragraph(sentence) for sentence in EXPLAINED]
        for name, title in SERIES.items():
            if name in result:
                parts += [heading(title), *_series(result[name], result["alarm"])]
        return stack(*parts)


def _series(result: Mapping[str, Any], alarm: float) -> list[object]:
    hits = result["hits"]
    inside = "inside" if hits["low"] <= hits["excess"] <= hits["high"] else "outside"
    share = hits["hits"] / max(hits["records"], 1)
    claim = (
        f"The most probable model was the true one in {hits['hits']} of {hits['records']} records "
        f"({100 * share:.1f} %, 95 % interval {100 * hits['share_low']:.1f} to {100 * hits['share_high']:.1f} %); "
        f"{hits['expected']:.1f} are expected from the probabilities. The difference of {fmt.fixed(hits['excess'], 1)} "
        f"is {inside} its {100 * (1 - alarm):g} % band, {fmt.fixed(hits['low'], 1)} to {fmt.fixed(hits['high'], 1)}."
    )
    own, expected, ignorant = (fmt.fixed(result[f"log_score{k}"], 3) for k in ("", "_expected", "_ignorant"))
    reasons = "; ".join(f"{n}: {sentence}" for sentence, n in result["refused"].items())
    score = (
        f"Mean log score {own} nats; {expected} is expected from the probabilities, and a uniform guess gives "
        f"{ignorant}. {result['doubtful']} of {result['evidences']} evidences were unreliable by their own diagnostic; "
        f"they are included. {result['counted']} of {result['tried']} simulated records are included"
        f"{f' ({reasons})' if reasons else ''}."
    )
    return [paragraph(claim), paragraph(score), *_tables(result)]


def _tables(result: Mapping[str, Any]) -> list[Table]:
    """Return the confusion of models, and the reliability by probability, by model and by design."""
    names = [words.model(m) for m in result["models"]]
    lines = [[name, *map(str, row)] for name, row in zip(names, result["confusion"], strict=True)]
    caption = "Number of records, by true model (rows) and most probable model (columns)"
    confusion = Table(["", *names], lines, caption=caption)
    p_values: dict[str, Callable[[Mapping[str, Any]], str]] = {
        "p": lambda row: fmt.number(row["p"], 2),
        "p (Holm)": lambda row: fmt.number(row["p_holm"], 2),
    }
    by_probability: dict[str, Callable[[Mapping[str, Any]], str]] = {
        "probability of the best": lambda b: f"{b['from']:g} to {b['to']:g}",
        "records": lambda b: str(b["records"]),
        "mean": lambda b: fmt.fixed(b["probability"], 3),
        "share correct": lambda b: fmt.fixed(b["share"], 3),
        "low": lambda b: fmt.fixed(b["low"], 3),
        "high": lambda b: fmt.fixed(b["high"], 3),
        **p_values,
    }
    caption = (
        "Share of correct models against the probability of the most probable model. If the probabilities are correct, "
        "all shares are between low and high with 99 % probability."
    )
    bins = Table.of(
        result["bins"],
        by_probability,
        (0,),
        caption,
        lambda b: "" if b["low"] <= b["share"] <= b["high"] else "alert",
    )
    by_model: dict[str, Callable[[Mapping[str, Any]], str]] = {
        "model": lambda m: words.model(m["model"]),
        "records": lambda m: str(m["true"]),
        "sum of its probabilities": lambda m: fmt.fixed(m["expected"], 1),
        **p_values,
    }
    by_design: dict[str, Callable[[Mapping[str, Any]], str]] = {
        "noise": lambda d: f"{100 * d['noise']:g} %",
        "cycles": lambda d: fmt.given(d["cycles"]),
        "records": lambda d: str(d["records"]),
        "share correct": lambda d: fmt.fixed(d["share"], 3),
        "mean probability of the best": lambda d: fmt.fixed(d["probability"], 3),
    }
    designs = [Table.of(result["by_design"], by_design)] if len(result["by_design"]) > 1 else []
    return [confusion, bins, Table.of(result["by_model"], by_model), *designs]


PLUGIN = RecoveredSection()
