"""The base class of methods that compute an evidence, and the choice among the results of several methods."""

from __future__ import annotations

import time
from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import combinations
from typing import TYPE_CHECKING, ClassVar

import numpy as np

from bayesdamp.plugins import Plugin
from bayesdamp.types import OK, Evidence

if TYPE_CHECKING:
    from bayesdamp.inference.mode import Mode
    from bayesdamp.inference.model.target import Target

REFEREE = "nested"
"""Name of the evidence method that decides if the others disagree or are unreliable: nested sampling."""
SE_APART = 3.0
"""Two methods, or two halves of the draws, disagree if their log evidences differ by at least this many combined
standard errors (conventional)."""
ADOPTED = "combined"
"""Name in the column `method` of tables of log evidences. It marks the log evidence that is used for a model: the
result of one method, or the mean of several (`choose_evidence`)."""


@dataclass(frozen=True)
class Draws:
    """Posterior draws as standard normal scores: parameters, transformed so that their priors are standard normal.

    z: the scores, shape (chain, draw, d); those of coefficients that cannot be negative are ≥ 0. outcome: "ok", or the
    reason why the draws are unreliable.
    """

    z: np.ndarray
    outcome: str = OK

    @staticmethod
    def of(target: Target, values: np.ndarray, outcome: str = OK) -> Draws:
        """Convert draws of parameters, (chain, draw, d), in the order of `target.priors`, to standard normal scores.

        values: the draws, in the units of the parameters. outcome: "ok", or the reason why they are unreliable.
        """
        scores = [np.asarray(p.score(values[..., i])) for i, p in enumerate(target.priors.values())]
        return Draws(np.stack(scores, axis=-1), outcome)


class EvidenceMethod(Plugin, ABC):
    """A method that computes the log evidence, log ∫ prior · likelihood, of one target in nats.

    A target is one model with its record and priors. name: name by which the method is selected. needs_draws: True if
    the method starts from draws of the posterior. approximate: True if the method is exact only for a normal posterior
    and gives no standard error.
    """

    needs_draws: ClassVar[bool] = False
    approximate: ClassVar[bool] = False

    @abstractmethod
    def evidence(
        self, model: str, target: Target, mode: Mode, seed: int, draws: Draws | None = None
    ) -> Evidence:
        """Compute the log evidence with its standard error, and a diagnostic of its quality.

        Parameters
        ----------
        model : str
            Name of the model, which the result contains.
        target : Target
            The model with its record and priors.
        mode : Mode
            Mode (maximum) of the model's posterior.
        seed : int
            Seed of the random numbers.
        draws : Draws, optional
            Draws of the posterior, for methods that need them. Without them such a method samples the posterior itself.

        Returns
        -------
        Evidence
            The result; its outcome is "ok", or the reason why it is unreliable. Its field `seconds` is set by `timed`.

        Raises
        ------
        Refusal
            If the method needs the posterior covariance at the mode (`Mode.factor`), and the information there is not
            positive definite.
        """

    def timed(
        self, model: str, target: Target, mode: Mode, seed: int, draws: Draws | None = None
    ) -> Evidence:
        """Compute the log evidence by `evidence`, and add the time that this took (in s) to the result.

        Arguments and exceptions are those of `evidence`.
        """
        began = time.perf_counter()
        return replace(self.evidence(model, target, mode, seed, draws), seconds=time.perf_counter() - began)


def disagreement(evidences: Sequence[Evidence]) -> str:
    """Return a clause that says why nested sampling must decide on the evidence of a model; "" if it need not.

    It must decide if the outcome of one of the evidences is not "ok", or if two of them differ by at least `SE_APART`
    combined standard errors (also if a standard error is missing). evidences: results of the other methods for this
    model, without Laplace's approximation, which has no standard error.
    """
    poor = [e.method for e in evidences if e.outcome != OK]
    if poor:
        return f"the result of {' and '.join(poor)} is unreliable"
    for first, second in combinations(evidences, 2):
        error = float(np.hypot(first.stderr, second.stderr))
        apart = abs(first.log_evidence - second.log_evidence) / error if error > 0 else np.inf
        if not apart < SE_APART:
            return f"{first.method} and {second.method} are {apart:.1f} standard errors apart"
    return ""


def choose_evidence(evidences: Sequence[Evidence]) -> Evidence:
    """Return the log evidence to use for a model, from the results of one or more methods.

    If nested sampling was run and is reliable, its log evidence is used. Otherwise it is the mean over the reliable
    methods, weighted by inverse variance. If no method is reliable, it is the result with the smallest standard error;
    if no result is finite, it is the first one. The outcome is not "ok" if no method is reliable, or if the averaged
    methods disagree. The `method` of the result is `ADOPTED`; its `diagnostic` says where it is from. A mean has the
    other fields, such as `seconds`, of the first averaged method. evidences: without Laplace's approximation, which has
    no standard error.
    """
    evidences = [
        e
        if np.isfinite(e.log_evidence) or e.outcome != OK
        else replace(e, outcome="the evidence is not finite")
        for e in evidences
    ]
    if not any(np.isfinite(e.log_evidence) for e in evidences):
        return replace(evidences[0], method=ADOPTED)
    others = [e for e in evidences if e.method != REFEREE]
    why = disagreement(others)
    for e in evidences:
        if e.method == REFEREE and e.outcome == OK:
            reason = f"by nested sampling, because {why}" if why else "by nested sampling"
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
