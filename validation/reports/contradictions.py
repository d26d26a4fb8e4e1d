"""Compare the statements of shipped pages on simulated records with the truth of these records.

Every comparison returns a list with a sentence for each contradiction.
"""

from __future__ import annotations

import html
import json
import math
import re
from collections import defaultdict
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from scipy.stats import binom, poisson

from bayesdamp.priors import odds
from bayesdamp.types import OK
from validation.rows import numbers, read_rows, where
from validation.scoring import terms_of
from validation.truth.oscillator import COEFFICIENTS, LAWS, Oscillator
from validation.truth.ratio import true_ratio

EXCLUDED = 0.05
"""A record that is not decided excludes the true damping if its probability is below this value."""
MISSED = 0.05
"""Fraction of 95 % intervals that may miss the truth."""
ALARM = 1e-3
"""False-alarm probability of each test in `names_of_many`; that of the test in `misses` is ten times as large
(conventional)."""
FAR = 1.0
"""Largest distance of the truth from a 95 % interval that is not a contradiction, in widths of the interval.

For a normal distribution the truth is then 5.9 standard deviations from the middle.
"""
TIE = math.log(1.25)
"""Difference of log probabilities (nats) up to which it does not matter which of two dampings is named first."""

RADIANS = {"rad": 1.0, "deg": math.pi / 180}
"""Size in rad of each unit in which a page gives an amplitude."""

Verdicts = Sequence[Mapping[str, Any]]
"""The verdicts of a run, as in its verdict.json: a mapping from field to value for each record."""


@dataclass(frozen=True)
class Simulated:
    """A simulated record of a study.

    damping: the true terms. truth: the true values of the parameters, by name. oscillator: the true oscillator; None if
    it has a term or law that `validation.truth` does not contain.
    """

    damping: frozenset[str]
    truth: Mapping[str, float]
    oscillator: Oscillator | None

    @classmethod
    def of(cls, signal: Mapping[str, Any]) -> Simulated:
        """Return the simulated record that an entry `signal` of a study in run.json describes."""
        source, restoring = signal["source"], signal["system"]["restoring"]
        truth = {name: value for name, value in source["truth"].items() if isinstance(value, int | float)}
        damping, oscillator = tuple(source["damping"]), None
        if set(damping) <= set(COEFFICIENTS) and restoring in LAWS:
            oscillator = Oscillator(
                restoring,
                {name: truth[name] for name in LAWS[restoring]},
                {term: truth[COEFFICIENTS[term]] for term in damping},
                truth.get("epsilon", 0.0),
            )
        return cls(frozenset(damping), truth, oscillator)


@dataclass(frozen=True)
class Quoted:
    """A 95 % interval that a page gives for a value whose truth is known.

    record: name of the record. what: the value, in words. low, high, truth: in the unit of the page.
    """

    record: str
    what: str
    low: float
    high: float
    truth: float

    @property
    def outside(self) -> float:
        """Distance of the truth from the interval, in widths of the interval; 0 if it is inside."""
        off = max(self.low - self.truth, self.truth - self.high, 0.0)
        return off / max(self.high - self.low, 1e-300)

    def __str__(self) -> str:
        return f"{self.record}: {self.what} is {self.low:.4g} to {self.high:.4g}, but the truth is {self.truth:.4g}"


def named_wrongly(
    record: str, truth: frozenset[str], decided: bool, damping: str, probabilities: Mapping[str, float]
) -> list[str]:
    """Return a sentence on the contradiction between the damping that a page names and the true one; [] if none.

    A page that names a damping outright (without reservation) contradicts the truth if this damping is wrong. Any other
    page contradicts it if it gives the true damping a probability below `EXCLUDED`.

    Parameters
    ----------
    record : str
        Name of the record.
    truth : frozenset of str
        The true terms.
    decided : bool
        Whether the page names the damping outright.
    damping : str
        The damping that the page gives as the most probable one.
    probabilities : mapping
        Probability of each damping on the page.
    """
    if decided:
        right = terms_of(damping) == truth
        return [] if right else [f"{record}: {damping} is named, but the truth is {'+'.join(sorted(truth))}"]
    own = sum(p for name, p in probabilities.items() if terms_of(name) == truth)
    if own >= EXCLUDED:
        return []
    return [f"{record}: the true damping, {'+'.join(sorted(truth))}, has a probability of {own:.2g}"]


