"""The base class of evidence methods, and the choice among the results of several methods."""

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

REFEREE = "nested"
"""Name of the evidence method that decides if the others disagree."""
SE_APART = 3.0
"""Two methods disagree if they differ by at least this many combined standard errors (conventional)."""
ADOPTED = "combined"
"""Value of the column `method` for the adopted log evidence, which is from one method or averaged over several."""


@dataclass(frozen=True)
class Draws:
    """Posterior draws as standard normal scores, shape (chain, draw, d); reflected scores are not negative.

    `outcome` is "ok", or the reason why the sampler's draws are unreliable.
    """

    z: np.ndarray
    outcome: str = OK

    @staticmethod
    def of(target: Target, values: np.ndarray, outcome: str = OK) -> Draws:
        """Convert draws in natural units, (chain, draw, d), to scores; the order is that of the target's parameters."""
        scores = [np.asarray(p.score(values[..., i])) for i, p in enumerate(target.priors.values())]
        return Draws(np.stack(scores, axis=-1), outcome)


class EvidenceMethod(ABC):
    """A method that computes the log evidence, log ∫ prior · likelihood, of one target in nats.

    `needs_draws`: whether it starts from draws of the posterior. `approximate`: whether it is exact only for a normal
    posterior and has no error estimate.
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
            Mode of its posterior.
        seed : int
            Seed of the random numbers.
        draws : Draws, optional
            Draws of the posterior, for methods that need them. Such a method samples them itself if it gets none.
        """

    def timed(
        self, model: str, target: Target, mode: Mode, seed: int, draws: Draws | None = None
    ) -> Evidence:
        """Return the log evidence like `evidence`, with its duration."""
        began = time.perf_counter()
        evidence = self.evidence(model, target, mode, seed, draws)
        return replace(evidence, seconds=time.perf_counter() - began)


def disagreement(evidences: Sequence[Evidence]) -> str:
    """Return why the methods are unreliable or disagree, so that nested sampling must decide; "" if they agree."""
    poor = [e.method for e in evidences if e.outcome != OK]
    if poor:
        return f"the diagnostic of {' and '.join(poor)} is poor"
    for first, second in combinations(evidences, 2):
        error = float(np.hypot(first.stderr, second.stderr))
        apart = abs(first.log_evidence - second.log_evidence) / error if error > 0 else np.inf
        if not apart < SE_APART:
            return f"{first.method} and {second.method} are {apart:.1f} standard errors apart"
    return ""


def choose_evidence(evidences: Sequence[Evidence]) -> Evidence:
    """Return the log evidence that is used for a model, from the results of one or more methods.

    It is that of nested sampling if this was run and is reliable; otherwise the mean of the reliable methods, weighted
    by inverse variance. If no method is reliable, it is the result with the smallest standard error; if none is finite,
    the first. The outcome reports that no method is reliable, or that they disagree.
    """
    if not any(np.isfinite(e.log_evidence) for e in evidences):
        return replace(evidences[0], method=ADOPTED)
    others = [e for e in evidences if e.method != REFEREE]
    why = disagreement(others)
    for e in evidences:
        if e.method == REFEREE and e.outcome == OK:
            reason = f"nested sampling counts: {why}" if why else "nested sampling counts"
            return replace(e, method=ADOPTED, diagnostic=reason)
    trusted = [e for e in others if e.outcome == OK]
    if not trusted:
        best = min(evidences, key=lambda e: e.stderr if np.isfinite(e.stderr) else np.inf)
        return replace(best, method=ADOPTED, diagnostic=why, outcome=f"not settled: {why}")
    weights = np.array([e.stderr**-2 for e in trusted])
    names = " and ".join(e.method for e in trusted)
    split = disagreement(trusted) if len(trusted) > 1 else ""
    outcome = f"not settled: {split}" if split else OK
    return replace(
        trusted[0],
        method=ADOPTED,
        log_evidence=float(weights @ [e.log_evidence for e in trusted] / weights.sum()),
        stderr=float(weights.sum() ** -0.5),
        diagnostic=f"{names} agree" if len(trusted) > 1 and outcome == OK else f"by {names}",
        outcome=outcome,
    )
