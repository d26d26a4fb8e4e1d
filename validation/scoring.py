"""Let peers answer records with a known truth, one table row for each record and peer; score the rows, and write pages.

A peer is a method that answers: bayesdamp with certain options, or another program.
"""

import argparse
import math
import sys
import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from concurrent.futures import as_completed
from contextlib import nullcontext
from itertools import starmap
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
from scipy.stats import norm

from bayesdamp.formatting import digits, markdown_table
from bayesdamp.machine import processes
from bayesdamp.types import OK, InputError, Refusal, Signal
from bayesdamp.verdict.types import Verdict
from validation.truth.oscillator import SUMS
from validation.truth.records import Case

Z = float(norm.ppf(0.975))
"""Quantile of the standard normal distribution for a two-sided 95 % interval."""
AMPLITUDES = 3
"""Largest number of amplitudes of a record at which an answer is judged."""
COLUMNS = (
    "record", "peer", "group", "damping", "outcome", "seconds", "grade", "named", "probability", "true_probability",
    "decided", "right",
    *(f"{what}_{i + 1}" for i in range(AMPLITUDES) for what in ("amplitude", "true", "value", "low", "high")),
)  # fmt: skip
"""The columns of a table of answers, with one row for each record and peer (a method that answers). `true_i`,
`value_i`, `low_i` and `high_i` are the true damping ratio at the amplitude `amplitude_i`, the ratio in the answer, and
its 95 % interval. `named`: the most probable damping according to the answer. `decided`: 1 if the answer states this
damping without reservation (named outright), otherwise 0. `right`: 1 if it is the true damping, otherwise 0."""


Peer = Callable[[Signal, tuple[float, ...]], Verdict]
"""A method that answers records, as a function: it maps the record, and amplitudes in its unit, to a verdict. If the
method has no answer, it raises Refusal or InputError, or the verdict has no damping ratio."""
Work = Callable[..., Mapping[str, Any]]
"""A function that computes one row of a table, as a mapping from columns to values. It must be importable by its name,
because other processes call it."""


def row_of(case: Case, peer: Peer, name: str = "bayesdamp") -> dict[str, Any]:
    """Let a peer (a method) answer a record; return a row of the table, with values of `COLUMNS`: answer and truth.

    case: the record and its truth. name: name of the peer. The column `seconds` is the CPU time of the answer in s. If
    there is no answer, `outcome` is the reason.
    """
    row: dict[str, Any] = {"record": case.name, "peer": name, "group": case.group, "damping": case.damping}
    row |= {"outcome": OK, "decided": 0, "right": 0}
    began, amplitudes = time.process_time(), case.amplitudes
    try:
        verdict = peer(case.signal, amplitudes)
        if not verdict.damping_ratio:
            raise Refusal(verdict.sentence)
    except (InputError, Refusal) as refusal:
        row["outcome"] = str(refusal)
    else:
        amplitudes = tuple(at.amplitude for at in verdict.damping_ratio)
        row |= {
            "grade": verdict.grade, "named": verdict.damping, "probability": verdict.probability,
            "true_probability": probability_of(verdict, case.damping), "decided": int(verdict.decided),
            "right": int(terms_of(verdict.damping) == terms_of(case.damping)),
        }  # fmt: skip
        for i, at in enumerate(verdict.damping_ratio, 1):
            row |= {f"value_{i}": at.value, f"low_{i}": at.low, f"high_{i}": at.high}
    row["seconds"] = time.process_time() - began
    if case.ratio is not None:
        for i, amplitude in enumerate(amplitudes, 1):
            row |= {f"amplitude_{i}": amplitude, f"true_{i}": case.ratio(amplitude)}
    return row


def terms_of(damping: str) -> frozenset[str]:
    """Return the names of the terms of a damping sum such as "viscous+coulomb", without their order."""
    return frozenset(damping.split("+"))


def probability_of(verdict: Verdict, damping: str) -> float:
    """Return the probability that a verdict gives to a damping sum.

    The sums that the verdict does not list share the remaining probability equally.
    """
    listed = {terms_of(name): float(p) for name, p in verdict.probabilities.items()}
    unlisted = sum(terms_of(name) not in listed for name in SUMS)
    return listed.get(terms_of(damping), max(1.0 - sum(listed.values()), 0.0) / max(unlisted, 1))


# --- scores ---


class Share(NamedTuple):
    """A fraction of hits among trials, with its 95 % interval; all three numbers are NaN if there were no trials."""

    value: float
    low: float
    high: float

    def __str__(self) -> str:
        """Return the share with its interval as text; a dash if it is NaN."""
        return "–" if math.isnan(self.value) else f"{self.value:.2f} ({self.low:.2f}–{self.high:.2f})"


