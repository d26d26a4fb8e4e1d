"""Scores of the contest's rows: errors, coverage, names, time, and each peer beside ours on the same records."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import pandas as pd

from bayesdamp.types import OK
from validation.contest.records import GROUPS
from validation.scoring import share_covered, three, where, wilson

MEASURED = "measured"
TIMES = 2000
"""Bootstrap samples."""
LEAST = 5
"""Fewer records than this have no interval."""


@dataclass(frozen=True)
class Interval:
    """A number with its 95 % interval, NaN where there are too few records."""

    value: float
    low: float
    high: float


def simulated(rows: pd.DataFrame) -> pd.DataFrame:
    """The rows of records that were not measured."""
    return rows.iloc[np.flatnonzero(rows["group"].to_numpy() != MEASURED)]


def groups_of(rows: pd.DataFrame) -> list[str]:
    """Groups among rows, in the contest's order."""
    there = set(rows["group"])
    return [g for g in (*GROUPS, MEASURED) if g in there]


def has(value: object) -> bool:
    """Whether a cell has a text."""
    return isinstance(value, str) and value != ""


def errors(rows: pd.DataFrame) -> np.ndarray:
    """|found/true − 1| of the ratio at three amplitudes, shape (n, 3); NaN in rows without an answer."""
    found, true = three(rows, "value"), three(rows, "ratio")
    return np.where((rows["outcome"] == OK).to_numpy()[:, None], np.abs(found / true - 1), np.nan)


def quantile_of_errors(rows: pd.DataFrame, level: float) -> Interval:
    """A quantile of all errors of the records that were answered; records are drawn again, with their three errors."""
    each = errors(where(rows, outcome=OK))
    return bootstrapped(each, lambda chosen: np.quantile(chosen, level, axis=-1))


def coverage(rows: pd.DataFrame) -> tuple[Interval, int]:
    """Mean share of the three true ratios within a stated interval, Wilson's by records, and how many state one."""
    share = share_covered(rows)
    stated = share[np.isfinite(share)]
    if not stated.size:
        return Interval(np.nan, np.nan, np.nan), 0
    mean = float(np.mean(stated))
    return Interval(mean, *wilson(mean, stated.size)), stated.size


def names(rows: pd.DataFrame) -> tuple[int, int, int]:
    """Records of a known damping that were answered, of these those in which one was named, and of these the right."""
    answered = where(rows, outcome=OK)
    known = [
        (n, r)
        for d, n, r in zip(*(answered[c] for c in ("damping", "named", "relation")), strict=True)
        if has(d)
    ]
    return len(known), sum(bool(n) for n, _ in known), sum(r == "right" for _, r in known)


def paired(rows: pd.DataFrame, peer: str, ours: str) -> tuple[Interval, int]:
    """Error of a peer over that of ours, in the same records: the geometric mean of ratios of mean errors, and records.

    Above 1 where ours is nearer to the truth. Records that either refused are left out.
    """
    theirs, own = _of_both(rows, peer, ours, lambda part: np.mean(errors(part), axis=1))
    found = bootstrapped(np.log(theirs / own)[:, None], lambda chosen: np.exp(np.mean(chosen, axis=-1)))
    return found, theirs.size


def holds_more(rows: pd.DataFrame, peer: str, ours: str) -> Interval:
    """Return by how much larger a share of true ratios a peer's intervals hold than ours, in the same records."""
    theirs, own = _of_both(rows, peer, ours, share_covered)
    return bootstrapped((theirs - own)[:, None], lambda chosen: np.mean(chosen, axis=-1))


def bootstrapped(values: np.ndarray, statistic: Callable[[np.ndarray], np.ndarray]) -> Interval:
    """A statistic of values (records, m), and the 2.5 and 97.5 % of it over records drawn again with a fixed seed.

    statistic: over the last axis.
    """
    if not values.size:
        return Interval(np.nan, np.nan, np.nan)
    middle = float(statistic(values.ravel()))
    if len(values) < LEAST:
        return Interval(middle, np.nan, np.nan)
    chosen = np.random.default_rng(0).integers(len(values), size=(TIMES, len(values)))
    low, high = np.quantile(statistic(values[chosen].reshape(TIMES, -1)), [0.025, 0.975])
    return Interval(middle, float(low), float(high))


def _of_both(
    rows: pd.DataFrame, peer: str, ours: str, score: Callable[[pd.DataFrame], np.ndarray]
) -> tuple[np.ndarray, np.ndarray]:
    """Return a score of a peer and of ours, each of shape (n,), on the records for which both have one."""
    scores = []
    for name in (peer, ours):
        part = where(rows, peer=name, outcome=OK)
        scores.append({r: x for r, x in zip(part["record"], score(part), strict=True) if np.isfinite(x)})
    both = [record for record in scores[0] if record in scores[1]]
    theirs, own = (np.array([by[record] for record in both]) for by in scores)
    return theirs, own
