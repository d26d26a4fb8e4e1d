"""The base class of the methods for the evidence, their draws, and which of several results of one model counts."""

from __future__ import annotations

import time
from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import combinations
from typing import TYPE_CHECKING, ClassVar

import numpy as np

from bayesdamp.types import OK, Evidence

if TYPE_CHECKING:
    from bayesdamp.inference.mode import Mode
    from bayesdamp.inference.model.target import Target

NESTED_CHECK = "nested"
APART = 3.0
"""Largest difference of two methods, in combined standard errors."""
COMBINED = "combined"
"""Name, as a method, of the log evidence that counts."""


@dataclass(frozen=True)
class Draws:
    """Posterior draws as scores, shape (chain, draw, d), reflected ones at or above zero.

    `outcome` is `ok`, or the sampler's sentence on why not to trust them.
    """

    z: np.ndarray
    outcome: str = OK

    @staticmethod
    def of(target: Target, values: np.ndarray, outcome: str = OK) -> Draws:
        """Return the scores of draws in natural units, (chain, draw, d), in the order of the target's parameters."""
        scores = [np.asarray(p.score(values[..., i])) for i, p in enumerate(target.priors.values())]
        return Draws(np.stack(scores, axis=-1), outcome)


class EvidenceMethod(ABC):
    """A method that computes log ∫ prior · likelihood of one target, in nats.

    `needs_draws` states whether it starts from draws of the posterior, and `approximate` whether it is only right for a
    normal posterior and gives no error.
    """

    name: str
    needs_draws: ClassVar[bool] = False
    approximate: ClassVar[bool] = False

    @abstractmethod
    def evidence(
        self, model: str, target: Target, mode: Mode, seed: int, draws: Draws | None = None
    ) -> Evidence:
        """Return the log evidence with its standard error and a diagnostic of its quality.

        Parameters
        ----------
        model : str
            Name of the model.
        target : Target
            The model on its record.
        mode : Mode
            Its mode.
        seed : int
            Of the random numbers.
        draws : Draws, optional
            Of this posterior. A method that needs draws makes its own where there are none.
        """

    def timed(
        self, model: str, target: Target, mode: Mode, seed: int, draws: Draws | None = None
    ) -> Evidence:
        """Return the same with the seconds that it took."""
        began = time.perf_counter()
        evidence = self.evidence(model, target, mode, seed, draws)
        return replace(evidence, seconds=time.perf_counter() - began)


def disagreement(evidences: Sequence[Evidence]) -> str:
    """Return why nested sampling has to decide, in words; nothing where all methods are trusted and agree."""
    poor = [e.method for e in evidences if e.outcome != OK]
    if poor:
        return f"the diagnostic of {' and '.join(poor)} is poor"
    for first, second in combinations(evidences, 2):
        error = float(np.hypot(first.stderr, second.stderr))
        apart = abs(first.log_evidence - second.log_evidence) / error if error > 0 else np.inf
        if not apart < APART:
            return f"{first.method} and {second.method} are {apart:.1f} standard errors apart"
    return ""


def adopted(evidences: Sequence[Evidence]) -> Evidence:
    """Return the log evidence that counts, from one or more of one model.

    It is that of nested sampling where this was used and is trusted, or else the mean of the trusted methods by inverse
    variance. The outcome says where no method is trusted, or where these disagree.
    """
    if not any(np.isfinite(e.log_evidence) for e in evidences):
        return replace(evidences[0], method=COMBINED)
    others = [e for e in evidences if e.method != NESTED_CHECK]
    why = disagreement(others)
    for e in evidences:
        if e.method == NESTED_CHECK and e.outcome == OK:
            reason = f"nested sampling counts: {why}" if why else "nested sampling counts"
            return replace(e, method=COMBINED, diagnostic=reason)
    trusted = [e for e in others if e.outcome == OK]
    if not trusted:
        best = min(evidences, key=lambda e: e.stderr if np.isfinite(e.stderr) else np.inf)
        return replace(best, method=COMBINED, diagnostic=why, outcome=f"not settled: {why}")
    weights = np.array([e.stderr**-2 for e in trusted])
    names = " and ".join(e.method for e in trusted)
    split = disagreement(trusted) if len(trusted) > 1 else ""
    outcome = f"not settled: {split}" if split else OK
    return replace(
        trusted[0],
        method=COMBINED,
        log_evidence=float(weights @ [e.log_evidence for e in trusted] / weights.sum()),
        stderr=float(weights.sum() ** -0.5),
        diagnostic=f"{names} agree" if len(trusted) > 1 and outcome == OK else f"by {names}",
        outcome=outcome,
    )
