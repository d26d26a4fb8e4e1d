"""Compare the statements of shipped pages on simulated records with the truth of these records.

Every comparison returns a list with a sentence for each contradiction.
"""

from __future__ import annotations

import html
import json
import math
import re
from collections import defaultdict
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from scipy.integrate import quad
from scipy.optimize import root_scalar
from scipy.stats import binom, poisson

from bayesdamp.priors import odds
from bayesdamp.types import OK
from validation.rows import read_rows
from validation.truth.oscillator import COEFFICIENTS, LAWS, Oscillator

EXCLUDED = 0.05
"""A record that is not decided excludes the true damping if its probability is below this value."""
MISSED = 0.05
"""Fraction of 95 % intervals that may miss the truth."""
ALARM = 1e-3
"""False-alarm probability of each test on many records (conventional)."""
FAR = 1.0
"""Largest distance of the truth from an interval, in widths of the interval.

For a normal distribution the truth is then 5.9 standard deviations from the middle.
"""
TIE = math.log(1.25)
"""Log odds below which two dampings count as equally probable."""

Rows = Sequence[Mapping[str, Any]]


@dataclass(frozen=True)
class Simulated:
    """A simulated record of a study: its name, its true damping terms, the values of its parameters, its oscillator."""

    name: str
    damping: frozenset[str]
    truth: Mapping[str, float]
    oscillator: Oscillator | None

    @classmethod
    def of(cls, signal: Mapping[str, Any]) -> Simulated:
        """Read a signal of a study from run.json."""
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
        return cls(signal["name"], frozenset(damping), truth, oscillator)


@dataclass(frozen=True)
class Quoted:
    """An interval that a page gives for a value whose truth is known."""

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


def terms_of(damping: str) -> frozenset[str]:
    """Return the terms of a damping sum."""
    return frozenset(damping.split("+"))


def true_ratio(oscillator: Oscillator, amplitude: float) -> float:
    """Return the equivalent damping ratio at an amplitude in rad.

    It is the energy lost in a cycle over 4π times the energy.
    """
    potential = oscillator.potential()

    def uneven(middle: float) -> float:
        return potential(middle + amplitude) - potential(middle - amplitude)

    ends = (-0.5 * amplitude, 0.5 * amplitude)
    middle = 0.0 if uneven(0.0) == 0 else root_scalar(uneven, bracket=ends).root
    top = potential(middle + amplitude)
    zeta, friction, drag = (oscillator.damping.get(term, 0.0) for term in COEFFICIENTS)

    def lost(phase: float) -> float:
        v = math.sqrt(2 * max(top - potential(middle + amplitude * math.sin(phase)), 0.0))
        turn = math.tanh(v / oscillator.epsilon) if oscillator.epsilon else 1.0
        return 2 * (2 * zeta * v + friction * turn + drag * v * v) * amplitude * math.cos(phase)

    return float(quad(lost, -0.5 * math.pi, 0.5 * math.pi, limit=200)[0]) / (4 * math.pi * top)


