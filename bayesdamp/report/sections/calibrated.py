"""Show whether intervals are calibrated, from a run of `bayesdamp calibrate`."""

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import Any

import numpy as np
from markupsafe import Markup
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from bayesdamp import formatting as fmt
from bayesdamp.report import words
from bayesdamp.report.drawing import FAINT, LOOKS, MUTED, WIDTH
from bayesdamp.report.results.run import Row, RunFolder, rows_of
from bayesdamp.report.sections import Section, heading, paragraph, stack
from bayesdamp.store.files import read_table
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
"""By sampler and parameter: for each rank from 0 to the number of draws, in how many records the true value had this
rank among the draws, (draws + 1,)."""


class CalibratedSection(Section):
    """The section on the calibration of intervals: results of the checks, ranks, coverage, and usable records."""

    order = 11
    title = "Are the intervals calibrated?"

    def applies(self, run: RunFolder) -> bool:
        """Return whether the run is a calibration of intervals (`bayesdamp calibrate`)."""
        return run.info.get("kind") == "calibration"

    def render(self, run: RunFolder) -> str:
        """Return the section's HTML: how many checks failed, and the ranks and coverage of each model's intervals."""
        result = run.info["result"]
        rows = _rows(run, "calibration.csv")
        names = {"posterior": "the posteriors", "classical": "the trajectory fits' own intervals"}
        text = fmt.listing(
            f"{counts['wrong'] or 'none'} of {counts['tests']} checks of {names[family]} failed"
            for family, counts in result["families"].items()
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
        parts.append(fmt.Table.of(counts, of_model, (0, 5), TRIED))
        ranks = _rows(run, "ranks.csv")
        for model in counts:
            parts.append(_model(run, rows_of(ranks, model=model), rows_of(rows, model=model), model))
        return stack(*parts)


def _rows(run: RunFolder, name: str) -> list[Row]:
    """Return the rows of a table of the run; none if the file is missing."""
    path = run.folder / name
    return read_table(path) if path.is_file() else []


def _model(run: RunFolder, ranks: list[Row], rows: list[Row], model: str) -> Markup:
    """Return a figure of the ranks of true values, and a table of the coverage of intervals, for one model.

    `ranks` and `rows` are its rows of ranks.csv and calibration.csv.
    """
    result = run.info["result"]
    counts: dict[str, dict[str, np.ndarray]] = {}
    for row in ranks:
        own = np.bincount(np.array(row["ranks"].split(), int), minlength=result["draws"] + 1)
        counts.setdefault(row["sampler"], {})[row["parameter"]] = own
    names = list(dict.fromkeys(r["parameter"] for r in rows_of(rows, check="ranks")))
    caption = (
        f"Ranks of the true values among {result['draws']} independent posterior draws, for each parameter and for "
        f"the log likelihood, over the {result['counts'][model]['counted']} usable simulated records with "
        f"{words.model(model)} damping: number of records in each bin of the rank. One line for each sampler. Grey: "
        "the range that contains the number in a bin with 99 % probability if the posteriors are calibrated, that is, "
        "if all ranks are equally probable."
    )
    figure = run.drawings.add(f"ranks-{model}", caption, lambda: _ranks(names, counts, result))
    checks = {(r["parameter"], r["method"], r["check"], r["level"]): r for r in rows}

    def result_of(name: str, check: tuple[str, str, str]) -> str:
        row = checks.get((name, *check))
        if row is None or not np.isfinite(row["value"]):
            return fmt.NONE
        text = f"{100 * row['value']:.1f}" if row["level"] else fmt.number(float(row["p_holm"]), 2)
        without = f" ({row['without']} without)" if int(row["without"] or 0) else ""
        return f"{text}{' *' * (row['verdict'] == 'wrong')}{without}"

    columns: dict[str, Callable[[str], str]] = {"parameter": lambda name: words.symbol(name).text}
    for method, check, level in dict.fromkeys((r["method"], r["check"], r["level"]) for r in rows):
        name = words.stage("refined") if method.startswith("refined") else words.method(method)
        header = f"{name}, {f'{100 * float(level):g} %' if level else 'p of the ranks'}"
        columns[header] = partial(result_of, check=(method, check, level))
    caption = f"Records with {words.model(model)} damping. {CHECKS}"
    return stack(heading(words.model(model)), figure, fmt.Table.of(names, columns, caption=caption))


def _ranks(names: Sequence[str], counts: Counts, result: Mapping[str, Any]) -> Figure:
    """Draw a histogram of the ranks of each parameter's true value among posterior draws.

    Parameters
    ----------
    names
        Names of the parameters.
    counts
        Number of records with each rank, by sampler and parameter (see `Counts`).
    result
        The entry `result` of run.json. `bins`: number of bins of the histograms; draws + 1 is a multiple of it.
        `bands`: for each number of records (a string), the range that contains the count in a bin with 99 %
        probability.
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


PLUGIN = CalibratedSection()
