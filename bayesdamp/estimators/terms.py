"""Which estimator can estimate which damping term."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from bayesdamp.estimators._protocol import Estimator
from bayesdamp.physics.damping import TERMS


def refusal(estimator: Estimator[Any], damping: tuple[str, ...]) -> str | None:
    """A sentence why an estimator cannot estimate this sum of damping terms, or None."""
    if said := estimator.refuses(damping):
        return said
    for term in map(TERMS.get, damping):
        if term.placed and estimator.by_position:
            return f"{term.name} damping depends on the position: {estimator.by_position}"
        if term.inferred and estimator.with_parameters:
            return f"{term.name} damping has parameters beside its coefficient: {estimator.with_parameters}"
    return None


def table(estimators: Sequence[Estimator[Any]], terms: Sequence[str]) -> list[tuple[str, list[str | None]]]:
    """A row for each estimator: its name, and for each term alone why it cannot estimate it, None where it can."""
    return [(e.name, [refusal(e, (term,)) for term in terms]) for e in estimators]