def named_wrongly(
    record: str, truth: frozenset[str], decided: bool, damping: str, probabilities: Mapping[str, float]
) -> list[str]:
    """Compare the damping that a page names with the true one.

    Parameters
    ----------
    record : str
        Name of the record.
    truth : frozenset of str
        The true terms.
    decided : bool
        Whether the page names the damping outright.
    damping : str
        The first damping of the page.
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
    """Compare 95 % intervals with the truth: none may be far off, and not more may miss it than by chance.

    Only the middle interval of each record is counted, because the intervals of a record are not independent.

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
    wrong = [
        f"{quoted}: far outside" for each in by_record.values() for quoted in each if quoted.outside > FAR
    ]
    middle = [each[len(each) // 2] for each in by_record.values()]
    outside = [quoted for quoted in middle if quoted.outside > 0]
    if outside and binom.sf(len(outside) - 1, len(middle), rate) < 10 * ALARM:
        wrong += [f"{quoted}; {len(outside)} of {len(middle)} records miss the truth" for quoted in outside]
    return wrong


def of_study(folder: Path) -> list[str]:
    """Compare a study's verdicts, posteriors, evidence and page with the truth of its simulated records."""
    run = json.loads((folder / "run.json").read_text(encoding="utf-8"))
    signals = run.get("study", {}).get("signals", [])
    truths = {s["name"]: Simulated.of(s) for s in signals if "truth" in (s.get("source") or {})}
    file = folder / "verdict.json"
    verdicts = json.loads(file.read_text(encoding="utf-8")) if file.is_file() else []
    known = [(v, truths[name]) for v in verdicts if (name := _signal(v["record"], truths)) is not None]
    wrong = []
    for verdict, truth in known:
        damping = verdict["damping"]
        if not damping:
            continue
        probabilities = {r["damping"]: r["probability"] for r in verdict["rivals"]} | {
            damping: verdict["probability"]
        }
        wrong += named_wrongly(verdict["record"], truth.damping, verdict["decided"], damping, probabilities)
    wrong += misses(quoted for verdict, truth in known for quoted in _ratios(verdict, truth))
    wrong += misses(_posteriors(folder, truths))
    wrong += _other_truths(folder, truths)
    wrong += _other_leaders(folder, verdicts)
    return wrong + _not_on_the_page(folder, verdicts)


def _signal(record: str, truths: Mapping[str, Simulated]) -> str | None:
    """Return the name of a record's signal. Records that are repeats have a number after this name."""
    names = [n for n in truths if record == n or re.fullmatch(re.escape(n) + r"[^A-Za-z0-9].*", record)]
    return max(names, key=len, default=None)


def _ratios(verdict: Mapping[str, Any], truth: Simulated) -> list[Quoted]:
    """Return the intervals of the damping ratios in a verdict, with their true values."""
    scale = {"rad": 1.0, "deg": math.pi / 180}
    if truth.oscillator is None:
        return []
    return [
        Quoted(
            verdict["record"], f"damping ratio at {r['amplitude']:.3g} {r['unit']}", r["low"], r["high"],
            true_ratio(truth.oscillator, r["amplitude"] * scale[r["unit"]]),
        )
        for r in verdict["damping_ratio"]
        if r["unit"] in scale
    ]  # fmt: skip


def _posteriors(folder: Path, truths: Mapping[str, Simulated]) -> list[Quoted]:
    """Return the posterior intervals of damping coefficients under the true damping."""
    intervals = []
    for row in read_rows(folder / "posteriors.csv"):
        truth = truths.get(row["signal"])
        if (
            truth is None
            or row["outcome"] != OK
            or not row["q2.5"]
            or terms_of(row["model"]) != truth.damping
        ):
            continue
        if row["parameter"] in COEFFICIENTS.values() and row["parameter"] in truth.truth:
            name, value = f"{row['signal']}/{row['repeat']}", truth.truth[row["parameter"]]
            what = f"{row['parameter']} by {row['sampler']}"
            intervals.append(Quoted(name, what, float(row["q2.5"]), float(row["q97.5"]), value))
    return intervals


def _other_truths(folder: Path, truths: Mapping[str, Simulated]) -> list[str]:
    """Compare the true values in estimates.csv with those in the study."""
    wrong = set()
    for row in read_rows(folder / "estimates.csv"):
        truth = truths.get(row["signal"])
        if truth is None or not row["truth"] or row["parameter"] not in truth.truth:
            continue
        own = truth.truth[row["parameter"]]
        if not math.isclose(float(row["truth"]), own, rel_tol=1e-9, abs_tol=1e-15):
            wrong.add(
                f"{row['signal']}: estimates.csv states {row['parameter']} = {row['truth']}, but it is {own:g}"
            )
    return sorted(wrong)


def _other_leaders(folder: Path, verdicts: Rows) -> list[str]:
    """Compare the most probable damping of each verdict with that of each method in evidence.csv."""
    logs: dict[tuple[str, str], dict[str, list[float]]] = defaultdict(lambda: defaultdict(list))
    for row in read_rows(folder / "evidence.csv"):
        if row["outcome"] == OK and row["log_evidence"]:
            value = float(row["log_evidence"]) + math.log(odds(row["model"].split("+")))
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


def _not_on_the_page(folder: Path, verdicts: Rows) -> list[str]:
    """Return the records whose verdict is not quoted on the page."""
    page = folder / "report.html"
    if not verdicts or not page.is_file():
        return []
    plain = re.sub(r"<(script|style).*?</\1>", "", page.read_text(encoding="utf-8"), flags=re.DOTALL)
    text = " ".join(html.unescape(re.sub(r"<[^>]+>", "", plain)).split())
    lost = [v["record"] for v in verdicts if v["sentence"] and " ".join(v["sentence"].split()) not in text]
    return [f"{record}: the page does not contain the sentence of its verdict" for record in lost]


def of_many(records: Iterable[tuple[frozenset[str], bool, str, float, float | None]], what: str) -> list[str]:
    """Test how many records of a table have a wrong damping named outright, or exclude the true damping.

    The first number is compared with the sum of 1 − probability, the second with 5 % of the records.

    Parameters
    ----------
    records : iterable of tuple
        For each record: the true terms, whether the damping is named outright, the first damping, its probability, and
        the probability of the true damping, or None if the table does not have it.
    what : str
        Name of the table, for the sentences.
    """
    every = list(records)
    decided = [(terms_of(first) == truth, p) for truth, sure, first, p, _ in every if sure]
    wrong, expected = sum(not right for right, _ in decided), sum(1 - p for _, p in decided)
    sentences = []
    if wrong and poisson.sf(wrong - 1, expected) < ALARM:
        sentences.append(
            f"{what}: {wrong} of {len(decided)} are named wrongly, but {expected:.2g} are expected"
        )
    own = [p for *_, p in every if p is not None]
    excluded = sum(p < EXCLUDED for p in own)
    if excluded and binom.sf(excluded - 1, len(own), EXCLUDED) < ALARM:
        sentences.append(f"{what}: {excluded} of {len(own)} exclude the true damping")
    return sentences


def of_rows(table: Path, kind: str) -> list[str]:
    """Compare the rows of one kind in a table of `validation.run` with their truth."""
    rows = [r for r in read_rows(table) if r["kind"] == kind and r["outcome"] == OK]
    records = [
        (
            terms_of(r["damping"]),
            r["decided"] == "True",
            r["named"],
            float(r["probability"]),
            float(p) if p else None,
        )
        for r in rows
        if (p := r["true_probability"]) is not None and r["probability"]
    ]
    intervals = [
        Quoted(
            f"{r['case']}/{r['mode']}", "ratio", float(r["low_2"]), float(r["high_2"]), float(r["ratio_2"])
        )
        for r in rows
        if r["low_2"]
    ]
    return of_many(records, table.parent.name) + misses(intervals)


def of_laws(table: Path) -> list[str]:
    """Compare the rows of the report on further damping terms with their truth."""
    rows = read_rows(table)
    answered = [r for r in rows if r["first"]]
    records = [
        (terms_of(r["truth"]), r["decided"] == "1", r["first"], float(r["probability"]), None)
        for r in answered
    ]
    exponents = [r for r in rows if r["term"] == "exponent" and r["exponent_low"]]
    intervals = [
        Quoted(r["case"], "exponent", float(r["exponent_low"]), float(r["exponent_high"]), float(r["truth"]))
        for r in exponents
    ]
    return of_many(records, table.parent.name) + misses(intervals)


def of_misfit(table: Path) -> list[str]:
    """Compare the rows of the report on misfits with their truth: those called right, and those of clean records."""
    rows = read_rows(table)
    wrong = [r for r in rows if r["outcome"] == "right" and terms_of(r["damping"]) != terms_of(r["truth"])]
    sentences = [f"{r['case']}: {r['damping']} is called right, but the truth is {r['truth']}" for r in wrong]
    records = [
        (
            terms_of(r["truth"]),
            r["outcome"] in ("right", "wrong"),
            r["damping"],
            float(r["probability"]),
            None,
        )
        for r in rows
        if r["kind"] == "clean" and r["damping"]
    ]
    return sentences + of_many(records, table.parent.name)


def of_recovery(table: Path) -> list[str]:
    """Compare the probabilities of a model recovery with the true dampings of its records."""
    rows = [r for r in read_rows(table) if r["outcome"] == OK]
    sums = [n for n in (rows[0] if rows else {}) if terms_of(n) <= set(COEFFICIENTS)]
    records = []
    for row in rows:
        first = max(sums, key=lambda name: float(row[name]))
        p = float(row[first])
        records.append((terms_of(row["model"]), p >= 0.95, first, p, float(row[row["model"]])))
    return of_many(records, table.parent.name)


def of_light(table: Path) -> list[str]:
    """Compare the rows of the report on light damping with their truth."""
    rows = [r for r in read_rows(table) if r["outcome"] == OK]
    records = [
        (terms_of(r["truth"]), r["decided"] == "1", r["first"], float(r["p_first"]), float(r["p_truth"]))
        for r in rows
    ]
    intervals = [
        Quoted(r["record"], "ratio", float(r["low"]), float(r["high"]), float(r["true_ratio"])) for r in rows
    ]
    return of_many(records, table.parent.name) + misses(intervals)


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
    """Parse a text such as name=value,name=value to numbers by name."""
    split = (pair.partition("=") for pair in pairs.split(",") if pair)
    return {name: float(value) for name, _, value in split}


def of_document(page: Path) -> list[str]:
    """Compare the verdicts that a page of the documentation quotes with the record that its command simulates.

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
            amplitude = float(r["amplitude"]) * (math.pi / 180 if r["unit"] == "deg" else 1.0)
            what = f"damping ratio at {r['amplitude']} {r['unit']} in %"
            low, high = float(r["low"]), float(r["high"])
            intervals.append(Quoted(page.name, what, low, high, 100 * true_ratio(oscillator, amplitude)))
    return wrong + misses(intervals)


TABLES: Mapping[str, Callable[[Path], list[str]]] = {
    "deviation/rows.csv": lambda table: of_rows(table, "family"),
    "laws/laws.csv": of_laws,
    "light/rows.csv": of_light,
    "misfit/scored.csv": of_misfit,
    "model_recovery/recovery.csv": of_recovery,
}
"""Tables with many records, by folder and file, and the functions that compare them with the truth."""


def contradictions(page: Path) -> list[str]:
    """Compare a folder under reports/, or a single page, with the truth of its records."""
    if not page.is_dir():
        return of_document(page) if page.suffix == ".md" else []
    wrong = []
    for place, compare in TABLES.items():
        folder, table = place.split("/")
        if page.name == folder and (page / table).is_file():
            wrong += compare(page / table)
    run = page / "run.json"
    if run.is_file() and "kind" not in json.loads(run.read_text(encoding="utf-8")):
        wrong += of_study(page)
    return wrong
