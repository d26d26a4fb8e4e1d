"""Compute the evidence by Laplace's approximation, truncated where a coefficient is zero."""

from bayesdamp.inference.evidence._method import Draws, EvidenceMethod
from bayesdamp.inference.mode import Mode, log_evidence_about
from bayesdamp.inference.model.target import Target
from bayesdamp.types import Evidence

NORMAL_DIAGNOSTIC = "Laplace's approximation, which is accurate if the posterior is normal"
LINEAR_DIAGNOSTIC = "motion linearised about the best fit; parameters and deviations are integrated out"
"""Texts that say how Laplace's approximation was computed, stored as the `diagnostic` of its evidence:
`NORMAL_DIAGNOSTIC` for exact laws, `LINEAR_DIAGNOSTIC` with deviations from the laws."""


class LaplaceEvidence(EvidenceMethod):
    """Laplace's approximation: the integral of exp(second-order expansion of the log posterior at its mode).

    Scores of coefficients that cannot be negative are integrated over values ≥ 0 only. If a coefficient is zero at the
    mode, the gradient there is not zero, and the integral is over the tail of a normal distribution. The Hessian is the
    Gauss–Newton approximation. The method needs only a few evaluations of the likelihood, but gives no standard error.
    If the model allows for deviations from its laws, the evidence is that of the linear model in `Mode.linear`.
    """

    approximate = True

    def evidence(
        self, model: str, target: Target, mode: Mode, seed: int, draws: Draws | None = None
    ) -> Evidence:
        """Compute the evidence by Laplace's approximation at the mode; it has no standard error.

        If the model allows for deviations of damping and frequency from its laws, it is that of `Mode.linear`. `seed`
        and `draws` are not used.
        """
        return Evidence(
            model=model,
            method=self.name,
            log_evidence=log_evidence_about(mode),
            diagnostic=NORMAL_DIAGNOSTIC if mode.linear is None else LINEAR_DIAGNOSTIC,
            evaluations=1,
        )


PLUGIN = LaplaceEvidence()
