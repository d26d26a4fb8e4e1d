"""Show whether intervals and model probabilities are calibrated, from runs of `bayesdamp calibrate`."""

from __future__ import annotations

import csv
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import Any

import numpy as np
from markupsafe import Markup
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from bayesdamp import formatting as fmt
from bayesdamp.formatting import Table
from bayesdamp.report import words
from bayesdamp.report.drawing import FAINT, LOOKS, MUTED, WIDTH
from bayesdamp.report.results.run import RunFolder, rows_of
from bayesdamp.report.sections import Section, heading, paragraph, stack
from bayesdamp.types import OK

EXPLAINED = (
    "Parameters are drawn from the study's own priors, including the noise, and a record is simulated from them. Its "
    "posterior is sampled from starting points that are computed from the record alone. If the posteriors are "
    "correct, the rank of each true value among independent draws is uniform, and an 80 % interval contains the true "
    "value in 80 % of the records.",
    "A record is left out only for a reason in the record itself, before anything is sampled: it shows no oscillation, "
    "or no starting point leads to a finite posterior. This decision uses the data alone, and a posterior is "
    "conditional on its data, so the ranks of the other records are still uniform. Draws that a sampler's own "
    "diagnostics call unreliable are included, because leaving them out would be a selection by the result.",
)
TRIED = (
    "Simulated records of each damping model: how many were tried, how many could be used, and for how many of these "
    "each sampler called its own draws unreliable; mean computing time; number of records that were left out for each "
    "reason."
)
CHECKS = (
    "Percentage of the records in which the 50 %, 80 % or 95 % interval of each method contains the true value, and "
    "the p value of a test that the ranks of the true values are uniform, corrected for the number of checks in its "
    "group (Holm). *: the check failed. "
    '"2 without": for 2 records the method gives no interval. calibration.csv has the limits and the p value of each '
    "check."
)
Counts = Mapping[str, Mapping[str, np.ndarray]]
"""For each sampler and parameter, the number of records in which the true value had each rank, (draws + 1,)."""
MODELS_EXPLAINED = (
    "A damping model is drawn from a uniform prior, its parameters are drawn from their priors, and a record is "
    "simulated. The noise levels and lengths of the records are chosen in advance, and the inference knows them. The "
    "evidence of every model gives its posterior probability. If these probabilities are correct, a model with "
    "probability p is the true one in a fraction p of the records.",
    "Records that show no oscillation are left out. This decision uses the record alone, so the probabilities remain "
    "valid.",
)


class CalibratedSection(Section):
    """The section on intervals: the result of the checks, ranks, coverage, and which records were usable."""

    order = 11
    name = "calibrated"
    title = "Are the intervals calibrated?"

    def applies(self, run: RunFolder) -> bool:
        """Return whether the run is a calibration."""
        return run.info.get("kind") == "calibration"

    def render(self, run: RunFolder) -> str:
        """Return the section's HTML: how many checks failed, and the ranks and coverage of each model's intervals."""
        result = run.info["result"]
        rows = _csv(run, "calibration.csv")
        names = {"posterior": "the posteriors", "classical": "the trajectory fits' own intervals"}
        families = {name: result["families"][family] for family, name in names.items()}
        text = fmt.listing(
            f"{counts['wrong'] or 'none'} of {counts['tests']} checks of {name} failed"
            for name, counts in families.items()
            if counts["tests"]
        )
        alarm = f"{100 * result['alarm']:g} %"
        claim = (
            f"{text[:1].upper()}{text[1:]}. If all intervals are right, the probability that any check of a group "
            f"(posteriors or trajectory fits) fails is at most {alarm} (Holm's correction)."
        )
        counts: Mapping[str, Mapping[str, Any]] = result["counts"]

        def doubted(model: str) -> str:
            samplers = counts[model]["samplers"].items()
            bad = {s: sum(n for o, n in own.items() if o != OK) for s, own in samplers}
            return "; ".join(f"{words.method(sampler)}: {count}" for sampler, count in bad.items())

        def refused(model: str) -> str:
            reasons = sorted(counts[model]["refused"].items(), key=lambda x: -x[1])
            return "; ".join(f"{n}: {reason}" for reason, n in reasons) or fmt.NONE

        def time(model: str) -> str:
            return fmt.duration(sum(counts[model]["seconds"].values()) / max(counts[model]["tried"], 1))

        of_model: dict[str, Callable[[str], str]] = {
            "model": words.model,
            "simulated records": lambda model: str(counts[model]["tried"]),
            "usable records": lambda model: str(counts[model]["counted"]),
            "of these flagged as unreliable by the sampler": doubted,
            "time per record": time,
            "records left out, and why": refused,
        }
        parts: list[object] = [paragraph(claim, "lead"), *map(paragraph, EXPLAINED)]
        parts += [Table.of(counts, of_model, (0, 5), TRIED)]
        ranks = _csv(run, "ranks.csv")
        parts += [
            _model(run, rows_of(ranks, model=model), rows_of(rows, model=model), model) for model in counts
        ]
        return stack(*parts)


def _method(name: str) -> str:
    """Return the name of a sampler, or of the trajectory fits (`calibrate.tables.CLASSICAL`), in words."""
    return words.stage("refined") if name.startswith("refined") else words.method(name)


