"""Importance sampling from a heavy-tailed fit to the posterior."""

from __future__ import annotations

import numpy as np
from scipy.special import logsumexp

from bayesdamp.inference.checks import diagnostics
from bayesdamp.inference.coordinates.reflected_t import DEGREES, ReflectedT, fitted
from bayesdamp.inference.coordinates.shear import Shear, shear_of
from bayesdamp.inference.coordinates.truncated_normal import about
from bayesdamp.inference.curves.weighted import effective
from bayesdamp.inference.evidence._method import Draws, EvidenceMethod
from bayesdamp.inference.fit.mode import Mode
from bayesdamp.inference.model.target import Target
from bayesdamp.types import OK, Evidence

PILOT = 1000
FINAL = 4000
ROUNDS = 5
K_GOOD = 0.5
K_LIMIT = 0.7
FEWEST = 50
"""Effective draws below which an evidence is not trusted."""


def trusted(k: float, worth: float) -> str:
    """The outcome of an evidence by weights with Pareto shape k that are worth so many equal draws."""
    if not k < K_LIMIT:
        return f"not to be trusted: Pareto shape of the weights is {k:.2f}, above {K_LIMIT}"
    if not worth >= FEWEST:  # the rest of which may have no weight at all, and no shape
        return f"not to be trusted: a few draws have all the weight, as much as {worth:.0f} equal ones"
    return OK


def _good(log_weights: np.ndarray) -> bool:
    """Whether a pilot will do; on one of this size the fitted shape scatters by about 0.1."""
    return diagnostics.pareto_k(log_weights) < K_GOOD - 0.1 and effective(log_weights) > 0.2 * PILOT


class Importance(EvidenceMethod):
    """Evidence as the mean importance weight, from a Laplace-centred Student t (7 degrees of freedom).

    A coefficient that may touch zero is a reflected score; its posterior has mirror modes, so proposal and
    target are both reflected: nothing is lost at zero, and weights are judged on the coefficient itself. Where
    the pilot weights' Pareto shape or effective number is poor, the fit is that to what a wall leaves of the normal
    distribution, if one is near; then a curved ridge is straightened; and then the fit is moved to the weighted pilot
    draws and tried again. The reported draws are fresh ones. (Vehtari et al., JMLR 25, 2024, for the diagnostic.)
    """

    name = "importance"

    def evidence(
        self, model: str, target: Target, mode: Mode, seed: int, draws: Draws | None = None
    ) -> Evidence:
        """By importance sampling from a heavy-tailed fit to the posterior."""
        rng = np.random.default_rng(seed)
        reflected = target.reflected
        if mode.linear is None:
            proposal = ReflectedT(np.where(reflected, np.abs(mode.z), mode.z), mode.factor, reflected)
        else:
            proposal = fitted(mode.linear.draws, reflected)
        place = proposal, Shear.of_noise(target, mode)
        y, log_weights = self._weights(target, mode, *place, rng, PILOT)
        evaluations = PILOT
        others = (
            lambda: self._truncated(target, mode, *place),
            lambda: None if (ridge := shear_of(target, mode)) is None else (place[0], ridge),
        )
        for other in others if mode.linear is None else ():
            if _good(log_weights) or (tried := other()) is None:
                continue
            there, weights = self._weights(target, mode, *tried, rng, PILOT)
            evaluations += PILOT
            if not effective(log_weights) >= effective(weights):
                place, y, log_weights = tried, there, weights
        for _ in range(ROUNDS - 1):
            if _good(log_weights) or (refitted := self._refit(y, log_weights, reflected)) is None:
                break  # where a few draws have all the weight, the diagnostic will say it
            place = refitted, place[1]
            y, log_weights = self._weights(target, mode, *place, rng, PILOT)
            evaluations += PILOT
        final = FINAL if mode.linear is None else FINAL // 2  # motions with deviations take longer
        y, log_weights = self._weights(target, mode, *place, rng, final)
        evaluations += final
        k, share = diagnostics.pareto_k(log_weights), effective(log_weights) / final
        log_evidence = float(logsumexp(log_weights) - np.log(final))
        relative = np.exp(log_weights - log_evidence)
        return Evidence(
            model=model,
            method=self.name,
            log_evidence=log_evidence,
            stderr=float(np.std(relative, ddof=1) / np.sqrt(final)),
            diagnostic=f"Pareto k {k:.2f}, effective share {share:.2f}",
            evaluations=evaluations,
            outcome=trusted(k, share * final),
            arrays={"y": place[1].scores(y), "log_weights": log_weights},
        )

    @staticmethod
    def _weights(
        target: Target, mode: Mode, proposal: ReflectedT, shear: Shear, rng: np.random.Generator, n: int
    ) -> tuple[np.ndarray, np.ndarray]:
        """Straightened draws, (n, d), and their log weights, (n,)."""
        y = proposal.draw(rng, n)
        return y, mode.likelihood.folded(shear.scores(y)) - proposal.log_density(y)

    @staticmethod
    def _truncated(
        target: Target, mode: Mode, proposal: ReflectedT, shear: Shear
    ) -> tuple[ReflectedT, Shear] | None:
        """A fit to the moments of the mode's normal distribution, cut off where coefficients are zero; None where no
        wall is near. Coefficients that make up for each other there do not on its mirror images."""
        normal = about(mode)
        if not normal.walls.size:
            return None
        try:
            centre, factor = normal.moments
        except np.linalg.LinAlgError:
            return None
        return ReflectedT(centre, factor * np.sqrt((DEGREES - 2) / DEGREES * 1.2), normal.reflected), shear

    @staticmethod
    def _refit(y: np.ndarray, log_weights: np.ndarray, reflected: np.ndarray) -> ReflectedT | None:
        """A fit to the weighted draws; None where so few of them have weight that they span no volume."""
        # Truncated weights keep one lucky draw from becoming the whole fit.
        w = np.exp(log_weights - logsumexp(log_weights))
        w = np.minimum(w, 50.0 / w.size)
        w /= w.sum()
        if 1.0 / np.sum(w**2) < reflected.size + 1:
            return None
        centre = w @ y
        spread = (y - centre) * np.sqrt(w)[:, None]
        covariance = spread.T @ spread * (DEGREES - 2) / DEGREES * 1.2
        covariance += 1e-10 * np.trace(covariance) / centre.size * np.eye(centre.size)
        try:
            return ReflectedT(centre, np.linalg.cholesky(covariance), reflected)
        except np.linalg.LinAlgError:
            return None


PLUGIN = Importance()
