"""Compare the statements of shipped pages on simulated records with the truth of these records.

Every comparison returns a list with a sentence for each contradiction.
"""

import json
import math
import re
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np
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
INTERVAL = ("record", "what", "low", "high", "truth")
"""Columns of a table of 95 % intervals for values whose truth is known; `what` is the value in words."""
RADIANS = {"rad": 1.0, "deg": math.pi / 180}
"""Size in rad of each unit in which a page gives an amplitude."""


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


def of_study(folder: Path) -> list[str]:
    """Return the contradictions between a study's verdicts, and posteriors and the truth of its records.

    folder: the results of the study; only its simulated records are compared.
    """
    run = json.loads((folder / "run.json").read_text(encoding="utf-8"))
    signals = {
        s["name"]: s for s in run.get("study", {}).get("signals", []) if "truth" in (s.get("source") or {})
    }
    file = folder / "verdict.json"
    verdicts = json.loads(file.read_text(encoding="utf-8")) if file.is_file() else []
    wrong, ratios = [], []
    for verdict in verdicts:
        record, damping = verdict["record"], verdict["damping"]
        # Records that are repeats have a number after the name of their signal.
        names = [n for n in signals if record == n or re.fullmatch(re.escape(n) + r"[^A-Za-z0-9].*", record)]
        if not names:
            continue
        signal = signals[max(names, key=len)]
        true = frozenset(signal["source"]["damping"])
        if verdict["decided"] and terms_of(damping) != true:
            wrong.append(f"{record}: {damping} is named, but the truth is {'+'.join(sorted(true))}")
        if damping and not verdict["decided"]:
            listed = (verdict, *verdict["rivals"])
            own = sum(r["probability"] for r in listed if terms_of(r["damping"]) == true)
            if own < EXCLUDED:
                wrong.append(
                    f"{record}: the true damping, {'+'.join(sorted(true))}, has a probability of {own:.2g}"
                )
        oscillator = oscillator_of(signal)
        for r in verdict["damping_ratio"]:
            if oscillator and r["unit"] in RADIANS:
                truth = true_ratio(oscillator, r["amplitude"] * RADIANS[r["unit"]])
                what = f"damping ratio at {r['amplitude']:.3g} {r['unit']}"
                ratios.append((record, what, r["low"], r["high"], truth))
    for intervals in (ratios, _posteriors(folder, signals)):
        wrong += misses(pd.DataFrame(intervals, columns=INTERVAL))
    return wrong


def oscillator_of(signal: Mapping[str, Any]) -> Oscillator | None:
    """Return the true oscillator of a simulated record, an entry `signal` of a study in run.json.

    None if it has a term or law that `validation.truth` does not contain.
    """
    truth, damping = signal["source"]["truth"], signal["source"]["damping"]
    law = signal["system"]["restoring"]
    if not set(damping) <= set(COEFFICIENTS) or law not in LAWS:
        return None
    return Oscillator(
        law,
        {name: truth[name] for name in LAWS[law]},
        {term: truth[COEFFICIENTS[term]] for term in damping},
        truth.get("epsilon", 0.0),
    )


def _posteriors(
    folder: Path, signals: Mapping[str, Mapping[str, Any]]
) -> Iterator[tuple[str, str, float, float, float]]:
    """Yield the intervals of damping coefficients in posteriors.csv, for the posteriors under the true damping."""
    for row in read_rows(folder / "posteriors.csv").to_dict("records"):
        source, name = signals.get(row["signal"], {}).get("source"), row["parameter"]
        if source is None or row["outcome"] != OK or math.isnan(row["q2.5"]):
            continue
        known = {*COEFFICIENTS.values()} & {*source["truth"]}
        if terms_of(row["model"]) == frozenset(source["damping"]) and name in known:
            what = f"{name} by {row['sampler']}"
            yield f"{row['signal']}/{row['repeat']}", what, row["q2.5"], row["q97.5"], source["truth"][name]


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
        wrong += of_study(page)
    return wrong
