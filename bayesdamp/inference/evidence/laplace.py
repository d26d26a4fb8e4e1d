"""Laplace's evidence: the normal at the mode, truncated where a coefficient is zero."""

from __future__ import annotations

from bayesdamp.inference.evidence._method import Draws, EvidenceMethod
from bayesdamp.inference.mode import Mode, log_evidence_about
from bayesdamp.inference.model.target import Target
from bayesdamp.types import Evidence

NORMAL = "no draws: right where the posterior is normal"
LINEAR = "of the linear model: parameters and deviations integrated out about the best motion"


class LaplaceEvidence(EvidenceMethod):
    """The integral of the second-order expansion of the log posterior at its mode, over reflected scores from zero on.

    It takes a few likelihoods, no draws, and gives no error: it serves to prune candidates that are far behind. The
    curvature is Gauss and Newton's. A mode at zero, where the gradient is not zero, leaves the tail of a normal.
    """

    name = "laplace"
    approximate = True

    def evidence(
        self, model: str, target: Target, mode: Mode, seed: int, draws: Draws | None = None
    ) -> Evidence:
        """Compute the evidence by Laplace's approximation about the mode, without an error."""
        return Evidence(
            model=model,
            method=self.name,
            log_evidence=log_evidence_about(mode),
            diagnostic=NORMAL if mode.linear is None else LINEAR,
            evaluations=1,
        )


PLUGIN = LaplaceEvidence()
