"""Whether the models' probabilities are what they say: confusion, reliability, log score."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

from markupsafe import Markup

from bayesdamp import formatting as fmt
from bayesdamp.report import words
from bayesdamp.report.html import paragraph, stack
from bayesdamp.report.results.run import Run
from bayesdamp.report.sections._layout import Section
from bayesdamp.table import Table

SERIES = {
    "recovery": "All models, over noise and length",
    "single": "Single dampings that lose a good part of their amplitude",
}
EXPLAINED = (
    "A model is drawn from the uniform prior, its parameters from theirs, and a record is simulated; noise level and "
    "length are a design that the inference knows. The evidence of every model gives probabilities. If these are "
    "right, the most probable model is the true one as often as its probability says.",
    "Records that show no oscillation are left out by a look at the record alone, which leaves probabilities as they "
    "are.",
)


class Recovered(Section):
    """Hits against what the probabilities promise, for all models and for single dampings."""

    order = 12
    title = "Are the models' probabilities what they say?"

    def applies(self, run: Run) -> bool:
        """In the report of a model recovery."""
        return run.info.get("kind") == "model recovery"

    def render(self, run: Run) -> str:
        """Promised against observed probabilities, and the confusion of models."""
        result = run.info["result"]
        parts: list[object] = [paragraph(sentence) for sentence in EXPLAINED]
        for name, title in SERIES.items():
            if name in result:
                parts.append(Markup("<h3>{}</h3>").format(title))
                parts += _series(result[name], result["alarm"])
        return stack(*parts)


def _series(found: Mapping[str, Any], alarm: float) -> list[object]:
    hits = found["hits"]
    inside = "inside" if hits["low"] <= hits["excess"] <= hits["high"] else "outside"
    share = hits["hits"] / max(hits["records"], 1)
    claim = (
        f"The most probable model was the true one in {hits['hits']} of {hits['records']} records "
        f"({100 * share:.1f} %, 95 % interval {100 * hits['share_low']:.1f} to {100 * hits['share_high']:.1f} %); "
        f"the probabilities promised {hits['expected']:.1f}. The difference of {fmt.fixed(hits['excess'], 1)} is "
        f"{inside} its {100 * (1 - alarm):g} % band, {fmt.fixed(hits['low'], 1)} to {fmt.fixed(hits['high'], 1)}."
    )
    scores = [fmt.fixed(found[f"log_score{kind}"], 3) for kind in ("", "_expected", "_ignorant")]
    score = (
        f"Mean log score {scores[0]} nats; the probabilities promised {scores[1]}, knowing nothing gives {scores[2]}. "
        f"{found['doubtful']} of {found['evidences']} evidences were doubted by their own diagnostic, and count. "
        f"Of {found['tried']} records tried {found['counted']} count"
    )
    why = "; ".join(f"{n}: {sentence}" for sentence, n in found["refused"].items())
    sentences = [claim, f"{score} ({why})." if why else f"{score}."]
    tables = [_confusion(found), _bins(found), _models(found), *_design(found)]
    return [*(paragraph(sentence) for sentence in sentences), *tables]


def _confusion(found: Mapping[str, Any]) -> Table:
    names = [words.model(m) for m in found["models"]]
    lines = [[name, *map(str, row)] for name, row in zip(names, found["confusion"], strict=True)]
    return Table(["", *names], lines, caption="Records: true model by row, most probable model by column")


def _bins(found: Mapping[str, Any]) -> Table:
    columns: dict[str, Callable[[Mapping[str, Any]], str]] = {
        "probability of the best": lambda b: f"{b['from']:g} to {b['to']:g}",
        "records": lambda b: str(b["records"]),
        "mean": lambda b: fmt.fixed(b["probability"], 3),
        "share right": lambda b: fmt.fixed(b["share"], 3),
        "low": lambda b: fmt.fixed(b["low"], 3),
        "high": lambda b: fmt.fixed(b["high"], 3),
        "p": lambda b: fmt.number(b["p"], 2),
        "p (Holm)": lambda b: fmt.number(b["p_holm"], 2),
    }
    caption = (
        "Share that was right against the probability of the most probable model; low and high hold all shares of "
        "right probabilities with 99 % probability."
    )
    return Table.of(
        found["bins"],
        columns,
        (0,),
        caption,
        lambda b: "" if b["low"] <= b["share"] <= b["high"] else "alert",
    )


def _models(found: Mapping[str, Any]) -> Table:
    columns: dict[str, Callable[[Mapping[str, Any]], str]] = {
        "model": lambda m: words.model(m["model"]),
        "records of it": lambda m: str(m["true"]),
        "sum of its probabilities": lambda m: fmt.fixed(m["expected"], 1),
        "p": lambda m: fmt.number(m["p"], 2),
        "p (Holm)": lambda m: fmt.number(m["p_holm"], 2),
    }
    return Table.of(found["by_model"], columns)


def _design(found: Mapping[str, Any]) -> list[Table]:
    columns: dict[str, Callable[[Mapping[str, Any]], str]] = {
        "noise": lambda d: f"{100 * d['noise']:g} %",
        "cycles": lambda d: fmt.given(d["cycles"]),
        "records": lambda d: str(d["records"]),
        "share right": lambda d: fmt.fixed(d["share"], 3),
        "mean probability of the best": lambda d: fmt.fixed(d["probability"], 3),
    }
    return [Table.of(found["by_design"], columns)] if len(found["by_design"]) > 1 else []


PLUGIN = Recovered()
