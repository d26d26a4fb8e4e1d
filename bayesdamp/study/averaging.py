"""Damping against amplitude, averaged over the models by their probabilities."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from scipy.special import logsumexp

from bayesdamp.config import SignalSpec, Study
from bayesdamp.store import CellResult, Store
from bayesdamp.study.staging import ASIDE
from bayesdamp.study.weighing import evidence_by_method
from bayesdamp.types import OK, Evidence

CURVE = "equivalent_ratio"
SPREAD = (np.arange(100) + 0.5) / 100
"""Levels of the quantiles that stand for the draws of a curve, with equal weight."""
COVERED = 0.95
"""Probability that the models with a posterior must hold together: the average is over these."""
LEVELS = np.array([0.025, 0.5, 0.975])


def averages(study: Study, spec: SignalSpec) -> bool:
    """Whether a signal has several models, and their posteriors and evidence were asked for."""
    asked = "nuts" in study.posterior.samplers and study.evidence.methods
    return bool(asked) and len(study.compare(spec)) > 1


def average(study: Study, spec: SignalSpec, store: Store, name: str, key: str) -> None:
    """Store the averaged curve of a signal's first repeat (`averaged/bench/0`), or why there is none."""
    store.write(_one(study, spec, store, name, key))


def _one(study: Study, spec: SignalSpec, store: Store, name: str, key: str) -> CellResult:
    models, record = study.compare(spec), f"{spec.name}/0"
    by_method = evidence_by_method(study, store, record, models)
    method = list(by_method)[-1]
    shares = probabilities(by_method[method])
    shares |= {m: 0.0 for m, e in by_method[method].items() if e.outcome.startswith(ASIDE)}
    if len(shares) < len(models):
        return CellResult(name, key, outcome="not applicable: not every model has its evidence")
    curves, grids = {}, {}
    for model in models:
        try:
            arrays = store.read(f"posterior/{record}/{model}/nuts").arrays
        except KeyError:
            arrays = {}
        if f"spread/{CURVE}" in arrays and arrays["amplitudes"].size > 1:
            curves[model], grids[model] = arrays[f"spread/{CURVE}"], arrays["amplitudes"]
    if not grids:
        return CellResult(name, key, outcome="not applicable: no model has damping against amplitude")
    covered = sum(shares[m] for m in grids)
    if covered < COVERED:
        why = f"not applicable: the models with a posterior hold {covered:.2f} of the probability, below {COVERED}"
        return CellResult(name, key, outcome=why)
    shared = np.array(sorted(set.intersection(*(set(g) for g in grids.values()))))
    found = {m: c[:, np.isin(grids[m], shared)] for m, c in curves.items()}
    arrays = {"amplitudes": shared, f"curve/{CURVE}": averaged(found, shares)}
    return CellResult(name, key, {"probabilities": shares, "method": method, "covered": covered}, arrays, OK)


def probabilities(found: Mapping[str, Evidence]) -> dict[str, float]:
    """Posterior probability of each model that has its evidence, all equally probable at the start."""
    logs = {m: e.log_evidence for m, e in found.items() if np.isfinite(e.log_evidence)}
    total = float(np.asarray(logsumexp(list(logs.values())))) if logs else 0.0
    return {m: float(np.exp(v - total)) for m, v in logs.items()}


def averaged(curves: Mapping[str, np.ndarray], shares: Mapping[str, float]) -> np.ndarray:
    """Median and central 95 % of a mixture at each of m points, rows 2.5, 50 and 97.5 %, shape (3, m).

    curves: model to values that stand for its draws with equal weight, shape (k, m); shares: the models' weights, which
    need not sum to one.
    """
    values = np.concatenate(list(curves.values()))
    weights = np.concatenate([np.full(len(c), shares[m] / len(c)) for m, c in curves.items()])
    return np.stack([_quantiles(column, weights / weights.sum()) for column in values.T], axis=-1)


def _quantiles(x: np.ndarray, weights: np.ndarray) -> np.ndarray:
    order = np.argsort(x)
    ladder = np.cumsum(weights[order]) - 0.5 * weights[order]
    return np.interp(LEVELS, ladder, x[order])
