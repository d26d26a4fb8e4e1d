"""Compare the statements of shipped reports on simulated records with the truth of these records.

Every comparison returns its contradictions, one sentence for each.
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
"""An answer excludes the true damping if it gives it a probability below this value."""
MISSED = 0.05
"""Expected fraction of 95 % intervals that do not contain the truth."""
ALARM = 1e-3
"""Probability of a false alarm of each test in `names_of_many`; that of the test in `misses` is ten times as large
(conventional)."""
FAR = 1.0
"""Largest distance of the truth from a 95 % interval that does not count as a contradiction, in widths of the interval.

For a normal distribution the truth is then 5.9 standard deviations from the middle.
"""
INTERVAL = ("record", "what", "low", "high", "truth")
"""Columns of a table of 95 % intervals for values whose truth is known. `what` describes the value in words, `low` and
`high` are the ends of the interval."""


def misses(intervals: pd.DataFrame) -> list[str]:
    """Return a sentence for each 95 % interval that contradicts the truth: it is far off, or one of too many misses.

    "Far off" means more than `FAR` widths of the interval. Whether too many intervals miss the truth to be chance is
    decided by a binomial test with a false-alarm probability of 1 %. The test counts only the middle interval of each
    record, because the intervals of a record are not independent.

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

    Of the posteriors, only the damping coefficients of the model with the true damping are compared. run: results of
    the study.
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
    """Return a sentence if too many answers name a wrong damping outright, and one if too many exclude the true one.

    The number of wrong names is compared with its expectation: the sum of 1 − probability over the answers that name a
    damping outright. The number of exclusions is compared with 5 % of the answers. Each test has the false-alarm
    probability `ALARM`.

    rows: the answered records, with the columns of `validation.scoring`. name: name of the report, for the sentences.
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
    """Return a table (columns `INTERVAL`) of the intervals of damping ratios, with one row for each answer.

    rows: answers, with the columns of `validation.scoring`. The interval is that at the middle one of three amplitudes,
    or at the only amplitude. Answers without an interval or a truth are left out.
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
"""For each report with a table of many records: path of the table below reports/, and a condition for the rows that are
compared with the truth. The condition selects records whose true law is among those that the answer compares."""


def contradictions(page: Path) -> list[str]:
    """Return a sentence for each contradiction of a report (a folder under reports/) with the truth of its records."""
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
