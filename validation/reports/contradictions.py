"""Compare the statements of shipped pages on simulated records with the truth of these records.

Every comparison returns a list with a sentence for each contradiction.
"""

from __future__ import annotations

import json
import math
import re
from collections import defaultdict
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pandas as pd
from scipy.stats import binom, poisson

from bayesdamp.types import OK
from validation.scoring import read_rows, terms_of
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

RADIANS = {"rad": 1.0, "deg": math.pi / 180}
"""Size in rad of each unit in which a page gives an amplitude."""


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
    """Return the contradictions between a study's verdicts, and posteriors and the truth of its records.

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
    return wrong + misses(intervals) + misses(_posteriors(folder, truths))


def _posteriors(folder: Path, truths: Mapping[str, Simulated]) -> Iterator[Quoted]:
    """Yield the intervals of damping coefficients in posteriors.csv, for the posteriors under the true damping."""
    for row in read_rows(folder / "posteriors.csv").to_dict("records"):
        truth, name = truths.get(row["signal"]), row["parameter"]
        if truth is None or row["outcome"] != OK or math.isnan(row["q2.5"]):
            continue
        if terms_of(row["model"]) == truth.damping and name in {*COEFFICIENTS.values()} & {*truth.truth}:
            record, what = f"{row['signal']}/{row['repeat']}", f"{name} by {row['sampler']}"
            yield Quoted(record, what, row["q2.5"], row["q97.5"], truth.truth[name])


def names_of_many(rows: pd.DataFrame, name: str) -> list[str]:
    """Return sentences if too many records of a table name a wrong damping outright, or exclude the true damping.

    The first number is compared with its expectation, the sum of 1 − probability over the records that name a damping
    outright, the second with 5 % of the records, each by a test with the false-alarm probability `ALARM`.

    rows: the answered records, with columns of `validation.scoring`. name: of the report, for the sentences.
    """
    decided = rows[rows["named"].notna() & (rows["decided"] == 1)]
    wrong, expected = int((decided["right"] == 0).sum()), float((1 - decided["probability"]).sum())
    sentences = []
    if wrong and poisson.sf(wrong - 1, expected) < ALARM:
        sentences.append(
            f"{name}: {wrong} of {len(decided)} are named wrongly, but {expected:.2g} are expected"
        )
    stated = rows["true_probability"].dropna()
    excluded = int((stated < EXCLUDED).sum())
    if excluded and binom.sf(excluded - 1, len(stated), EXCLUDED) < ALARM:
        sentences.append(f"{name}: {excluded} of {len(stated)} exclude the true damping")
    return sentences


def intervals_of_many(rows: pd.DataFrame) -> list[Quoted]:
    """Return the intervals of damping ratios in a table, with their truths, one for each row that has both.

    rows: rows with the columns of `validation.scoring`. The interval is that at the middle one of three amplitudes, or
    at the only amplitude.
    """
    at = 2 if rows["low_2"].notna().any() else 1
    known = rows.dropna(subset=[f"low_{at}", f"true_{at}"])
    columns = (
        known["record"] + "/" + known["peer"],
        *(known[f"{what}_{at}"] for what in ("low", "high", "true")),
    )
    return [Quoted(record, "value", *numbers) for record, *numbers in zip(*columns, strict=True)]


TABLES = {
    "deviation/rows.csv": "group == 'family'",
    "laws/laws.csv": "peer == 'bayesdamp'",
    "light/rows.csv": "peer == peer",
    "contest/rows.csv": "group == 'family' and peer == 'bayesdamp'",
}
"""For each table with many records, its path below reports/ and a condition for the rows that are compared: those whose
true law is among the compared ones."""


def contradictions(page: Path) -> list[str]:
    """Return a sentence for each contradiction of a folder under reports/ with the truth of its records."""
    wrong = []
    for place, condition in TABLES.items():
        table = page.parent / place
        if table.parent == page and table.is_file():
            rows = read_rows(table).query(f"outcome == @OK and {condition}")
            wrong += names_of_many(rows, page.name) + misses(intervals_of_many(rows))
    run = page / "run.json"
    if run.is_file() and "kind" not in json.loads(run.read_text(encoding="utf-8")):
        wrong += of_study(page)
    return wrong
