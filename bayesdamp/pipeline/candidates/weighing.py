"""The evidence of a branch: a cell for each method, and one for the referee."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
import scipy  # loads its modules when they are used

from bayesdamp.config import SignalSpec, Study
from bayesdamp.inference.evidence import EVIDENCES
from bayesdamp.inference.evidence._method import COMBINED, NESTED_CHECK, adopted, disagreement
from bayesdamp.interface.evidence import FROM_DRAWS, run_evidence_method
from bayesdamp.numerics.weights import quantiles
from bayesdamp.outcomes import Status, status_of
from bayesdamp.pipeline.candidates.branch import Branch
from bayesdamp.pipeline.candidates.posteriors import CURVE, LEVELS, weighted_curves
from bayesdamp.pipeline.tasks import Product, cell_seed
from bayesdamp.priors import odds
from bayesdamp.store import Store
from bayesdamp.store.contents import AverageContent, EvidenceContent
from bayesdamp.types import OK, Evidence, Refusal, candidate_parts

FIRST_LOOK = "laplace"
"""A method without an error estimate, by which candidates are pruned; it does not count where another one does."""


def evidence_parts(study: Study, path: str, keys: Mapping[str, str]) -> dict[str, tuple[object, ...]]:
    """Return the parts of each evidence cell's key besides the mode, the referee's last.

    Parameters
    ----------
    study
        Whose methods are used.
    path
        The branch, `SIGNAL/REPEAT/CANDIDATE`.
    keys
        The branch's other cells, name to key.
    """
    methods = study.evidence.methods
    draws = keys.get(f"posterior/{path}/nuts")
    parts: dict[str, tuple[object, ...]] = {
        f"evidence/{path}/{m}": (m, draws) if EVIDENCES.get(m).needs_draws else (m,) for m in methods
    }
    if methods and study.evidence.referee != "never" and NESTED_CHECK not in methods:
        referee = (NESTED_CHECK, study.evidence.referee, sorted(methods), draws)
        parts[f"evidence/{path}/{NESTED_CHECK}"] = referee
    return parts


def compute_evidence(branch: Branch, method: str, seed: int) -> Product:
    """Return the evidence by one method; that of a referee that is not needed is None. Raises Refusal."""
    study = branch.study
    if (
        method == NESTED_CHECK
        and NESTED_CHECK not in study.evidence.methods
        and study.evidence.referee == "auto"
    ):
        others = [m for m in study.evidence.methods if m != FIRST_LOOK]
        weighed = list_evidence(branch.store, f"{branch.spec.name}/{branch.repeat}", branch.model, others)
        if weighed and not disagreement(weighed):
            return Product(EvidenceContent(), seconds=0.0)
    draws, outcome = None, OK
    if EVIDENCES.get(method).needs_draws and FROM_DRAWS in study.posterior.samplers:
        cell = branch.store.read(f"posterior/{branch.path}/{FROM_DRAWS}")
        draws, outcome = cell.arrays.get("draws"), cell.outcome
    evidence = run_evidence_method(branch.fit, method, seed, draws, outcome)
    arrays: Mapping[str, np.ndarray] = {}
    if branch.repeat == 0:  # only sensitivity cells read them, which are of the first repeat
        arrays = {n: a.astype(np.float32) if n == "y" else a for n, a in evidence.arrays.items()}
    content = EvidenceContent(replace(evidence, model=branch.model, arrays={}))
    return Product(content, arrays, evidence.outcome, evidence.seconds)


def list_evidence(store: Store, record: str, model: str, methods: Sequence[str]) -> list[Evidence]:
    """Return the evidence for a model on a record (`bench/0`) by each method, and by the referee where it ran.

    Of a method that refused it has the outcome and no number.
    """
    weighed = []
    for method in dict.fromkeys((*methods, NESTED_CHECK)):
        cell = store.find(f"evidence/{record}/{model}/{method}")
        if cell is None:
            continue
        evidence = EvidenceContent.of(cell).evidence
        if evidence is not None:
            weighed.append(evidence)
        elif cell.outcome != OK:
            weighed.append(Evidence(model, method, outcome=cell.outcome))
    return weighed


def evidence_by_method(
    study: Study, store: Store, record: str, models: Sequence[str]
) -> dict[str, dict[str, Evidence]]:
    """Return the evidence on a record (`bench/0`), method to model to evidence, as far as there is one.

    Where there is more than one method, the last entry, `combined`, has the evidence that counts for each model.
    """
    methods = study.evidence.methods
    by_method: dict[str, dict[str, Evidence]] = {m: {} for m in methods}
    by_model = {model: list_evidence(store, record, model, methods) for model in models}
    for model, weighed in by_model.items():
        for e in weighed:
            by_method.setdefault(e.method, {})[model] = e
    refereed = by_method.get(NESTED_CHECK, {}).values()
    if NESTED_CHECK not in methods and not any(np.isfinite(e.log_evidence) for e in refereed):
        # Where there is no posterior, the outcomes of the other methods say so.
        by_method.pop(NESTED_CHECK, None)
    if len([m for m in by_method if m != FIRST_LOOK]) > 1:
        by_method[COMBINED] = {}
        for model, weighed in by_model.items():
            counting = [e for e in weighed if e.method != FIRST_LOOK]
            if counting:
                by_method[COMBINED][model] = adopted(counting)
    return by_method


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
    total = float(np.asarray(scipy.special.logsumexp(list(logs.values())))) if logs else 0.0
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
