"""Laplace's approximation of the evidence, truncated where a coefficient is zero."""

from __future__ import annotations

from bayesdamp.inference.evidence._method import Draws, EvidenceMethod
from bayesdamp.inference.mode import Mode, log_evidence_about
from bayesdamp.inference.model.target import Target
from bayesdamp.types import Evidence

NORMAL_DIAGNOSTIC = "no draws: right where the posterior is normal"
LINEAR_DIAGNOSTIC = "of the linear model: parameters and deviations integrated out about the best motion"
"""NORMAL_DIAGNOSTIC is the diagnostic of the evidence under exact laws, LINEAR_DIAGNOSTIC with deviations from the
laws."""


class LaplaceEvidence(EvidenceMethod):
    """The integral of the second-order expansion of the log posterior at its mode, over non-negative reflected scores.

    It needs only a few likelihoods, but has no error estimate; it is used to prune candidates with small evidence. The
    Hessian is the Gauss–Newton approximation. At a mode at zero the gradient is not zero, and the integral is over the
    tail of a normal distribution.
    """

    name = "laplace"
    approximate = True

    def evidence(
        self, model: str, target: Target, mode: Mode, seed: int, draws: Draws | None = None
    ) -> Evidence:
        """Compute the evidence by Laplace's approximation at the mode, without an error.

        `seed` and `draws` are not used.
        """
        return Evidence(
            model=model,
            method=self.name,
            log_evidence=log_evidence_about(mode),
            diagnostic=NORMAL_DIAGNOSTIC if mode.linear is None else LINEAR_DIAGNOSTIC,
            evaluations=1,
        )


PLUGIN = LaplaceEvidence()