def share(hits: float, count: int) -> Share:
    """Return the share of hits in a number of trials, with its interval (Wilson 1927); NaN if the number is 0.

    SciPy's function requires a whole number of hits. Here the number of hits need not be whole, because a record counts
    as the fraction of its intervals that contain the truth.
    """
    if not count:
        return Share(math.nan, math.nan, math.nan)
    value, spread = float(hits / count), 1 + Z**2 / count
    middle = (value + Z**2 / (2 * count)) / spread
    half = Z * math.sqrt(value * (1 - value) / count + Z**2 / (4 * count**2)) / spread
    return Share(value, max(middle - half, 0.0), min(middle + half, 1.0))


def hits_of(hits: int, count: int) -> str:
    """Return text such as "8 of 10 (0.49–0.94)", with the 95 % interval of the share; a dash if `count` is 0."""
    part = share(hits, count)
    return f"{hits} of {count} ({part.low:.2f}–{part.high:.2f})" if count else "–"


def three(rows: pd.DataFrame, what: str) -> np.ndarray:
    """Return a quantity at the three amplitudes of each row, shape (n, 3): the columns `what`_1 to `what`_3."""
    return rows[[f"{what}_{i + 1}" for i in range(AMPLITUDES)]].to_numpy(float)


def coverage(rows: pd.DataFrame) -> Share:
    """Return the coverage of the 95 % intervals of damping ratios: the fraction that contains the truth, by records.

    For each record with intervals, the fraction of its intervals that contain the truth is computed; the result is the
    mean over these records. Its own interval counts each record as one trial, because the ratios of a record are not
    independent.
    """
    low, true, high = (three(rows, what) for what in ("low", "true", "high"))
    stated = np.isfinite(low) & np.isfinite(high)
    inside = np.sum(stated & (low <= true) & (true <= high), axis=1)
    count = stated.sum(axis=1)
    return share(np.sum(inside[count > 0] / count[count > 0]), int(np.sum(count > 0)))


def errors(rows: pd.DataFrame) -> np.ndarray:
    """Return |estimate/truth − 1| of the damping ratio at the amplitudes of each row, shape (n, 3)."""
    return np.abs(three(rows, "value") / three(rows, "true") - 1)


def named(rows: pd.DataFrame, right: int | None = None) -> int:
    """Return how many answers state one damping without reservation (named outright).

    right: 1 to count only those that state the true damping, 0 only those that state a wrong one; by default all.
    """
    decided = rows.loc[rows["decided"] == 1]
    return len(decided if right is None else decided.loc[decided["right"] == right])


def _percent(values: np.ndarray, level: float = 0.5) -> str:
    """Return the quantile at `level` (0 to 1) of the finite values as text in per cent."""
    return f"{digits(100 * pd.Series(values.ravel()).quantile(level), n=2)} %"


def _true_probability(rows: pd.DataFrame) -> str:
    p = rows["true_probability"].dropna()
    return f"{p.mean():.3f} ± {p.sem():.3f}" if len(p) > 1 else "–"


SCORES: Mapping[str, Callable[[pd.DataFrame], object]] = {
    "records": len,
    "answered": lambda rows: int(np.sum(rows["outcome"] == OK)),
    "named outright": lambda rows: hits_of(named(rows), len(rows)),
    "of these correctly": lambda rows: hits_of(named(rows, right=1), named(rows)),
    "named outright, correctly": lambda rows: hits_of(named(rows, right=1), len(rows)),
    "named outright, wrongly": lambda rows: hits_of(named(rows, right=0), len(rows)),
    "true sum most probable": lambda rows: hits_of(int(np.sum(rows["right"])), len(rows)),
    "coverage": coverage,
    "median error": lambda rows: _percent(errors(rows)),
    "90 % quantile": lambda rows: _percent(errors(rows), 0.9),
    "median half width": lambda rows: _percent(0.5 * (three(rows, "high") - three(rows, "low")) / three(rows, "true")),
    "deviates": lambda rows: int(np.sum(rows["grade"] == "deviates")),
    "mean P(truth)": _true_probability,
    "CPU seconds": lambda rows: digits(float(np.median(rows["seconds"])), n=2),
}  # fmt: skip
"""The columns of a table of scores, by header: each is a function that maps the rows of a group to the content of the
cell. "Named outright" means that an answer states one damping without reservation; "deviates" is the number of answers
which warn that the laws do not hold; "P(truth)" is the probability that the answer gives to the true damping."""


def score_table(
    groups: Mapping[str, pd.DataFrame],
    *scores: str,
    more: Mapping[str, Callable[[pd.DataFrame], object]] | None = None,
) -> str:
    """Return a Markdown table with a line for each group of rows that is not empty.

    groups: rows of each group, by its name. scores: columns of the table, as names of `SCORES`. more: further columns;
    as in `SCORES`, a function of the rows for each header.
    """
    columns = {name: SCORES[name] for name in scores} | dict(more or {})
    lines = [
        [name, *(str(score(rows)) for score in columns.values())]
        for name, rows in groups.items()
        if len(rows)
    ]
    return markdown_table(["", *columns], lines)


