"""Compute the evidence of one candidate (a sum of damping terms under a restoring law) by each method.

Nested sampling is called the *referee* here: by default it is computed only if the other methods disagree.
"""

import math
from collections.abc import Mapping
from dataclasses import replace

import numpy as np
import scipy  # loads its modules when they are used

from bayesdamp.config import Study
from bayesdamp.inference.evidence import EVIDENCES
from bayesdamp.inference.evidence._method import ADOPTED, REFEREE, choose_evidence, disagreement
from bayesdamp.interface.posterior import FROM_DRAWS, LAPLACE, run_evidence_method
from bayesdamp.pipeline.candidates.candidate import StudyCandidate
from bayesdamp.pipeline.records import StudyRecord
from bayesdamp.pipeline.tasks import Product
from bayesdamp.priors import odds
from bayesdamp.store.results import EvidenceContent
from bayesdamp.types import OK, Evidence, candidate_parts


def evidence_parts(study: Study, path: str, keys: Mapping[str, str]) -> dict[str, tuple[object, ...]]:
    """Return the inputs of each evidence task of a candidate besides its fit, by name of the task.

    They are part of what the key (hash) of each task is computed from: the name of the method, and the key of the draws
    if the method needs draws. If nested sampling is only the referee, its task, which also depends on the other
    methods, is last.

    Parameters
    ----------
    study
        The study, which names the methods.
    path
        The candidate on a record, `SIGNAL/REPEAT/CANDIDATE`.
    keys
        Keys of the candidate's other tasks, by name.
    """
    methods = study.evidence.methods
    draws = keys.get(f"posterior/{path}/nuts")
    parts: dict[str, tuple[object, ...]] = {
        f"evidence/{path}/{m}": (m, draws) if EVIDENCES.get(m).needs_draws else (m,) for m in methods
    }
    if methods and study.evidence.referee != "never" and REFEREE not in methods:
        parts[f"evidence/{path}/{REFEREE}"] = (REFEREE, study.evidence.referee, sorted(methods), draws)
    return parts


def compute_evidence(candidate: StudyCandidate, method: str, seed: int) -> Product:
    """Compute the evidence of a candidate by one method.

    The content of the result is an `EvidenceContent`. The referee (nested sampling) is skipped if the study uses it
    only when the other methods disagree, and they agree; its content then has no evidence. Laplace's approximation does
    not count as another method. Raises Refusal if there is no fit, or if the method is not applicable to it.
    """
    study = candidate.study
    if method == REFEREE and REFEREE not in study.evidence.methods and study.evidence.referee == "auto":
        stored = list_evidence(candidate.record, candidate.model)
        others = [e for e in stored if e.method not in (LAPLACE, REFEREE)]
        if others and not disagreement(others):
            return Product(EvidenceContent(), seconds=0.0)
    draws, outcome = None, OK
    if EVIDENCES.get(method).needs_draws and FROM_DRAWS in study.posterior.samplers:
        result = candidate.store.read(f"posterior/{candidate.path}/{FROM_DRAWS}")
        draws, outcome = result.arrays.get("draws"), result.outcome
    evidence = run_evidence_method(candidate.fit, method, seed, draws, outcome)
    content = EvidenceContent(replace(evidence, model=candidate.model))
    return Product(content, outcome=evidence.outcome, seconds=evidence.seconds)


def list_evidence(record: StudyRecord, model: str) -> list[Evidence]:
    """Return the stored evidence of a model on a record by each method of the study, in the study's order.

    A method without a stored result is omitted. For a method that gave no value (it failed, was refused or left out),
    the evidence has an outcome but no number (nan). If the study names the referee (nested sampling) as a method, it is
    treated like the others. Otherwise it is last, and it is omitted if it was not needed or if the study's setting
    `referee` is "never".
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
    """Return the stored evidence on a record: for each method, a dictionary from the model to its evidence.

    Nested sampling that was run only to check the other methods is left out if it gave no number. If there are at least
    two methods, not counting Laplace's (which has no error estimate), the last entry is `combined`. It has one evidence
    for each model: from nested sampling if this is reliable, otherwise the weighted mean of the other reliable
    methods without Laplace's (`choose_evidence`).
    """
    methods = record.study.evidence.methods
    by_method: dict[str, dict[str, Evidence]] = {m: {} for m in methods}
    by_model = {model: list_evidence(record, model) for model in record.study.compare(record.spec)}
    for model, evidences in by_model.items():
        for e in evidences:
            by_method.setdefault(e.method, {})[model] = e
    refereed = by_method.get(REFEREE, {}).values()
    if REFEREE not in methods and not any(np.isfinite(e.log_evidence) for e in refereed):
        # The referee has no numbers here, only outcomes, which the other methods have too.
        by_method.pop(REFEREE, None)
    if len([m for m in by_method if m != LAPLACE]) > 1:
        by_method[ADOPTED] = {}
        for model, evidences in by_model.items():
            counting = [e for e in evidences if e.method != LAPLACE]
            if counting:
                by_method[ADOPTED][model] = choose_evidence(counting)
    return by_method


def probabilities(evidence: Mapping[str, Evidence]) -> dict[str, float]:
    """Return the posterior probability of each model, from its evidence and the prior `odds` of its damping terms.

    evidence: by name of the model. Models without a finite log evidence are left out; the probabilities of the others
    add up to 1.
    """
    logs = {
        m: e.log_evidence + math.log(odds(candidate_parts(m)[0].split("+")))
        for m, e in evidence.items()
        if np.isfinite(e.log_evidence)
    }
    total = float(np.asarray(scipy.special.logsumexp(list(logs.values())))) if logs else 0.0
    return {m: float(np.exp(v - total)) for m, v in logs.items()}
