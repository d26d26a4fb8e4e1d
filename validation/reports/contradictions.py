"""Compare the statements of shipped pages on simulated records with the truth of these records.

Every comparison returns a list with a sentence for each contradiction.
"""

import json
import math
from pathlib import Path

import numpy as np
import pandas as pd
from scipy.stats import binom, poisson

from bayesdamp.report.results.run import RunFolder
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
INTERVAL = ("record", "what", "low", "high", "truth")
"""Columns of a table of 95 % intervals for values whose truth is known; `what` is the value in words."""


def misses(intervals: pd.DataFrame) -> list[str]:
    """Return contradictions of 95 % intervals: those that are far off, and all misses if there are too many for chance.

    Far off means more than `FAR` widths; too many is decided by a binomial test at 1 %. For the test only the middle
    interval of each record is counted, because the intervals of a record are not independent.

    intervals: the intervals, with the columns `INTERVAL`.
    """
    low, high, truth = (intervals[column].to_numpy(float) for column in ("low", "high", "truth"))
    off = np.maximum(low - truth, truth - high) / (high - low)
    middle = [places[len(places) // 2] for places in intervals.groupby("record", sort=False).indices.values()]
    outside = [i for i in middle if off[i] > 0]
    if not outside or binom.sf(len(outside) - 1, len(middle), MISSED) >= 10 * ALARM:
        outside = []
    wrong = intervals.iloc[sorted({*np.flatnonzero(off > FAR), *outside})]
    return [
        f"{record}: {what} is {low:.4g} to {high:.4g}, but the truth is {truth:.4g}"
        for record, what, low, high, truth in wrong.loc[:, list(INTERVAL)].itertuples(index=False)
    ]


def of_study(run: RunFolder) -> list[str]:
    """Return the contradictions between a study's verdicts and posteriors, and the truth of its simulated records.

    Of the posteriors only damping coefficients under the true damping are compared.
    """
    wrong, ratios, coefficients = [], [], []
    law_of = {signal["name"]: signal["system"]["restoring"] for signal in run.study["signals"]}
    for verdict in run.verdicts:
        record, source = verdict.record, run.simulation(verdict.record)
        if not source:
            continue
        true, truth, law = frozenset(source["damping"]), source["truth"], law_of[record]
        name = "+".join(sorted(true))
        if verdict.decided and terms_of(verdict.damping) != true:
            wrong.append(f"{record}: {verdict.damping} is named, but the truth is {name}")
        own = sum(p for damping, p in verdict.probabilities.items() if terms_of(damping) == true)
        if verdict.damping and not verdict.decided and own < EXCLUDED:
            wrong.append(f"{record}: the true damping, {name}, has a probability of {own:.2g}")
        oscillator = Oscillator(
            law,
            {parameter: truth[parameter] for parameter in LAWS[law]},
            {term: truth[COEFFICIENTS[term]] for term in true},
            truth.get("epsilon", 0.0),
        )
        for at in verdict.damping_ratio:
            what = f"damping ratio at {at.amplitude:.3g} {at.unit}"
            ratios.append((record, what, at.low, at.high, true_ratio(oscillator, at.amplitude)))
    for row in run.posteriors:
        source, name, low, high = run.simulation(row["signal"]), row["parameter"], row["q2.5"], row["q97.5"]
        is_true = source and terms_of(row["model"]) == frozenset(source["damping"])
        if is_true and row["outcome"] == OK and name in COEFFICIENTS.values() and not math.isnan(low):
            what, record = f"{name} by {row['sampler']}", f"{row['signal']}/{row['repeat']}"
            coefficients.append((record, what, low, high, source["truth"][name]))
    for intervals in (ratios, coefficients):
        wrong += misses(pd.DataFrame(intervals, columns=INTERVAL))
    return wrong


def names_of_many(rows: pd.DataFrame, name: str) -> list[str]:
    """Return sentences if too many records of a table name a wrong damping outright, or exclude the true damping.

    The first number is compared with its expectation, the sum of 1 − probability over the records that name a damping
    outright, the second with 5 % of the records, each by a test with the false-alarm probability `ALARM`.

    rows: the answered records, with columns of `validation.scoring`. name: of the report, for the sentences.
    """
    decided = rows.loc[rows["named"].notna() & (rows["decided"] == 1)]
    wrong, expected = int(np.sum(decided["right"] == 0)), float(np.sum(1 - decided["probability"]))
    stated = rows["true_probability"].dropna()
    excluded = int(np.sum(stated < EXCLUDED))
    sentences = []
    if wrong and poisson.sf(wrong - 1, expected) < ALARM:
        sentences.append(
            f"{name}: {wrong} of {len(decided)} are named wrongly, but {expected:.2g} are expected"
        )
    if excluded and binom.sf(excluded - 1, len(stated), EXCLUDED) < ALARM:
        sentences.append(f"{name}: {excluded} of {len(stated)} exclude the true damping")
    return sentences


def intervals_of_many(rows: pd.DataFrame) -> pd.DataFrame:
    """Return the intervals of damping ratios in a table, (n, `INTERVAL`), one for each row that has a truth.

    rows: rows with the columns of `validation.scoring`. The interval is that at the middle one of three amplitudes, or
    at the only amplitude.
    """
    at = 2 if np.isfinite(rows["low_2"].to_numpy(float)).any() else 1
    columns = {f"low_{at}": "low", f"high_{at}": "high", f"true_{at}": "truth"}
    table = rows.rename(columns=columns).assign(record=rows["record"] + "/" + rows["peer"], what="value")
    return table.loc[:, list(INTERVAL)].dropna().reset_index(drop=True)


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
        wrong += of_study(RunFolder(page))
    return wrong
