"""What the models' probabilities are worth: confusion, reliability, log score, hits against what was expected."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from itertools import pairwise
from typing import Any

import numpy as np
from scipy.stats import binomtest

from bayesdamp.calibrate import statistics
from bayesdamp.calibrate.tables import ALARM
from bayesdamp.store import CellResult
from bayesdamp.store.contents import RecoveryContent
from bayesdamp.types import OK

EDGES = (0.0, 0.3, 0.5, 0.7, 0.9, 0.99, 1.0)
"""Bins of the highest probability."""

Row = dict[str, Any]
RECORD_COLUMNS = ("series", "record", "noise", "cycles", "loss", "model", "outcome", "doubts")
"""Of recovery.csv; a column for each damping sum follows."""


def record_table(found: Mapping[str, Sequence[CellResult]]) -> tuple[tuple[str, ...], Iterator[Row]]:
    """Columns and rows of recovery.csv: every record that was tried, and the probability of each model."""
    models = dict.fromkeys(m for chunks in found.values() for m in RecoveryContent.of(chunks[0]).models)
    columns = (*RECORD_COLUMNS, *models)
    return columns, _rows(found)


def _rows(found: Mapping[str, Sequence[CellResult]]) -> Iterator[Row]:
    for name, chunks in found.items():
        for c in chunks:
            content = RecoveryContent.of(c)
            models = content.models
            for i, outcome in enumerate(content.outcomes):
                noise, cycles = c.arrays["design"][i]
                head = {
                    "series": name,
                    "record": content.first + i,
                    "noise": float(noise),
                    "cycles": float(cycles),
                }
                head |= {"loss": round(float(c.arrays["loss"][i]), 4), "model": models[c.arrays["model"][i]]}
                doubts = sum(said != OK for said in content.evidence_outcomes[i]) if outcome == OK else None
                shares = {m: float(f"{p:.6g}") for m, p in zip(models, c.arrays["probability"][i])}
                yield {**head, "outcome": outcome, "doubts": doubts, **shares}


def about(found: Mapping[str, Sequence[CellResult]]) -> Row:
    """What run.json holds of a model recovery, by series."""
    return {"alarm": ALARM, **{name: _judged(chunks) for name, chunks in found.items()}}


def _judged(chunks: Sequence[CellResult]) -> Row:
    contents = [RecoveryContent.of(c) for c in chunks]
    models = contents[0].models
    good = np.concatenate([c.accepted for c in contents]).astype(bool)
    truth, p, design = (
        np.concatenate([c.arrays[name] for c in chunks])[good] for name in ("model", "probability", "design")
    )
    outcomes = Counter(o for c in contents for o in c.outcomes)
    said = [s for c in contents for one, ok in zip(c.evidence_outcomes, c.accepted) for s in one if ok]
    top = p.argmax(axis=1)
    hit, height = top == truth, p.max(axis=1)
    right = p[np.arange(truth.size), truth]
    confusion = np.zeros((len(models), len(models)), int)
    np.add.at(confusion, (truth, top), 1)
    return {
        "models": models,
        "tried": sum(outcomes.values()),
        "counted": outcomes.pop(OK, 0),
        "refused": dict(outcomes),
        "evidences": len(said),
        "doubtful": sum(s != OK for s in said),
        "confusion": confusion,
        "hits": _hits(hit, height),
        "bins": _bins(hit, height),
        "by_model": _by_model(models, truth, p),
        "log_score": float(np.mean(np.log(np.maximum(right, 1e-300)))) if right.size else math.nan,
        "log_score_expected": float(np.mean(np.sum(p * np.log(np.maximum(p, 1e-300)), axis=1))),
        "log_score_ignorant": -math.log(len(models)),
        "by_design": _by_design(hit, height, design),
        "seconds": sum(c.seconds for c in chunks),
    }


def _hits(hit: np.ndarray, p: np.ndarray) -> Row:
    """How often the most probable model was the true one, against the sum of its probabilities."""
    n, hits = hit.size, int(hit.sum())
    low, high = statistics.hits_band(p, 1 - ALARM)
    share = binomtest(hits, n).proportion_ci(0.95, "exact") if n else None
    return {
        "records": n,
        "hits": hits,
        "expected": float(p.sum()),
        "excess": float(hits - p.sum()),
        "low": low - float(p.sum()),
        "high": high - float(p.sum()),
        "sd": float(np.sqrt(np.sum(p * (1 - p)))),
        "p": statistics.hits_p(hits, p),
        "share_low": share.low if share else math.nan,
        "share_high": share.high if share else math.nan,
    }


def _bins(hit: np.ndarray, p: np.ndarray) -> list[Row]:
    """By the probability of the most probable model; bands of 1 − alarm for all bins together (Bonferroni)."""
    place = np.clip(np.searchsorted(EDGES, p, side="left") - 1, 0, len(EDGES) - 2)
    found = []
    used = len(set(place.tolist()))
    for k, (low, high) in enumerate(pairwise(EDGES)):
        inside = place == k
        if not inside.any():
            continue
        least, most = statistics.hits_band(p[inside], 1 - ALARM / used)
        n = int(inside.sum())
        found.append(
            {
                "from": low,
                "to": high,
                "records": n,
                "probability": float(p[inside].mean()),
                "share": float(hit[inside].mean()),
                "low": least / n,
                "high": most / n,
                "p": statistics.hits_p(int(hit[inside].sum()), p[inside]),
            }
        )
    for row, adjusted in zip(found, statistics.holm([r["p"] for r in found])):
        row["p_holm"] = float(adjusted)
    return found


def _by_model(models: Sequence[str], truth: np.ndarray, p: np.ndarray) -> list[Row]:
    """How often each model was the true one, against the sum of the probabilities that it was given."""
    found = []
    for m, name in enumerate(models):
        hits, expected = int(np.sum(truth == m)), float(p[:, m].sum())
        found.append(
            {"model": name, "true": hits, "expected": expected, "p": statistics.hits_p(hits, p[:, m])}
        )
    for row, adjusted in zip(found, statistics.holm([r["p"] for r in found])):
        row["p_holm"] = float(adjusted)
    return found


def _by_design(hit: np.ndarray, p: np.ndarray, design: np.ndarray) -> list[Row]:
    found = []
    for noise, cycles in sorted(set(map(tuple, design.tolist()))):
        here = np.all(design == (noise, cycles), axis=1)
        found.append(
            {
                "noise": noise,
                "cycles": cycles,
                "records": int(here.sum()),
                "share": float(hit[here].mean()),
                "probability": float(p[here].mean()),
            }
        )
    return found
