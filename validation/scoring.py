"""Score answers to records with a known truth, by group; write the scores as a table or as Markdown."""

from __future__ import annotations

import math
from collections.abc import Hashable, Iterator, Mapping
from typing import Any

import numpy as np
import pandas as pd
from scipy.stats import norm

from bayesdamp.formatting import markdown_table as table
from bayesdamp.types import OK
from validation.answers import COLUMNS, LEAST
from validation.truth.records import FAMILY, KINDS

Z = float(norm.ppf(0.975))
"""Quantile of the standard normal distribution for a two-sided 95 % interval."""
SHARES = ("decided", "right", "more", "wrong", "coverage", "deviates")
HEADS = {
    "group": "group", "records": "records", "answered": "answered", "decided": "named outright",
    "right": "right, of the named", "more": "true terms and further ones, of the named",
    "wrong": "named wrongly, of all", "coverage": "coverage of the ratio's intervals",
    "half_width": "half width of the intervals", "relative_width": "relative width of the intervals",
    "deviates": "deviates", "log_probability": "mean log P(true)",
    "seconds": "seconds",
}  # fmt: skip


def scores(rows: pd.DataFrame) -> pd.DataFrame:
    """Score each kind, mode and oversampling among rows from `row_of`, and all discrepancies together.

    Records without an answer count as not decided, and do not enter the other scores.

    Parameters
    ----------
    rows : DataFrame
        Rows with `COLUMNS`.

    Returns
    -------
    DataFrame
        One row for each group, with these columns. Each share has its Wilson 95 % interval in *_low and *_high.

        - decided: share of the records whose damping sum is named outright.
        - right: share of these whose named sum is the true one.
        - more: share of these whose named sum has the true terms and others. That can be correct for a record with
          a further damping force.
        - wrong: share of all records whose sum is named outright and is not the true one.
        - coverage: mean share of the three true damping ratios inside their intervals, over the records with
          intervals. Its own interval counts each record once, because the three ratios are not independent.
        - deviates: share of records with that grade.
        - half_width: geometric mean of half the width of an interval over the true ratio.
        - relative_width: geometric mean of the width over that of the same record and amplitude in mode "none".
        - log_probability: mean logarithm of the probability of the true sum, which counts as at least 1e-12.
        - seconds: median time.
    """
    rows = rows.reindex(columns=list(COLUMNS))
    exact = where(rows, mode="none", outcome=OK)
    widths = dict(zip(exact["case"], _widths(exact), strict=True))
    return pd.DataFrame([_line(name, part, widths) for name, part in _groups(rows)])


def wilson(share: float, count: float) -> tuple[float, float]:
    """Return the 95 % interval of a probability from the share of hits in a number of trials (Wilson 1927).

    SciPy's function requires a whole number of hits; a mean share of three intervals for each record has none.
    """
    if count == 0:
        return math.nan, math.nan
    spread = 1 + Z**2 / count
    middle = (share + Z**2 / (2 * count)) / spread
    half = Z * np.sqrt(share * (1 - share) / count + Z**2 / (4 * count**2)) / spread
    return float(max(middle - half, 0.0)), float(min(middle + half, 1.0))


def with_interval(value: float, low: float, high: float) -> str:
    """Format a share with its interval; a dash if the share is NaN."""
    return "–" if math.isnan(value) else f"{value:.2f} ({low:.2f}–{high:.2f})"


def share_of(hits: int, count: int) -> str:
    """Format the share of hits in a count with its 95 % interval; a dash if the count is 0."""
    value = hits / count if count else math.nan
    return with_interval(value, *wilson(value, count))


def hits_of(hits: int, count: int) -> str:
    """Format hits of a count, with the 95 % interval of their share; a dash if the count is 0."""
    if not count:
        return "–"
    low, high = wilson(hits / count, count)
    return f"{hits} of {count} ({low:.2f}–{high:.2f})"


def markdown(scores: pd.DataFrame) -> str:
    """Write the scores as a Markdown table, with the intervals of the shares."""
    return table(
        list(HEADS.values()), [[_cell(line, name) for name in HEADS] for line in scores.to_dict("records")]
    )


