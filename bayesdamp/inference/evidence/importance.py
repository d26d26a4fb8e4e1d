"""Importance sampling from a heavy-tailed fit to the posterior."""

from __future__ import annotations

import time

import numpy as np
from scipy.special import logsumexp

from bayesdamp.inference import diagnostics
from bayesdamp.inference.bend import Bend, bend
from bayesdamp.inference.evidence._densities import folded_log_posterior
from bayesdamp.inference.evidence._method import Draws, EvidenceMethod
from bayesdamp.inference.folded import DEGREES, FoldedT
from bayesdamp.inference.mode import Mode
from bayesdamp.inference.target import Target
from bayesdamp.inference.weighted import effective
from bayesdamp.types import OK, Evidence

PILOT = 1000
FINAL = 4000
ROUNDS = 5
K_GOOD = 0.5
K_LIMIT = 0.7


class Importance(EvidenceMethod):
    """Evidence as the mean importance weight, from a Laplace-centred Student t (7 degrees of freedom).

    A coefficient that may touch zero is a folded score; its posterior has mirror modes, so proposal and
    target are both folded: nothing is lost at zero, and weights are judged on the coefficient itself. Where
    the Pareto shape of the pilot weights is above 0.5 the posterior's ridge is straightened, if it is a curved one, and
    then the fit is moved to the weighted pilot draws and tried again; the reported draws are fresh ones. (Vehtari et
    al., JMLR 25, 2024, for the diagnostic.)
    """

    name = "importance"

    def evidence(
        self, model: str, target: Target, mode: Mode, seed: int, draws: Draws | None = None
    ) -> Evidence:
        began = time.perf_counter()
        rng = np.random.default_rng(seed)
        folded = np.asarray(target.layout.folded)
        proposal = FoldedT(np.where(folded, np.abs(mode.z), mode.z), mode.factor, folded)
        evaluations, bent = 0, Bend.none(folded.size)
        for attempt in range(ROUNDS):
            y, log_weights = self._weights(target, mode, proposal, bent, rng, PILOT)
            evaluations += PILOT
            # On a pilot of this size the fitted shape scatters by about 0.1.
            if diagnostics.pareto_k(log_weights) < K_GOOD - 0.1 and effective(log_weights) > 0.2 * PILOT:
                break
            ridge = bend(target, mode) if attempt == 0 else None
            if ridge is not None:
                bent = ridge
                continue
            try:
                proposal = self._refit(y, log_weights, folded)
            except np.linalg.LinAlgError:
                break  # a few draws have all the weight, which the diagnostic will say
        y, log_weights = self._weights(target, mode, proposal, bent, rng, FINAL)
        evaluations += FINAL
        k, share = diagnostics.pareto_k(log_weights), effective(log_weights) / FINAL
        log_evidence = float(logsumexp(log_weights) - np.log(FINAL))
        relative = np.exp(log_weights - log_evidence)
        outcome = (
            OK
            if k < K_LIMIT
            else f"not to be trusted: Pareto shape of the weights is {k:.2f}, above {K_LIMIT}"
        )
        return Evidence(
            model=model,
            method=self.name,
            log_evidence=log_evidence,
            stderr=float(np.std(relative, ddof=1) / np.sqrt(FINAL)),
            diagnostic=f"Pareto k {k:.2f}, effective share {share:.2f}",
            evaluations=evaluations,
            seconds=time.perf_counter() - began,
            outcome=outcome,
            arrays={"y": bent.scores(y), "log_weights": log_weights},
        )

    @staticmethod
    def _weights(
        target: Target, mode: Mode, proposal: FoldedT, bent: Bend, rng: np.random.Generator, n: int
    ) -> tuple[np.ndarray, np.ndarray]:
        """Straightened draws, (n, d), and their log weights, (n,)."""
        y = proposal.draw(rng, n)
        return y, folded_log_posterior(target, mode, bent.scores(y)) - proposal.log_density(y)

    @staticmethod
    def _refit(y: np.ndarray, log_weights: np.ndarray, folded: np.ndarray) -> FoldedT:
        # Truncated weights keep one lucky draw from becoming the whole fit.
        w = np.exp(log_weights - logsumexp(log_weights))
        w = np.minimum(w, 50.0 / w.size)
        w /= w.sum()
        centre = w @ y
        spread = (y - centre) * np.sqrt(w)[:, None]
        covariance = spread.T @ spread * (DEGREES - 2) / DEGREES * 1.2
        covariance += 1e-10 * np.trace(covariance) / centre.size * np.eye(centre.size)
        return FoldedT(centre, np.linalg.cholesky(covariance), folded)


PLUGIN = Importance()
