"""Scores of answers to records with a known truth, by group, as a table and as Markdown."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping

import numpy as np
import pandas as pd
from scipy.stats import norm

from bayesdamp.report.markdown import table
from bayesdamp.types import OK
from validation.answers import LEAST, Row
from validation.truth.records import FAMILY, KINDS

Z = float(norm.ppf(0.975))
"""Standard normal quantile of a two-sided 95 % interval."""
SHARES = ("decided", "right", "more", "wrong", "coverage", "deviates")
HEADS = {
    "group": "group", "records": "records", "answered": "answered", "decided": "named outright",
    "right": "right among these", "more": "with a term too many", "wrong": "wrong outright, of all",
    "coverage": "coverage of the ratio's intervals", "half_width": "their half width",
    "relative_width": "their width, relative", "deviates": "deviates", "log_probability": "mean log P(true)",
    "seconds": "seconds",
}  # fmt: skip


def scores(rows: pd.DataFrame, reference: pd.DataFrame | None = None) -> pd.DataFrame:
    """A line for each kind, mode and oversampling among rows (as `row_of` makes them), and one for all discrepancies.

    decided: share of the records that name a damping sum outright; right: of these, with the true one; more: of these,
    with the true terms and others, which a record with a further damping force may well have; wrong: share of all
    records that name another sum than the true one outright; coverage: mean share of the three damping ratios within
    their intervals, over the records that have any; deviates: share with that grade. Each has Wilson's 95 % interval
    in *_low and *_high; that of the coverage counts a record once, for its three ratios are not independent.
    half_width: geometric mean of half the intervals' widths over the true ratios. relative_width: geometric mean of
    the widths over those of the same record and amplitude in `reference`, by default the rows of mode "none".
    log_probability: mean of the logarithm of the true sum's probability, at least 1e-12. seconds: median. Records
    without an answer are not decided, and count for nothing else.
    """
    all_rows = _records(rows)
    basis = [row for row in all_rows if row["mode"] == "none"] if reference is None else _records(reference)
    widths = {row["case"]: _widths([row])[0] for row in basis if row["outcome"] == OK}
    return pd.DataFrame([_line(name, part, widths) for name, part in _groups(all_rows)])


def wilson(share: float, count: float) -> tuple[float, float]:
    """Return the 95 % interval of a probability from the share among a count of trials (Wilson 1927).

    SciPy's needs a whole number of hits, which a mean share of three intervals for each record is not.
    """
    if count == 0:
        return math.nan, math.nan
    spread = 1 + Z**2 / count
    middle = (share + Z**2 / (2 * count)) / spread
    half = Z * np.sqrt(share * (1 - share) / count + Z**2 / (4 * count**2)) / spread
    return float(max(middle - half, 0.0)), float(min(middle + half, 1.0))


def with_interval(value: float, low: float, high: float) -> str:
    """Write a share with its interval; a dash if there is none."""
    return "–" if math.isnan(value) else f"{value:.2f} ({low:.2f}–{high:.2f})"


def share_of(hits: int, count: int) -> str:
    """Write the share of hits among a count with its 95 % interval; a dash if the count is 0."""
    value = hits / count if count else math.nan
    return with_interval(value, *wilson(value, count))


def markdown(scores: pd.DataFrame) -> str:
    """Write the scores as a Markdown table; shares with their intervals."""
    return table(list(HEADS.values()), [[_cell(line, name) for name in HEADS] for line in _records(scores)])


def _cell(line: Row, name: str) -> str:
    value = line[name]
    if name in SHARES:
        return with_interval(value, line[f"{name}_low"], line[f"{name}_high"])
    if not isinstance(value, float):
        return str(value)
    if math.isnan(value):
        return "–"
    return f"{100 * value:.2g} %" if name == "half_width" else f"{value:.2f}"


def _records(table: pd.DataFrame) -> list[Row]:
    return [{str(key): value for key, value in row.items()} for row in table.to_dict("records")]


def _groups(rows: list[Row]) -> Iterator[tuple[str, list[Row]]]:
    for mode in sorted({row["mode"] for row in rows}, key=lambda mode: (mode != "none", mode)):
        for oversample in sorted({row["oversample"] for row in rows}):
            part = [row for row in rows if row["mode"] == mode and row["oversample"] == oversample]
            kinds = {kind: [row for row in part if row["kind"] == kind] for kind in KINDS}
            others = [row for row in part if row["kind"] != FAMILY]
            if len({row["kind"] for row in others}) > 1:
                kinds["all discrepancies"] = others
            times = f" ×{oversample}" if oversample > 1 else ""
            yield from ((f"{kind}/{mode}{times}", chosen) for kind, chosen in kinds.items() if chosen)


def _line(name: str, part: list[Row], basis: Mapping[str, np.ndarray]) -> Row:
    answered = [row for row in part if row["outcome"] == OK]
    decided = [row for row in answered if row["decided"]]
    right = np.array([row["relation"] == "right" for row in decided], bool)
    low, high, ratio = (_three(answered, what) for what in ("low", "high", "ratio"))
    covered = np.mean((low <= ratio) & (ratio <= high), axis=1)
    shares = {
        "decided": (len(decided), len(part)),
        "right": (right.sum(), len(decided)),
        "more": (sum(row["relation"] == "more" for row in decided), len(decided)),
        "wrong": ((~right).sum(), len(part)),
        "coverage": (covered.sum(), len(answered)),
        "deviates": (sum(row["grade"] == "deviates" for row in answered), len(answered)),
    }
    line: Row = {"group": name, "records": len(part), "answered": len(answered)}
    for key, (hits, count) in shares.items():
        line[key] = float(hits / count) if count else math.nan
        line[f"{key}_low"], line[f"{key}_high"] = wilson(line[key], count)
    widths = _widths(answered)
    line["half_width"] = _geometric(0.5 * widths / ratio)
    none = np.full(3, math.nan)
    line["relative_width"] = _geometric(
        widths / np.reshape([basis.get(row["case"], none) for row in answered], (-1, 3))
    )
    true = np.array([row["true_probability"] for row in answered], float)
    line["log_probability"] = float(np.log(np.maximum(true, LEAST)).mean()) if true.size else math.nan
    line["seconds"] = float(np.median([row["seconds"] for row in answered])) if answered else math.nan
    return line


def _three(rows: list[Row], what: str) -> np.ndarray:
    return np.reshape([[row[f"{what}_{i}"] for i in (1, 2, 3)] for row in rows], (-1, 3)).astype(float)


def _widths(rows: list[Row]) -> np.ndarray:
    return _three(rows, "high") - _three(rows, "low")


def _geometric(values: np.ndarray) -> float:
    """Geometric mean of those that are finite and above 0."""
    good = values[np.isfinite(values) & (values > 0)]
    return float(np.exp(np.log(good).mean())) if good.size else math.nan
