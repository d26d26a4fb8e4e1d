"""Damping against amplitude, averaged over the models by their probabilities."""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np
from scipy.special import logsumexp

from bayesdamp.config import SignalSpec, Study
from bayesdamp.numerics.weights import quantiles
from bayesdamp.odds import odds
from bayesdamp.outcomes import Status, status_of
from bayesdamp.pipeline.candidates.branch import Branch
from bayesdamp.pipeline.candidates.posteriors import CURVE, LEVELS, weighted_curves
from bayesdamp.pipeline.candidates.weighing import evidence_by_method
from bayesdamp.pipeline.tasks import Product, cell_seed
from bayesdamp.store import Store
from bayesdamp.store.contents import AverageContent
from bayesdamp.types import Evidence, Refusal, candidate_parts

COVERED = 0.95
"""Least total probability of the models with draws: the average is over these."""
ENOUGH = 0.99
"""Total probability from which on no further model's draws are made."""


def has_average(study: Study, spec: SignalSpec) -> bool:
    """Return whether a signal has several models, and the study asks for their posteriors and evidence."""
    is_weighed = "nuts" in study.posterior.samplers and bool(study.evidence.methods)
    return is_weighed and len(study.compare(spec)) > 1


def compute_average(study: Study, spec: SignalSpec, store: Store, name: str) -> Product:
    """Return the averaged curve of a signal's first repeat (`averaged/bench/0`). Raises Refusal where it has none."""
    models, record = study.compare(spec), f"{spec.name}/0"
    by_method = evidence_by_method(study, store, record, models)
    method = list(by_method)[-1]
    shares = probabilities(by_method[method])
    shares |= {m: 0.0 for m, e in by_method[method].items() if status_of(e.outcome) is Status.PRUNED}
    if len(shares) < len(models):
        raise Refusal("not applicable: not every model has its evidence")
    drawn: dict[str, Mapping[str, np.ndarray]] = {}
    for model in models:
        cell = store.find(f"posterior/{record}/{model}/nuts")
        if cell is not None and _has_curve(cell.arrays):
            drawn[model] = cell.arrays
    weighed: list[str] = []
    for model in sorted(set(shares) - set(drawn), key=lambda m: -shares[m]):
        if sum(shares[m] for m in drawn) >= ENOUGH:
            break
        arrays = weighted_curves(Branch(study, spec, 0, model, store), cell_seed(study, f"{name}/{model}"))
        if _has_curve(arrays):
            drawn[model] = arrays
            weighed.append(model)
    if not drawn:
        raise Refusal("not applicable: no model has damping against amplitude")
    covered = sum(shares[m] for m in drawn)
    if covered < COVERED:
        share = f"the models with draws have {covered:.2f} of the probability"
        raise Refusal(f"not applicable: {share}, below {COVERED}")
    shared = np.array(sorted(set.intersection(*(set(a["amplitudes"]) for a in drawn.values()))))
    curves = {m: a[f"spread/{CURVE}"][:, np.isin(a["amplitudes"], shared)] for m, a in drawn.items()}
    arrays = {"amplitudes": shared, f"curve/{CURVE}": average_curves(curves, shares)}
    arrays |= {f"median/{m}": np.median(c, axis=0) for m, c in curves.items()}
    return Product(AverageContent(shares, method, covered, tuple(weighed)), arrays)


def _has_curve(arrays: Mapping[str, np.ndarray]) -> bool:
    return f"spread/{CURVE}" in arrays and arrays["amplitudes"].size > 1


def probabilities(evidence: Mapping[str, Evidence]) -> dict[str, float]:
    """Return the posterior probability of each model that has its evidence, with the prior odds of its damping."""
    logs = {
        m: e.log_evidence + math.log(odds(candidate_parts(m)[0].split("+")))
        for m, e in evidence.items()
        if np.isfinite(e.log_evidence)
    }
    total = float(np.asarray(logsumexp(list(logs.values())))) if logs else 0.0
    return {m: float(np.exp(v - total)) for m, v in logs.items()}


def average_curves(curves: Mapping[str, np.ndarray], shares: Mapping[str, float]) -> np.ndarray:
    """Return median and central 95 % of a mixture of models at each of m points.

    Parameters
    ----------
    curves
        Values that represent a model's draws with equal weight, shape (k, m), by model.
    shares
        The models' weights, which need not sum to one.

    Returns
    -------
    numpy.ndarray
        Rows 2.5, 50 and 97.5 %, shape (3, m).
    """
    values = np.concatenate(list(curves.values()))
    weights = np.concatenate([np.full(len(c), shares[m] / len(c)) for m, c in curves.items()])
    return np.stack([quantiles(column, weights / weights.sum(), LEVELS) for column in values.T], axis=-1)
