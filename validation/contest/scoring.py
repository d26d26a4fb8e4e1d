"""Score the rows of the contest: errors, coverage, named dampings, and each peer relative to bayesdamp."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pandas as pd

from bayesdamp.types import OK
from validation.contest.records import GROUPS
from validation.rows import where
from validation.scoring import Interval, share, share_covered, three

MEASURED = "measured"
TIMES = 2000
"""Number of bootstrap samples."""
LEAST = 5
"""Least number of records for which a bootstrap interval is given."""


def simulated(rows: pd.DataFrame) -> pd.DataFrame:
    """Return the rows of simulated records."""
    return where(rows, rows["group"] != MEASURED)


def groups_of(rows: pd.DataFrame) -> list[str]:
    """Return the groups among rows, in the order of the contest."""
    present = set(rows["group"])
    return [g for g in (*GROUPS, MEASURED) if g in present]


def errors(rows: pd.DataFrame) -> np.ndarray:
    """Return |estimate/truth − 1| of the damping ratio at three amplitudes, shape (n, 3); NaN without an answer."""
    value, true = three(rows, "value"), three(rows, "ratio")
    return np.where((rows["outcome"] == OK).to_numpy()[:, None], np.abs(value / true - 1), np.nan)


def quantile_of_errors(rows: pd.DataFrame, level: float) -> Interval:
    """Return the quantile at `level` (0 to 1) of all errors of the answered records.

    Its interval is a bootstrap over records, each with its three errors.
    """
    each = errors(where(rows, outcome=OK))
    return bootstrapped(each, lambda chosen: np.quantile(chosen, level, axis=-1))


def coverage(rows: pd.DataFrame) -> tuple[Interval, int]:
    """Return the coverage of the stated intervals, and the number of records with intervals.

    It is the mean share of the three true ratios inside their intervals, with Wilson's interval by records.
    """
    covered = share_covered(rows)
    stated = int(np.isfinite(covered).sum())
    return share(np.nansum(covered), stated), stated


def names(rows: pd.DataFrame) -> tuple[int, int, int]:
    """Count the answered records of a known damping: all, those with a named damping, and those named correctly."""
    known = where(rows, rows["damping"].notna(), outcome=OK)
    return len(known), len(where(known, known["named"].notna())), len(where(known, relation="right"))


def paired(rows: pd.DataFrame, peer: str, ours: str) -> tuple[Interval, int]:
    """Return the error of a peer over that of bayesdamp on the records that both answered, and their number.

    It is the geometric mean over records of the ratio of their mean errors at three amplitudes. Above 1, bayesdamp is
    nearer to the truth.

    Parameters
    ----------
    rows : DataFrame
        The rows.
    peer, ours : str
        Names of the peer and of bayesdamp in the rows.
    """
    theirs, own = _of_both(rows, peer, ours, lambda part: np.mean(errors(part), axis=1))
    factor = bootstrapped(np.log(theirs / own)[:, None], lambda chosen: np.exp(np.mean(chosen, axis=-1)))
    return factor, theirs.size


def holds_more(rows: pd.DataFrame, peer: str, ours: str) -> Interval:
    """Return the coverage of a peer's intervals minus that of bayesdamp's, on records for which both gave any."""
    theirs, own = _of_both(rows, peer, ours, share_covered)
    return bootstrapped((theirs - own)[:, None], lambda chosen: np.mean(chosen, axis=-1))


def bootstrapped(values: np.ndarray, statistic: Callable[[np.ndarray], np.ndarray]) -> Interval:
    """Return a statistic of all values with its 95 % bootstrap interval over records, with a fixed seed.

    Parameters
    ----------
    values : (records, m) array
        The values of each record.
    statistic : callable
        Function that reduces the last axis of an array, (..., n), to the statistic.
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
    """Return the scores of a peer and of bayesdamp, each of shape (n,), on the records for which both have a score.

    score: function that maps n rows to their scores, (n,), NaN without one.
    """
    scores = []
    for name in (peer, ours):
        part = where(rows, peer=name, outcome=OK)
        scores.append({r: x for r, x in zip(part["record"], score(part), strict=True) if np.isfinite(x)})
    both = [record for record in scores[0] if record in scores[1]]
    theirs, own = (np.array([by[record] for record in both]) for by in scores)
    return theirs, own
