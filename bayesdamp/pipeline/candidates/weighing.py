"""The evidence of a branch: a cell for each method, and one for the referee."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from bayesdamp.config import Study
from bayesdamp.inference.evidence import EVIDENCES
from bayesdamp.inference.evidence._method import COMBINED, NESTED_CHECK, adopted, disagreement
from bayesdamp.interface.evidence import FROM_DRAWS, weigh
from bayesdamp.pipeline.candidates.branch import Branch
from bayesdamp.pipeline.tasks import Product
from bayesdamp.store import Store
from bayesdamp.store.contents import EvidenceContent
from bayesdamp.types import OK, Evidence

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
    evidence = weigh(branch.fit, method, seed, draws, outcome)
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
