"""Score answers on records with a known truth: shares with their intervals, named damping sums, coverage."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
import pandas as pd
from scipy.stats import norm

from bayesdamp.verdict.types import Verdict
from validation.truth.oscillator import SUMS

Z = float(norm.ppf(0.975))
"""Quantile of the standard normal distribution for a two-sided 95 % interval."""


@dataclass(frozen=True)
class Interval:
    """A number with its 95 % interval, which is NaN if there are too few records."""

    value: float
    low: float
    high: float

    def __str__(self) -> str:
        """Return the number with its interval as text; a dash if it is NaN."""
        return "–" if math.isnan(self.value) else f"{self.value:.2f} ({self.low:.2f}–{self.high:.2f})"


def share(hits: float, count: int) -> Interval:
    """Return the share of hits in a number of trials, with its interval (Wilson 1927); NaN if the number is 0.

    SciPy's function requires a whole number of hits. Here hits may be a fraction, because a record counts as the share
    of its three intervals that contain the truth.
    """
    if not count:
        return Interval(math.nan, math.nan, math.nan)
    value, spread = float(hits / count), 1 + Z**2 / count
    middle = (value + Z**2 / (2 * count)) / spread
    half = Z * math.sqrt(value * (1 - value) / count + Z**2 / (4 * count**2)) / spread
    return Interval(value, max(middle - half, 0.0), min(middle + half, 1.0))


def hits_of(hits: int, count: int) -> str:
    """Return text such as "8 of 10 (0.49–0.94)", with the 95 % interval of the share; a dash if `count` is 0."""
    part = share(hits, count)
    return f"{hits} of {count} ({part.low:.2f}–{part.high:.2f})" if count else "–"


def terms_of(damping: str) -> frozenset[str]:
    """Return the terms of a damping sum."""
    return frozenset(damping.split("+"))


def relation(named: str, truth: str) -> str:
    """Compare a named damping sum with the true one.

    Return "right"; "more" or "less" if it only has further terms or only lacks terms; "other" if it differs otherwise.
    """
    claimed, true = terms_of(named), terms_of(truth)
    if claimed == true:
        return "right"
    return "more" if claimed > true else "less" if claimed < true else "other"


def probability_of(answer: Verdict, damping: str) -> float:
    """Return the probability that an answer gives to a damping sum.

    The sums that the answer does not list share the remaining probability equally.
    """
    listed = {terms_of(answer.damping): float(answer.probability)}
    for rival in answer.rivals:
        listed.setdefault(terms_of(rival.damping), float(rival.probability))
    if terms_of(damping) in listed:
        return listed[terms_of(damping)]
    unlisted = sum(terms_of(name) not in listed for name in SUMS)
    return max(1.0 - sum(listed.values()), 0.0) / max(unlisted, 1)


def three(rows: pd.DataFrame, what: str) -> np.ndarray:
    """Return a quantity at the three amplitudes of each row, shape (n, 3): the columns `what`_1 to `what`_3."""
    return rows[[f"{what}_{i}" for i in (1, 2, 3)]].to_numpy(float)


def in_columns(**quantities: Iterable[float]) -> dict[str, float]:
    """Return the cells of a row with quantities at three amplitudes: ratio=(a, b, c) gives ratio_1 to ratio_3."""
    return {f"{what}_{i}": x for what, values in quantities.items() for i, x in enumerate(values, 1)}


def share_covered(rows: pd.DataFrame) -> np.ndarray:
    """Return the share of each row's three true damping ratios inside their intervals, (n,); NaN without intervals."""
    low, true, high = (three(rows, what) for what in ("low", "ratio", "high"))
    stated = np.isfinite(low).all(axis=1) & np.isfinite(high).all(axis=1)
    return np.where(stated, np.mean((low <= true) & (true <= high), axis=1), np.nan)