def groups_of(
    rows: pd.DataFrame, column: str = "group", order: Iterable[str] = ()
) -> dict[str, pd.DataFrame]:
    """Group rows by the value of a column; return the rows of each group by this value.

    order: the values, in the order of the result (a group may then be empty); by default all values, in the order in
    which they occur.
    """
    return {str(name): rows.loc[rows[column] == name] for name in (order or rows[column].unique())}


# --- tables and pages ---


def read_rows(table: Path, columns: Sequence[str] = ()) -> pd.DataFrame:
    """Return the rows of a CSV file, with NaN for empty fields; no rows if there is no file.

    Raises InputError if `columns` are given and the file has others.
    """
    if not table.is_file():
        return pd.DataFrame(columns=list(columns))
    rows = pd.read_csv(table, keep_default_na=False, na_values=[""])
    if columns and list(rows.columns) != list(columns):
        raise InputError(f"{table}: the columns differ from those of the rows to be added; give another file")
    return rows


def complete_rows(
    table: Path,
    todo: Mapping[str, tuple[Any, ...]],
    work: Work,
    columns: Sequence[str] = COLUMNS,
    workers: int = 2,
) -> pd.DataFrame:
    """Compute and append the rows that a table lacks; return all requested rows in the requested order.

    Each row is saved as soon as it is computed, so that an interrupted run resumes. Numbers have six digits.

    Parameters
    ----------
    table : Path
        The CSV file. It may not exist yet.
    todo : mapping
        The requested rows: by the name of each, such as "family-1/bayesdamp" (record and peer), the arguments with
        which `work` computes it.
    work : callable
        Function that returns a row.
    columns : sequence of str
        The columns of the table.
    workers : int
        Number of processes; 1 computes in this process.

    Raises
    ------
    InputError
        The table has other columns.
    """

    def by_name() -> pd.DataFrame:
        rows = read_rows(table, columns)
        return rows.set_index(rows["record"] + "/" + rows["peer"])

    done = set(by_name().index)
    missing = [given for name, given in todo.items() if name not in done]
    with processes(workers) if min(workers, len(missing)) > 1 else nullcontext() as pool:
        tasks = [pool.submit(work, *given) for given in missing] if pool else []
        results = (task.result() for task in as_completed(tasks)) if pool else starmap(work, missing)
        for i, row in enumerate(results, 1):
            assert row.keys() <= set(columns), row
            line = pd.DataFrame([row], columns=list(columns))
            line.to_csv(table, index=False, float_format="%.6g", mode="a", header=not table.is_file())
            print(f"{i}/{len(missing)} {row['record']} {row.get('named', row['outcome'])}", file=sys.stderr)
    return by_name().loc[list(todo)].reset_index(drop=True)


def page_options(description: str | None, **numbers: int) -> argparse.ArgumentParser:
    """Return the parser of the command line that makes a page.

    Its options are the table of rows, the folder of the page, the number of processes (`--workers`), and those in
    `numbers`. description: text for `--help`. numbers: names and default values of further options, whose values are
    whole numbers.
    """
    parser = argparse.ArgumentParser(description=description)
    parser.add_argument("table", type=Path, help="CSV file of the rows; missing rows are added")
    parser.add_argument("folder", type=Path, help="folder of the page")
    for name, default in {"workers": 2, **numbers}.items():
        parser.add_argument(f"--{name}", type=int, default=default)
    return parser


def make_page(
    options: argparse.Namespace,
    todo: Mapping[str, tuple[Any, ...]],
    work: Work,
    page: Callable[[pd.DataFrame], str],
    columns: Sequence[str] = COLUMNS,
    shipped: str = "rows.csv",
) -> None:
    """Compute the rows that the table lacks; write the page (README.md) and the requested rows into its folder.

    Parameters
    ----------
    options : Namespace
        The parsed options of `page_options`.
    todo, work, columns
        Requested rows, function that computes one, and columns of the table, as in `complete_rows`.
    page : callable
        Function that returns the page in Markdown, from the rows.
    shipped : str
        Name of the CSV file in the folder to which the requested rows are written.
    """
    for folder in (options.table.parent, options.folder):
        folder.mkdir(parents=True, exist_ok=True)
    rows = complete_rows(options.table, todo, work, columns, options.workers)
    rows.to_csv(options.folder / shipped, index=False, float_format="%.6g")
    (options.folder / "README.md").write_text(page(rows), encoding="utf-8")