def _csv(run: RunFolder, name: str) -> list[dict[str, str]]:
    """Return the rows of a table of the run as texts by column; none if the file is missing."""
    path = run.folder / name
    if not path.is_file():
        return []
    with path.open(newline="", encoding="utf-8") as handle:
        return list(csv.DictReader(handle))


def _model(run: RunFolder, ranks: list[dict[str, str]], rows: list[dict[str, str]], model: str) -> Markup:
    """Return a figure of the ranks and a table of the coverage for a model, under its name.

    `ranks` and `rows` are its rows of ranks.csv and calibration.csv.
    """
    result = run.info["result"]
    counts: dict[str, dict[str, np.ndarray]] = {}
    for row in ranks:
        values = np.array(row["ranks"].split(), int)
        own = np.bincount(values, minlength=result["draws"] + 1)
        counts.setdefault(row["sampler"], {})[row["parameter"]] = own
    names = list(dict.fromkeys(r["parameter"] for r in rows_of(rows, check="ranks")))
    caption = (
        f"Ranks of the true value of each parameter among {result['draws']} independent posterior draws, over "
        f"{result['counts'][model]['counted']} simulated records with {words.model(model)} damping: number "
        "of records in each bin of the rank. One line for each sampler. Grey: the range that contains the number in a "
        "bin with 99 % probability if the posteriors are calibrated, that is, if all ranks are equally probable."
    )
    figure = run.drawings.add(f"ranks-{model}", caption, lambda: _ranks(names, counts, result))
    checks = {(r["parameter"], r["method"], r["check"], r["level"]): r for r in rows}

    def result_of(name: str, check: tuple[str, str, str]) -> str:
        row = checks.get((name, *check))
        if row is None or not row["value"]:
            return fmt.NONE
        text = f"{100 * float(row['value']):.1f}" if row["level"] else fmt.number(float(row["p_holm"]), 2)
        without = f" ({row['without']} without)" if int(row["without"] or 0) else ""
        return f"{text}{' *' * (row['verdict'] == 'wrong')}{without}"

    columns: dict[str, Callable[[str], str]] = {"parameter": lambda name: words.symbol(name).text}
    for method, check, level in dict.fromkeys((r["method"], r["check"], r["level"]) for r in rows):
        header = f"{_method(method)}, {f'{100 * float(level):g} %' if level else 'p of the ranks'}"
        columns[header] = partial(result_of, check=(method, check, level))
    caption = f"Records with {words.model(model)} damping. {CHECKS}"
    return stack(heading(words.model(model)), figure, Table.of(names, columns, caption=caption))


def _ranks(names: Sequence[str], counts: Counts, result: Mapping[str, Any]) -> Figure:
    """Draw a histogram of the ranks of each parameter.

    Parameters
    ----------
    names
        Names of the parameters.
    counts
        Number of records with each rank, for each sampler and parameter.
    result
        `bins`: number of bins of the histograms, which divides draws + 1; `bands`: for each number of records, the
        limits of the count in one bin.
    """
    figure = Figure(figsize=(WIDTH, 1.9))
    axes = figure.subplots(1, len(names), sharex=True, sharey=True, squeeze=False)[0]
    for axis, name in zip(axes, names):
        for i, own in enumerate(counts.values()):
            ink, dash = LOOKS[i % len(LOOKS)]
            bins = own[name].reshape(result["bins"], -1).sum(axis=1)
            n = int(bins.sum())
            if not i and n:
                axis.axhspan(*result["bands"][str(n)], color=FAINT, lw=0)
                axis.axhline(n / bins.size, color=MUTED, lw=0.6)
            axis.stairs(bins, np.linspace(0, 1, bins.size + 1), color=ink, ls=dash, lw=1.0)
        axis.set_ylim(0, None)
        axis.locator_params(axis="both", nbins=3)
        axis.set_title(words.symbol(name).math)
        axis.set_xlabel("rank / draws")
    axes[0].set_ylabel("records")
    looks = zip(counts, LOOKS)
    handles = [Line2D([], [], color=c, ls=dash, label=words.method(s)) for s, (c, dash) in looks]
    figure.legend(handles=handles, loc="outside upper right", ncols=len(handles))
    return figure


class RecoveredSection(Section):
    """The section on model probabilities: how often the most probable model is the true one, and how often expected."""

    order = 12
    name = "recovered"
    title = "Are the models' probabilities calibrated?"

    def applies(self, run: RunFolder) -> bool:
        """Return whether the run is a model recovery."""
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


def _tables(result: Mapping[str, Any]) -> list[Table]:
    """Return the confusion matrix of the models, and a table of how reliable their probabilities are.

    `result` is that of the model recovery in run.json. The second table compares expected with observed fractions of
    correct answers, by the probability of the most probable model.
    """
    names = [words.model(m) for m in result["models"]]
    lines = [[name, *map(str, row)] for name, row in zip(names, result["confusion"], strict=True)]
    caption = "Number of simulated records, by true damping model (rows) and most probable one (columns)."
    confusion = Table(["", *names], lines, caption=caption)

    def fixed(name: str, places: int = 3) -> Callable[[Mapping[str, Any]], str]:
        return lambda row: fmt.fixed_decimals(row[name], places)

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

    return [confusion, Table.of(result["bins"], by_probability, (0,), caption, kind)]


PLUGINS = (CalibratedSection(), RecoveredSection())
