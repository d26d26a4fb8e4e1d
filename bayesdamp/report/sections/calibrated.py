"""Whether the intervals are what they say: ranks and coverage of a simulation-based calibration."""

from __future__ import annotations

import csv
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
from markupsafe import Markup

from bayesdamp import formatting as fmt
from bayesdamp.report import words
from bayesdamp.report.figures.calibration import ranks
from bayesdamp.report.html import folded, paragraph, stack
from bayesdamp.report.results.run import Run, rows_of
from bayesdamp.report.sections._layout import Section
from bayesdamp.table import Table
from bayesdamp.types import OK

FEWEST = 15
EXPLAINED = (
    "Parameters are drawn from the study's own priors, noise included, a record is simulated from them, and its "
    "posterior is sampled from starting points that know the record alone. Then the rank of each true value among "
    "independent draws is uniform, and an interval of 80 % holds it in 80 % of the records.",
    "A record is left out only where the record itself says so, before anything is sampled: it shows no "
    "oscillation, or no starting point leads to a finite posterior. That looks at the data alone, and a posterior is "
    "conditional on its data, so the ranks of what is left are still uniform. Draws that a sampler's own diagnostics "
    "doubt are not left out: that would choose among draws.",
)


class Calibrated(Section):
    """The verdict, the ranks of each model, the coverage of all intervals, and which records count."""

    order = 11
    title = "Are the intervals what they say?"

    def applies(self, run: Run) -> bool:
        """In the report of a calibration."""
        return run.info.get("kind") == "calibration"

    def render(self, run: Run) -> str:
        """Tests of uniform ranks, and coverage with its bands."""
        result = run.info["result"]
        rows = _csv(run, "calibration.csv")
        parts: list[object] = [Markup('<p class="lead">{}</p>').format(_claim(result))]
        parts += [paragraph(sentence) for sentence in EXPLAINED]
        parts.append(_records(result))
        parts += [_model(run, result, rows, model) for model in result["counts"]]
        parts.append(folded(f"The {FEWEST} least p values; calibration.csv has all", _tests(rows)))
        return stack(*parts)


def _csv(run: Run, name: str) -> list[dict[str, str]]:
    path = run.folder / name
    if not path.is_file():
        return []
    with path.open(newline="", encoding="utf-8") as handle:
        return list(csv.DictReader(handle))


def _claim(result: Mapping[str, Any]) -> str:
    said = []
    for family, of in (
        ("posterior", "of the posteriors"),
        ("classical", "of the trajectory fits' own intervals"),
    ):
        found = result["families"][family]
        if found["tests"]:
            wrong = f"{found['wrong']} are wrong" if found["wrong"] else "none is wrong"
            said.append(f"of {found['tests']} checks {of} {wrong}")
    text = fmt.listing(said)
    alarm = f"{100 * result['alarm']:g} %"
    return f"{text[:1].upper()}{text[1:]} (false-alarm rate {alarm} for each of the two tables, Holm)."


def _records(result: Mapping[str, Any]) -> Table:
    def doubted(found: Mapping[str, Any]) -> str:
        bad = {s: sum(n for o, n in said.items() if o != OK) for s, said in found["samplers"].items()}
        return "; ".join(f"{words.method(sampler)}: {count}" for sampler, count in bad.items())

    def refused(found: Mapping[str, Any]) -> str:
        return (
            "; ".join(f"{n}: {s}" for s, n in sorted(found["refused"].items(), key=lambda x: -x[1]))
            or fmt.NONE
        )

    columns: dict[str, Callable[[tuple[str, Mapping[str, Any]]], str]] = {
        "model": lambda item: words.model(item[0]),
        "records tried": lambda item: str(item[1]["tried"]),
        "that count": lambda item: str(item[1]["counted"]),
        "of these doubted by the sampler": lambda item: doubted(item[1]),
        "time each": lambda item: fmt.duration(sum(item[1]["seconds"].values()) / max(item[1]["tried"], 1)),
        "not counted": lambda item: refused(item[1]),
    }
    return Table.of(result["counts"].items(), columns, (0, 5))


def _model(run: Run, result: Mapping[str, Any], rows: Sequence[dict[str, str]], model: str) -> Markup:
    counts = _counts(run, result, model)
    names = list(dict.fromkeys(r["parameter"] for r in rows_of(rows, model=model, check="ranks")))
    caption = (
        f"{words.model(model)}: ranks of the truth among {result['draws']} draws. Below, their distribution function "
        "less the uniform one. The grey band holds all of a calibrated curve with 99 % probability, above a single bin."
    )
    figure = run.drawings.add(f"ranks-{model}", caption, lambda: ranks(names, counts, result))
    heading = Markup("<h3>{}</h3>").format(words.model(model))
    return stack(heading, figure, _coverage(rows_of(rows, model=model, check="coverage"), names))


def _counts(run: Run, result: Mapping[str, Any], model: str) -> dict[str, dict[str, np.ndarray]]:
    """How often each rank came, (draws + 1,), by sampler and parameter."""
    found: dict[str, dict[str, np.ndarray]] = {}
    for row in rows_of(_csv(run, "ranks.csv"), model=model):
        ranks = np.array(row["ranks"].split(), int)
        counts = np.bincount(ranks, minlength=result["draws"] + 1)
        found.setdefault(row["sampler"], {})[row["parameter"]] = counts
    return found


def _coverage(rows: Sequence[dict[str, str]], names: Sequence[str]) -> Table:
    """Return the share of intervals that hold the truth: a line a parameter, a column for each method and level."""
    found = {(r["parameter"], r["method"], r["level"]): _share(r) for r in rows}
    columns: dict[str, Callable[[str], str]] = {"parameter": lambda name: words.symbol(name).text}
    for method, level in dict.fromkeys((r["method"], r["level"]) for r in rows):
        columns[f"{words.method(method)} {100 * float(level):g} %"] = lambda name, own=(method, level): (
            found.get((name, *own), fmt.NONE)
        )
    caption = "Share of intervals that hold the truth, in per cent; * where the whole table calls it wrong"
    return Table.of(names, columns, caption=caption)


def _share(row: Mapping[str, str]) -> str:
    if not row["value"]:
        return fmt.NONE
    star = " *" if row["verdict"] == "wrong" else ""
    without = f" ({row['without']} without)" if int(row["without"] or 0) else ""
    return f"{100 * float(row['value']):.1f}{star}{without}"


def _tests(rows: Sequence[dict[str, str]]) -> Table:
    def number(name: str) -> Callable[[dict[str, str]], str]:
        return lambda r: fmt.number(float(r[name]), 3) if r[name] else fmt.NONE

    columns: dict[str, Callable[[dict[str, str]], str]] = {
        "model": lambda r: words.model(r["model"]),
        "method": lambda r: words.method(r["method"]),
        "parameter": lambda r: words.symbol(r["parameter"]).text,
        "check": lambda r: f"{r['check']} {100 * float(r['level']):g} %" if r["level"] else r["check"],
        "records": lambda r: r["records"],
        **{name: number(name) for name in ("value", "low", "high", "p")},
        "p (Holm)": number("p_holm"),
        "verdict": lambda r: r["verdict"],
    }
    least = sorted((r for r in rows if r["p"]), key=lambda r: float(r["p"]))[:FEWEST]
    return Table.of(
        least, columns, (0, 1, 2, 3, 10), kind=lambda r: "alert" if r["verdict"] == "wrong" else ""
    )


PLUGIN = Calibrated()