def _cell(line: Mapping[Hashable, Any], name: str) -> str:
    """Format one score of a group."""
    value = line[name]
    if name in SHARES:
        return with_interval(value, line[f"{name}_low"], line[f"{name}_high"])
    if not isinstance(value, float):
        return str(value)
    if math.isnan(value):
        return "–"
    return f"{100 * value:.2g} %" if name == "half_width" else f"{value:.2f}"


def _groups(rows: pd.DataFrame) -> Iterator[tuple[str, pd.DataFrame]]:
    """Yield the name and the rows of each combination of kind, mode and oversampling."""
    for mode in sorted(set(rows["mode"]), key=lambda mode: (mode != "none", mode)):
        for oversample in sorted(set(rows["oversample"])):
            part = where(rows, mode=mode, oversample=oversample)
            kinds = {kind: where(part, kind=kind) for kind in KINDS}
            if len(set(part["kind"]) - {FAMILY}) > 1:
                kinds["all discrepancies"] = part.iloc[np.flatnonzero(part["kind"] != FAMILY)]
            times = f" ×{oversample}" if oversample > 1 else ""
            yield from ((f"{kind}/{mode}{times}", chosen) for kind, chosen in kinds.items() if len(chosen))


def _line(name: str, part: pd.DataFrame, exact: Mapping[str, np.ndarray]) -> dict[str, Any]:
    """Compute the scores of a group. `exact`: widths of the intervals in mode "none", by the name of the record."""
    answered = where(part, outcome=OK)
    decided = where(answered, decided=True)
    right = len(where(decided, relation="right"))
    shares = {
        "decided": (len(decided), len(part)),
        "right": (right, len(decided)),
        "more": (len(where(decided, relation="more")), len(decided)),
        "wrong": (len(decided) - right, len(part)),
        "coverage": (np.nansum(share_covered(answered)), len(answered)),
        "deviates": (len(where(answered, grade="deviates")), len(answered)),
    }
    line: dict[str, Any] = {"group": name, "records": len(part), "answered": len(answered)}
    for key, (hits, count) in shares.items():
        line[key] = float(hits / count) if count else math.nan
        line[f"{key}_low"], line[f"{key}_high"] = wilson(line[key], count)
    widths, none = _widths(answered), np.full(3, math.nan)
    line["half_width"] = _geometric(0.5 * widths / three(answered, "ratio"))
    line["relative_width"] = _geometric(
        widths / np.reshape([exact.get(case, none) for case in answered["case"]], (-1, 3))
    )
    true, seconds = (answered[name].to_numpy(float) for name in ("true_probability", "seconds"))
    line["log_probability"] = float(np.log(np.maximum(true, LEAST)).mean()) if true.size else math.nan
    line["seconds"] = float(np.median(seconds)) if seconds.size else math.nan
    return line


def where(rows: pd.DataFrame, **values: object) -> pd.DataFrame:
    """Return the rows in which the named columns have the given values."""
    mask = np.ones(len(rows), bool)
    for column, value in values.items():
        mask &= rows[column].to_numpy() == value
    return rows.iloc[np.flatnonzero(mask)]


def three(rows: pd.DataFrame, what: str) -> np.ndarray:
    """Return a quantity at the three amplitudes of each row, shape (n, 3)."""
    return rows[[f"{what}_{i}" for i in (1, 2, 3)]].to_numpy(float)


def share_covered(rows: pd.DataFrame) -> np.ndarray:
    """Return the share of the three true ratios inside their intervals, shape (n,); NaN in rows without intervals."""
    low, true, high = (three(rows, what) for what in ("low", "ratio", "high"))
    stated = np.isfinite(low).all(axis=1) & np.isfinite(high).all(axis=1)
    return np.where(stated, np.mean((low <= true) & (true <= high), axis=1), np.nan)


def _widths(rows: pd.DataFrame) -> np.ndarray:
    """Return the widths of the intervals at the three amplitudes of each row, shape (n, 3)."""
    return three(rows, "high") - three(rows, "low")


def _geometric(values: np.ndarray) -> float:
    """Return the geometric mean of the finite values above 0."""
    good = values[np.isfinite(values) & (values > 0)]
    return float(np.exp(np.log(good).mean())) if good.size else math.nan
