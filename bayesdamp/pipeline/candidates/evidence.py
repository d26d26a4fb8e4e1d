"""Compute the evidence of a candidate by each method, and average the damping over models.

Nested sampling is called the referee here: by default it is computed only if the other methods disagree.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace

import numpy as np
import scipy  # loads its modules when they are used

from bayesdamp.config import SignalSpec, Study
from bayesdamp.inference.evidence import EVIDENCES
from bayesdamp.inference.evidence._method import ADOPTED, REFEREE, choose_evidence, disagreement
from bayesdamp.interface.evidence import FROM_DRAWS, run_evidence_method
from bayesdamp.numerics.weights import quantiles
from bayesdamp.outcomes import Status, status_of
from bayesdamp.pipeline.candidates.candidate import StudyCandidate
from bayesdamp.pipeline.candidates.posteriors import CURVE, QUANTILE_LEVELS, weighted_curves
from bayesdamp.pipeline.records import StudyRecord
from bayesdamp.pipeline.tasks import Product, task_seed
from bayesdamp.priors import odds
from bayesdamp.store.contents import AverageContent, EvidenceContent
from bayesdamp.types import OK, Evidence, Refusal, candidate_parts

FIRST_METHOD = "laplace"
"""The evidence method by which candidates are pruned (Laplace's approximation). It has no error estimate; its evidence
is ignored if another method has computed one."""


def evidence_parts(study: Study, path: str, keys: Mapping[str, str]) -> dict[str, tuple[object, ...]]:
    """Return the further inputs of each evidence task besides the mode, from which its key is computed, by task name.

    They are the method, and the key of the draws for a method that needs draws. The task of the referee (nested
    sampling) comes last.

    Parameters
    ----------
    study
        The study, which names the methods.
    path
        The candidate, `SIGNAL/REPEAT/CANDIDATE`.
    keys
        Keys of the candidate's other tasks, by name.
    """
    methods = study.evidence.methods
    draws = keys.get(f"posterior/{path}/nuts")
    parts: dict[str, tuple[object, ...]] = {
        f"evidence/{path}/{m}": (m, draws) if EVIDENCES.get(m).needs_draws else (m,) for m in methods
    }
    if methods and study.evidence.referee != "never" and REFEREE not in methods:
        referee = (REFEREE, study.evidence.referee, sorted(methods), draws)
        parts[f"evidence/{path}/{REFEREE}"] = referee
    return parts


def compute_evidence(candidate: StudyCandidate, method: str, seed: int) -> Product:
    """Compute the evidence by one method. Raises Refusal if there is no fit or the method cannot work on it.

    The content is an `EvidenceContent`. The arrays are those of the method, such as its draws, and stored only for the
    first repeat. The referee (nested sampling) is skipped, and its content has no evidence, if the study calls it only
    for a disagreement and the other methods agree.
    """
    study = candidate.study
    if method == REFEREE and REFEREE not in study.evidence.methods and study.evidence.referee == "auto":
        stored = list_evidence(candidate.record, candidate.model)
        others = [e for e in stored if e.method not in (FIRST_METHOD, REFEREE)]
        if others and not disagreement(others):
            return Product(EvidenceContent(), seconds=0.0)
    draws, outcome = None, OK
    if EVIDENCES.get(method).needs_draws and FROM_DRAWS in study.posterior.samplers:
        result = candidate.store.read(f"posterior/{candidate.path}/{FROM_DRAWS}")
        draws, outcome = result.arrays.get("draws"), result.outcome
    evidence = run_evidence_method(candidate.fit, method, seed, draws, outcome)
    arrays: Mapping[str, np.ndarray] = {}
    if candidate.repeat == 0:  # read only by sensitivity tasks, which use the first repeat
        arrays = {n: a.astype(np.float32) if n == "y" else a for n, a in evidence.arrays.items()}
    content = EvidenceContent(replace(evidence, model=candidate.model, arrays={}))
    return Product(content, arrays, evidence.outcome, evidence.seconds)


def list_evidence(record: StudyRecord, model: str) -> list[Evidence]:
    """Return the stored evidence for a model on a record by each method of the study and by its referee.

    They are in the order of the methods; the referee, nested sampling, is last if the study does not name it as a
    method. For a method that failed, the evidence has an outcome but no number. A referee that was not needed, and one
    of an earlier run if the study no longer has a referee, are left out.
    """
    evidences, options = [], record.study.evidence
    referee = () if options.referee == "never" else (REFEREE,)
    for method in dict.fromkeys((*options.methods, *referee)):
        result = record.store.find(f"evidence/{record.name}/{model}/{method}", arrays=False)
        if result is None:
            continue
        evidence = EvidenceContent.of(result).evidence
        if evidence is not None:
            evidences.append(evidence)
        elif result.outcome != OK:
            evidences.append(Evidence(model, method, outcome=result.outcome))
    return evidences


def evidence_by_method(record: StudyRecord) -> dict[str, dict[str, Evidence]]:
    """Return the stored evidence on a record: by method, a dictionary from the model to its evidence.

    If more than one method besides Laplace's has results, the last entry, `combined`, has for each model the evidence
    from all of these: that of nested sampling if it is reliable, else a weighted mean (`choose_evidence`).
    """
    methods = record.study.evidence.methods
    by_method: dict[str, dict[str, Evidence]] = {m: {} for m in methods}
    by_model = {model: list_evidence(record, model) for model in record.study.compare(record.spec)}
    for model, evidences in by_model.items():
        for e in evidences:
            by_method.setdefault(e.method, {})[model] = e
    refereed = by_method.get(REFEREE, {}).values()
    if REFEREE not in methods and not any(np.isfinite(e.log_evidence) for e in refereed):
        # The referee has only outcomes here, which the other methods state too.
        by_method.pop(REFEREE, None)
    if len([m for m in by_method if m != FIRST_METHOD]) > 1:
        by_method[ADOPTED] = {}
        for model, evidences in by_model.items():
            counting = [e for e in evidences if e.method != FIRST_METHOD]
            if counting:
                by_method[ADOPTED][model] = choose_evidence(counting)
    return by_method


LEAST_COVERED = 0.95
"""Smallest total probability of the models with a damping curve from which their average is computed (conventional)."""
ENOUGH_COVERED = 0.99
"""Total probability of the models in the average from which no further model is added (conventional)."""


def has_average(study: Study, spec: SignalSpec) -> bool:
    """Return whether the damping of a signal is averaged over models.

    It is averaged if the study has several models for this signal, samples posteriors by NUTS, and computes evidence.
    """
    computes_evidence = "nuts" in study.posterior.samplers and bool(study.evidence.methods)
    return computes_evidence and len(study.compare(spec)) > 1


def compute_average(record: StudyRecord) -> Product:
    """Return the damping against amplitude on a record, averaged over models (task `averaged/SIGNAL/REPEAT`).

    The arrays are `amplitudes`, (a,), in rad or m; `curve/equivalent_ratio`, (3, a), the 2.5, 50 and 97.5 % quantiles
    of the equivalent damping ratio; and `median/MODEL`, (a,), the median of each model. The weights are the models'
    posterior probabilities; pruned models have weight 0. Models that were not sampled are represented by weighted
    importance draws, the most probable first, until `ENOUGH_COVERED` of the probability is included.

    Raises Refusal if a model has no evidence, or if the models with draws have less than `LEAST_COVERED` of the
    probability.
    """
    study, spec, store = record.study, record.spec, record.store
    models = study.compare(spec)
    method, evidence = list(evidence_by_method(record).items())[-1]
    weights = probabilities(evidence)
    weights |= {m: 0.0 for m, e in evidence.items() if status_of(e.outcome) is Status.PRUNED}
    if len(weights) < len(models):
        raise Refusal("not applicable: some models have no evidence")
    drawn: dict[str, Mapping[str, np.ndarray]] = {}
    for model in models:
        result = store.find(f"posterior/{record.name}/{model}/nuts")
        if result is not None and _has_curve(result.arrays):
            drawn[model] = result.arrays
    from_weights: list[str] = []
    for model in sorted(set(weights) - set(drawn), key=lambda m: -weights[m]):
        if sum(weights[m] for m in drawn) >= ENOUGH_COVERED:
            break
        candidate = StudyCandidate(study, spec, record.repeat, model, store)
        arrays = weighted_curves(candidate, task_seed(study, f"averaged/{candidate.path}"))
        if _has_curve(arrays):
            drawn[model] = arrays
            from_weights.append(model)
    covered = sum(weights[m] for m in drawn)
    if covered < LEAST_COVERED:
        total = f"the models with draws have only {covered:.2f} of the probability"
        raise Refusal(f"not applicable: {total}, and an average over models needs {LEAST_COVERED}")
    shared = np.array(sorted(set.intersection(*(set(a["amplitudes"]) for a in drawn.values()))))
    curves = {m: a[f"spread/{CURVE}"][:, np.isin(a["amplitudes"], shared)] for m, a in drawn.items()}
    arrays = {"amplitudes": shared, f"curve/{CURVE}": average_curves(curves, weights)}
    arrays |= {f"median/{m}": np.median(c, axis=0) for m, c in curves.items()}
    return Product(AverageContent(weights, method, covered, tuple(from_weights)), arrays)


def _has_curve(arrays: Mapping[str, np.ndarray]) -> bool:
    """Return whether the arrays of a posterior contain a damping curve of two or more points."""
    return f"spread/{CURVE}" in arrays and arrays["amplitudes"].size > 1


def probabilities(evidence: Mapping[str, Evidence]) -> dict[str, float]:
    """Return the posterior probability of each model, from its evidence and the prior odds of its damping sum (`odds`).

    Models without a finite log evidence are left out; the probabilities of the others add up to 1.
    """
    logs = {
        m: e.log_evidence + math.log(odds(candidate_parts(m)[0].split("+")))
        for m, e in evidence.items()
        if np.isfinite(e.log_evidence)
    }
    total = float(np.asarray(scipy.special.logsumexp(list(logs.values())))) if logs else 0.0
    return {m: float(np.exp(v - total)) for m, v in logs.items()}


def average_curves(curves: Mapping[str, np.ndarray], weights: Mapping[str, float]) -> np.ndarray:
    """Return median and central 95 % interval of a mixture of models at each of m points.

    Parameters
    ----------
    curves
        Values that represent a model's draws with equal weight, shape (k, m), by model; k may differ between models.
    weights
        Weights of the models, which need not sum to one. A model's weight is divided equally among its k values.

    Returns
    -------
    numpy.ndarray
        Rows 2.5, 50 and 97.5 %, shape (3, m).
    """
    values = np.concatenate(list(curves.values()))
    each = np.concatenate([np.full(len(c), weights[m] / len(c)) for m, c in curves.items()])
    return np.stack([quantiles(column, each / each.sum(), QUANTILE_LEVELS) for column in values.T], axis=-1)
