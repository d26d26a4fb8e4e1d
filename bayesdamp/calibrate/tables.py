"""What the ranks say: one table with a p value for every claim, and what run.json and the report need beside it."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np
from scipy.stats import binom, binomtest, norm

from bayesdamp.calibrate import statistics
from bayesdamp.calibrate.ranks import LIKELIHOOD
from bayesdamp.config import Study
from bayesdamp.store import CellResult
from bayesdamp.store.contents import RanksContent
from bayesdamp.types import OK

LEVELS = (0.5, 0.8, 0.95)
ALARM = 0.01
"""Probability that anything at all in a table is called wrong although everything is right (Holm)."""
CLASSICAL = "refined estimate"
COLUMNS = (
    "model", "method", "parameter", "check", "level", "records", "without", "value", "low", "high", "p", "p_holm",
    "verdict",
)  # fmt: skip

Row = dict[str, Any]


def calibration_rows(study: Study, found: Mapping[str, Sequence[CellResult]]) -> list[Row]:
    """Rows of calibration.csv: for each model, sampler and parameter the ranks' and three intervals' checks, then the
    intervals of the refined estimates. Samplers and refined estimates are two families of tests.

    records: how many count; without: how many had no interval; value: for "ranks" the largest departure of their
    distribution function from the uniform one, for "coverage" the share that holds the truth, with what 99 % of such
    shares are between. p_holm below `ALARM` is a verdict of wrong.
    """
    rows = [row for chunks in found.values() for row in _sampler_rows(study, chunks)]
    classical = [row for chunks in found.values() for row in _classical_rows(chunks)]
    for family in (rows, classical):
        for row, p in zip(family, statistics.holm([r["p"] for r in family]), strict=True):
            row["p_holm"] = float(p)
            row |= {k: float(f"{row[k]:.6g}") for k in ("value", "low", "high", "p", "p_holm") if k in row}
            row["verdict"] = "not tested" if math.isnan(p) else "wrong" if p < ALARM else "passes"
    return rows + classical


def _sampler_rows(study: Study, chunks: Sequence[CellResult]) -> Iterator[Row]:
    table, names = study.calibration, RanksContent.of(chunks[0]).names
    for s, sampler in enumerate(table.samplers):
        for k, name in enumerate(names):
            ranks = np.concatenate([c.arrays["ranks"][:, s, k] for c in chunks])
            below = np.concatenate([c.arrays["below"][:, s, k] for c in chunks])[ranks >= 0]
            head = {"model": _model(chunks), "method": sampler, "parameter": name}
            yield {**head, **_rank_row(ranks[ranks >= 0], table.draws)}
            for level in LEVELS:
                yield {**head, **_coverage_row(np.abs(below - 0.5) <= 0.5 * level, level)}


def _model(chunks: Sequence[CellResult]) -> str:
    return RanksContent.of(chunks[0]).model


def points(draws: int) -> int:
    """Into how many equal parts the ranks' distribution function is divided where it is tested: at most 64."""
    return max(k for k in range(1, 65) if (draws + 1) % k == 0)


def _rank_row(ranks: np.ndarray, draws: int) -> Row:
    counts = statistics.histogram(ranks, draws, points(draws))
    apart = np.cumsum(counts) / max(ranks.size, 1) - np.arange(1, counts.size + 1) / counts.size
    return {
        "check": "ranks",
        "records": ranks.size,
        "without": 0,
        "value": float(apart[np.argmax(np.abs(apart))]) if ranks.size else math.nan,
        "p": statistics.uniformity_p(counts),
    }


def _coverage_row(inside: np.ndarray, level: float, without: int = 0) -> Row:
    n, hits = inside.size, int(inside.sum())
    low, high = binom.interval(1 - ALARM, n, level) if n else (math.nan, math.nan)
    return {
        "check": "coverage",
        "level": level,
        "records": n,
        "without": without,
        "value": hits / n if n else math.nan,
        "low": float(low) / n if n else math.nan,
        "high": float(high) / n if n else math.nan,
        "p": float(binomtest(hits, n, level).pvalue) if n else math.nan,
    }


def _classical_rows(chunks: Sequence[CellResult]) -> Iterator[Row]:
    """Value ± so many standard errors, as the refined estimate's Hessian gives them; none for the noise."""
    good = np.concatenate([RanksContent.of(c).accepted for c in chunks])
    for k, name in enumerate(RanksContent.of(chunks[0]).names):
        truth, value, stderr = (
            np.concatenate([c.arrays[part][:, k] for c in chunks])[good]
            for part in ("truth", "value", "stderr")
        )
        if name == LIKELIHOOD or not np.any(np.isfinite(value)):
            continue
        there = np.isfinite(stderr) & (stderr > 0)
        away = np.abs(value - truth)[there] / stderr[there]
        for level in LEVELS:
            row = _coverage_row(away <= norm.ppf(0.5 + 0.5 * level), level, int(np.sum(~there)))
            yield {"model": _model(chunks), "method": CLASSICAL, "parameter": name, **row}


RANK_COLUMNS = ("model", "sampler", "parameter", "ranks")


def rank_rows(study: Study, found: Mapping[str, Sequence[CellResult]]) -> Iterator[Row]:
    """Rows of ranks.csv: the ranks of each truth among the thinned draws, in the order of the records that count."""
    for chunks in found.values():
        for s, sampler in enumerate(study.calibration.samplers):
            for k, name in enumerate(RanksContent.of(chunks[0]).names):
                ranks = np.concatenate([c.arrays["ranks"][:, s, k] for c in chunks])
                text = " ".join(map(str, ranks[ranks >= 0].tolist()))
                yield {"model": _model(chunks), "sampler": sampler, "parameter": name, "ranks": text}


def about(study: Study, found: Mapping[str, Sequence[CellResult]], rows: Sequence[Row]) -> Row:
    """What run.json holds of a calibration: counts by model, the verdicts, and the bands of the ranks' figures."""
    table = study.calibration
    counts = {}
    for chunks in found.values():
        contents = [RanksContent.of(c) for c in chunks]
        outcomes = Counter(o for c in contents for o in c.outcomes)
        counts[_model(chunks)] = {
            "tried": sum(outcomes.values()),
            "counted": outcomes.pop(OK, 0),
            "refused": dict(outcomes),
            "samplers": {
                s: dict(Counter(o for c in contents for o in c.sampler_outcomes[s] if o))
                for s in table.samplers
            },
            "seconds": {k: sum(c.seconds[k] for c in contents) for k in ("record", *table.samplers)},
        }
    sizes = {r["records"] for r in rows if r["check"] == "ranks" and r["records"]}
    bands = {}
    for n in sorted(sizes):
        low, high = statistics.uniformity_band(n, points(table.draws), 1 - ALARM)
        one_low, one_high = binom.interval(1 - ALARM, n, 1 / table.bins)
        bands[str(n)] = {"low": low, "high": high, "bin_low": one_low, "bin_high": one_high}
    kinds = {"posterior": False, "classical": True}
    families = {
        name: _family([r for r in rows if (r["method"] == CLASSICAL) is classical])
        for name, classical in kinds.items()
    }
    return {
        "counts": counts,
        "families": families,
        "bands": bands,
        "alarm": ALARM,
        "bins": table.bins,
        "points": points(table.draws),
        "draws": table.draws,
    }


def _family(rows: Sequence[Row]) -> Row:
    tested = [r["p_holm"] for r in rows if math.isfinite(r["p_holm"])]
    wrong = sum(r["verdict"] == "wrong" for r in rows)
    return {"tests": len(tested), "wrong": wrong, "least_p_holm": min(tested, default=math.nan)}