def misses(intervals: Iterable[Quoted], rate: float = MISSED) -> list[str]:
    """Return contradictions of 95 % intervals: those that are far off, and all misses if there are too many for chance.

    Far off means more than `FAR` widths; too many is decided by a binomial test at 1 %. For the test only the middle
    interval of each record is counted, because the intervals of a record are not independent.

    Parameters
    ----------
    intervals : iterable of Quoted
        The intervals and their truths.
    rate : float
        Probability that an interval misses the truth.
    """
    by_record: dict[str, list[Quoted]] = defaultdict(list)
    for interval in intervals:
        by_record[interval.record].append(interval)
    wrong = [f"{own}: far outside" for each in by_record.values() for own in each if own.outside > FAR]
    middle = [each[len(each) // 2] for each in by_record.values()]
    outside = [own for own in middle if own.outside > 0]
    if outside and binom.sf(len(outside) - 1, len(middle), rate) < 10 * ALARM:
        wrong += [f"{own}; {len(outside)} of {len(middle)} records miss the truth" for own in outside]
    return wrong


def of_study(folder: Path) -> list[str]:
    """Return the contradictions between a study's verdicts, posteriors, evidence and page and the truth of its records.

    folder: the results of the study; only its simulated records are compared.
    """
    run = json.loads((folder / "run.json").read_text(encoding="utf-8"))
    signals = run.get("study", {}).get("signals", [])
    truths = {s["name"]: Simulated.of(s) for s in signals if "truth" in (s.get("source") or {})}
    file = folder / "verdict.json"
    verdicts = json.loads(file.read_text(encoding="utf-8")) if file.is_file() else []
    wrong, intervals = [], []
    for verdict in verdicts:
        record, damping = verdict["record"], verdict["damping"]
        # Records that are repeats have a number after the name of their signal.
        names = [n for n in truths if record == n or re.fullmatch(re.escape(n) + r"[^A-Za-z0-9].*", record)]
        if not names:
            continue
        truth = truths[max(names, key=len)]
        if damping:
            rivals = {r["damping"]: r["probability"] for r in verdict["rivals"]}
            probabilities = rivals | {damping: verdict["probability"]}
            wrong += named_wrongly(record, truth.damping, verdict["decided"], damping, probabilities)
        for r in verdict["damping_ratio"]:
            if truth.oscillator is not None and r["unit"] in RADIANS:
                what = f"damping ratio at {r['amplitude']:.3g} {r['unit']}"
                true = true_ratio(truth.oscillator, r["amplitude"] * RADIANS[r["unit"]])
                intervals.append(Quoted(record, what, r["low"], r["high"], true))
    wrong += misses(intervals) + misses(_posteriors(folder, truths))
    return wrong + _other_leaders(folder, verdicts) + _not_quoted(folder, verdicts)


def _posteriors(folder: Path, truths: Mapping[str, Simulated]) -> Iterator[Quoted]:
    """Yield the intervals of damping coefficients in posteriors.csv, for the posteriors under the true damping."""
    for row in read_rows(folder / "posteriors.csv").to_dict("records"):
        truth, name = truths.get(row["signal"]), row["parameter"]
        if truth is None or row["outcome"] != OK or math.isnan(row["q2.5"]):
            continue
        if terms_of(row["model"]) == truth.damping and name in {*COEFFICIENTS.values()} & {*truth.truth}:
            record, what = f"{row['signal']}/{row['repeat']}", f"{name} by {row['sampler']}"
            yield Quoted(record, what, row["q2.5"], row["q97.5"], truth.truth[name])


def _other_leaders(folder: Path, verdicts: Verdicts) -> list[str]:
    """Return a sentence for each record and method of evidence.csv whose most probable damping is not the verdict's.

    Differences of less than `TIE` are ignored.
    """
    logs: dict[tuple[str, str], dict[str, list[float]]] = defaultdict(lambda: defaultdict(list))
    for row in read_rows(folder / "evidence.csv").to_dict("records"):
        if row["outcome"] == OK and not math.isnan(row["log_evidence"]):
            value = row["log_evidence"] + math.log(odds(row["model"].split("+")))
            logs[row["signal"], row["method"]][row["model"]].append(value)
    first = {v["record"]: v["damping"] for v in verdicts if v["damping"]}
    wrong = []
    for (record, method), by_damping in logs.items():
        weights = {name: float(np.logaddexp.reduce(each)) for name, each in by_damping.items()}
        leader, own = max(weights, key=lambda name: weights[name]), first.get(record)
        if own in weights and weights[own] < weights[leader] - TIE:
            wrong.append(
                f"{record}: the verdict puts {own} first, but the evidence by {method} puts {leader} first"
            )
    return wrong


def _not_quoted(folder: Path, verdicts: Verdicts) -> list[str]:
    """Return a sentence for each record whose verdict is not quoted in report.html of the folder."""
    page = folder / "report.html"
    if not verdicts or not page.is_file():
        return []
    plain = re.sub(r"<(script|style).*?</\1>", "", page.read_text(encoding="utf-8"), flags=re.DOTALL)
    text = " ".join(html.unescape(re.sub(r"<[^>]+>", "", plain)).split())
    lost = [v["record"] for v in verdicts if v["sentence"] and " ".join(v["sentence"].split()) not in text]
    return [f"{record}: the page does not contain the sentence of its verdict" for record in lost]


def names_of_many(rows: pd.DataFrame, name: str) -> list[str]:
    """Return sentences if too many records of a table name a wrong damping outright, or exclude the true damping.

    The first number is compared with its expectation, the sum of 1 − probability over the records that name a damping
    outright, the second with 5 % of the records, each by a test with the false-alarm probability `ALARM`.

    rows: the answered records, with columns of `validation.scoring`. name: of the report, for the sentences.
    """
    decided = where(rows.dropna(subset=["named"]), decided=1)
    wrong, expected = len(where(decided, right=0)), float(np.sum(1 - numbers(decided, "probability")))
    sentences = []
    if wrong and poisson.sf(wrong - 1, expected) < ALARM:
        sentences.append(
            f"{name}: {wrong} of {len(decided)} are named wrongly, but {expected:.2g} are expected"
        )
    stated = numbers(rows, "true_probability")
    excluded = int(np.sum(stated < EXCLUDED))
    if excluded and binom.sf(excluded - 1, len(stated), EXCLUDED) < ALARM:
        sentences.append(f"{name}: {excluded} of {len(stated)} exclude the true damping")
    return sentences


def intervals_of_many(rows: pd.DataFrame) -> list[Quoted]:
    """Return the intervals of damping ratios in a table, with their truths, one for each row that has both.

    rows: rows with the columns of `validation.scoring`. The interval is that at the middle one of three amplitudes, or
    at the only amplitude.
    """
    at = 2 if numbers(rows, "low_2").size else 1
    known = rows.dropna(subset=[f"low_{at}", f"true_{at}"])
    columns = (
        known["record"] + "/" + known["peer"],
        *(known[f"{what}_{at}"] for what in ("low", "high", "true")),
    )
    return [Quoted(record, "value", *numbers) for record, *numbers in zip(*columns, strict=True)]


def recovered(rows: pd.DataFrame) -> pd.DataFrame:
    """Add the columns that `names_of_many` needs to the table of a model recovery, and return the new table.

    rows: recovery.csv, with the probability of each damping in a column of its name. The added columns are `named` (the
    most probable damping), `probability`, `decided` (0.95 or more), `right` and `true_probability`.
    """
    by_damping = rows[[n for n in rows if terms_of(n) <= set(COEFFICIENTS)]].astype(float)
    named, highest = by_damping.idxmax(axis=1), by_damping.max(axis=1)
    own = [row[row["model"]] for row in rows.to_dict("records")]
    return rows.assign(
        named=named,
        probability=highest,
        decided=highest >= 0.95,
        right=named == rows["model"],
        true_probability=own,
    )


# The words of a verdict in which a page of docs/ states a damping, a damping ratio in it, the command that simulates
# the record, and the names of damping terms in a verdict.
SENTENCE = re.compile(
    r"(?P<damping>[A-Z][^.;:]*?) damping \(probability (?P<sign>[<>] )?(?P<probability>[\d.]+)\): "
    r"equivalent damping ratio (?P<ratios>.+?), natural frequency"
)
RATIO = re.compile(
    r"[\d.]+ % \((?P<low>[\d.]+) to (?P<high>[\d.]+)\) at (?P<amplitude>[\d.]+) (?P<unit>rad|deg)"
)
COMMAND = re.compile(r"bayesdamp simulate (?P<options>(?:[^\n`]*\\\n)*[^\n`]*)")
NAMES = {"viscous": "viscous", "coulomb (dry friction)": "coulomb", "quadratic (drag)": "quadratic"}


def _values(pairs: str) -> dict[str, float]:
    """Return the numbers by name in a text such as `zeta=0.1,mu_c=0.2`."""
    split = (pair.partition("=") for pair in pairs.split(",") if pair)
    return {name: float(value) for name, _, value in split}


def of_document(page: Path) -> list[str]:
    """Return the contradictions between verdicts that a page of docs/ quotes and the record that its command simulates.

    A page without such a command is skipped. So is a page with several, because it is not clear which record a sentence
    describes.
    """
    text = page.read_text(encoding="utf-8")
    commands = [c for c in COMMAND.findall(text) if "--damping" in c]
    if len(commands) != 1:
        return []
    words = commands[0].replace("\\\n", " ").split()
    given = {a: b for a, b in pairwise(words) if a.startswith("--")}
    damping, values = _values(given["--damping"]), _values(given.get("--set", ""))
    if not set(damping) <= set(COEFFICIENTS):
        return []
    restoring = given.get("--restoring", "linear")
    parameters = {name: values.get(name, 0.0) for name in LAWS[restoring]}
    oscillator = Oscillator(restoring, parameters, damping, values.get("epsilon", 0.0))
    plain = " ".join(re.sub(r"^> ?", "", line) for line in text.splitlines())
    wrong, intervals = [], []
    for verdict in SENTENCE.finditer(plain):
        terms = [NAMES.get(part.lower(), part) for part in verdict["damping"].split(" + ")]
        wrong += named_wrongly(page.name, frozenset(damping), True, "+".join(terms), {})
        for r in RATIO.finditer(verdict["ratios"]):
            amplitude = float(r["amplitude"]) * RADIANS[r["unit"]]
            what = f"damping ratio at {r['amplitude']} {r['unit']} in %"
            low, high = float(r["low"]), float(r["high"])
            intervals.append(Quoted(page.name, what, low, high, 100 * true_ratio(oscillator, amplitude)))
    return wrong + misses(intervals)


TABLES: Mapping[str, Mapping[str, str]] = {
    "deviation/rows.csv": {"group": "family"},
    "laws/laws.csv": {},
    "light/rows.csv": {},
    "misfit/scored.csv": {"group": "clean"},
}
"""For each table with many records, its path below reports/ and the values of the rows that are compared, by column:
those whose true law is among the compared ones."""


def contradictions(page: Path) -> list[str]:
    """Return a sentence for each contradiction of a folder under reports/, or a page, with the truth of its records."""
    if not page.is_dir():
        return of_document(page) if page.suffix == ".md" else []
    wrong = []
    for place, chosen in TABLES.items():
        table = page.parent / place
        if table.parent == page and table.is_file():
            rows = where(read_rows(table), outcome=OK, **chosen)
            wrong += names_of_many(rows, page.name) + misses(intervals_of_many(rows))
    if page.name == "model_recovery":
        wrong += names_of_many(recovered(where(read_rows(page / "recovery.csv"), outcome=OK)), page.name)
    run = page / "run.json"
    if run.is_file() and "kind" not in json.loads(run.read_text(encoding="utf-8")):
        wrong += of_study(page)
    return wrong
