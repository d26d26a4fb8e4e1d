"""The evidence of a branch: each method's cell, and the referee's."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from bayesdamp.config import Study
from bayesdamp.inference.evidence import EVIDENCES, Draws
from bayesdamp.inference.evidence.adopted import COMBINED, NESTED_CHECK, adopted, disagreement
from bayesdamp.inference.fit.mode import Mode
from bayesdamp.pipeline.candidates.branch import Branch
from bayesdamp.pipeline.tasks import Product
from bayesdamp.store import Store
from bayesdamp.store.contents import EvidenceContent
from bayesdamp.types import OK, Evidence

FIRST_LOOK = "laplace"
"""A method without an error estimate, by which candidates are pruned; it does not count where another one does."""


def evidence_parts(study: Study, path: str, found: Mapping[str, str]) -> dict[str, tuple[object, ...]]:
    """Name of each evidence cell of a branch to what its key depends on besides the mode, the referee's last.

    found: the branch's other cells, name to key.
    """
    asked = study.evidence.methods
    draws = found.get(f"posterior/{path}/nuts")
    parts: dict[str, tuple[object, ...]] = {
        f"evidence/{path}/{m}": (m, draws) if EVIDENCES.get(m).needs_draws else (m,) for m in asked
    }
    if asked and study.evidence.referee != "never" and NESTED_CHECK not in asked:
        parts[f"evidence/{path}/{NESTED_CHECK}"] = (
            NESTED_CHECK,
            study.evidence.referee,
            sorted(asked),
            draws,
        )
    return parts


def compute_evidence(branch: Branch, method: str, seed: int) -> Product:
    """The evidence by one method; a referee that is not needed says so. Raises Refusal."""
    if not called(branch, method):
        return Product(EvidenceContent(), seconds=0.0)
    plugin, mode = EVIDENCES.get(method), branch.density
    draws = _draws(branch, mode) if plugin.needs_draws else None
    one = plugin.timed(branch.model, mode.likelihood.target, mode, seed, draws)
    arrays: Mapping[str, np.ndarray] = {}
    if branch.repeat == 0:  # for what is asked of the first repeat alone
        arrays = {n: a.astype(np.float32) if n == "y" else a for n, a in one.arrays.items()}
    return Product(EvidenceContent(replace(one, arrays={})), arrays, one.outcome, one.seconds)


def called(branch: Branch, method: str) -> bool:
    """Whether a method is to compute: a referee that nobody asked for is not, where the others agree."""
    study = branch.study.evidence
    if method != NESTED_CHECK or NESTED_CHECK in study.methods or study.referee != "auto":
        return True
    asked = [m for m in study.methods if m != FIRST_LOOK]
    found = evidences(branch.store, f"{branch.spec.name}/{branch.repeat}", branch.model, asked)
    return not found or bool(disagreement(found))


def _draws(branch: Branch, mode: Mode) -> Draws | None:
    """The NUTS draws of this branch, where the study has them."""
    if "nuts" not in branch.study.posterior.samplers:
        return None
    cell = branch.store.read(f"posterior/{branch.path}/nuts")
    if "draws" not in cell.arrays:
        return None
    return Draws.of(mode.likelihood.target, cell.arrays["draws"], cell.outcome)


def evidences(store: Store, record: str, model: str, methods: Sequence[str]) -> list[Evidence]:
    """What the methods found for a model on a record (`bench/0`), the referee among them where it was called; sentences
    have no number."""
    found = []
    for method in dict.fromkeys((*methods, NESTED_CHECK)):
        cell = store.find(f"evidence/{record}/{model}/{method}")
        if cell is None:
            continue
        one = EvidenceContent.of(cell).evidence
        if one is not None:
            found.append(one)
        elif cell.outcome != OK:
            found.append(Evidence(model, method, outcome=cell.outcome))
    return found


def evidence_by_method(
    study: Study, store: Store, record: str, models: Sequence[str]
) -> dict[str, dict[str, Evidence]]:
    """Method to model to evidence, as far as there is one, of a record (`bench/0`); last, under `combined`, the one
    that counts for each model, where there is more than one method."""
    asked = study.evidence.methods
    by_method: dict[str, dict[str, Evidence]] = {m: {} for m in asked}
    every = {model: evidences(store, record, model, asked) for model in models}
    for model, found in every.items():
        for e in found:
            by_method.setdefault(e.method, {})[model] = e
    if NESTED_CHECK not in asked and not any(
        np.isfinite(e.log_evidence) for e in by_method.get(NESTED_CHECK, {}).values()
    ):
        by_method.pop(NESTED_CHECK, None)  # where there is no posterior, the methods asked for say so
    if len([m for m in by_method if m != FIRST_LOOK]) > 1:
        drawn = {model: [e for e in found if e.method != FIRST_LOOK] for model, found in every.items()}
        by_method[COMBINED] = {model: adopted(found) for model, found in drawn.items() if found}
    return by_method
