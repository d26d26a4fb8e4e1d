"""Compute the evidence by importance sampling from a heavy-tailed distribution near the posterior."""

import numpy as np
import scipy  # loads its modules when they are used

from bayesdamp.inference.coordinates import Shear, expansion, shear_of, truncated_about
from bayesdamp.inference.evidence._method import Draws, EvidenceMethod
from bayesdamp.inference.mode import Mode
from bayesdamp.inference.model.target import Target
from bayesdamp.numerics.orthant import T_DEGREES, ReflectedT, fit_reflected_t
from bayesdamp.numerics.weights import K_LIMIT, effective_size, pareto_k
from bayesdamp.types import OK, Evidence

PILOT_DRAWS, FINAL_DRAWS = 1000, 4000
"""Numbers of draws in importance sampling. The weights of `PILOT_DRAWS` draws from a proposal distribution show whether
it is good. The evidence is computed from `FINAL_DRAWS` new draws; from half as many if the model allows for deviations
from its laws, because the likelihood then takes longer."""
MOST_REFITS = 4
"""Greatest number of times that the proposal distribution of importance sampling is fitted again to weighted draws from
it."""
K_GOOD = 0.5
"""Limit of the Pareto shape of good importance weights: the shape k of a generalised Pareto distribution fitted to the
largest weights (Vehtari et al., JMLR 25, 2024). Weights of pilot draws must be 0.1 below it (`_are_good`)."""
LEAST_EFFECTIVE = 50
"""The evidence from importance sampling is unreliable if the effective number of draws, computed from their weights, is
below this (conventional)."""


def _are_good(log_weights: np.ndarray) -> bool:
    """Return whether the log weights, (n,), of pilot draws from a proposal distribution show that it is good.

    The Pareto shape of the weights must be below 0.4 (`K_GOOD` minus the scatter of a fitted shape, about 0.1), and
    their effective number above a fifth of `PILOT_DRAWS`.
    """
    return pareto_k(log_weights) < K_GOOD - 0.1 and effective_size(log_weights) > 0.2 * PILOT_DRAWS


class Importance(EvidenceMethod):
    """Importance sampling: the mean weight of draws from a Student t with 7 degrees of freedom near the mode.

    The proposal distribution, from which the draws are, is chosen by the weights of pilot draws. For exact laws these
    proposals are tried in turn, until the weights are good: Laplace's approximation, truncated at zero, with heavy
    tails; the same with a curved ridge of the posterior straightened, if this increases the effective number of draws;
    up to `MOST_REFITS` fits to the weighted pilot draws. If the model allows for deviations from its laws, the first
    proposal is a fit to the draws in `Mode.linear`, and only the repeated fits follow.

    The evidence is computed from new draws. Coefficients that cannot be negative are represented by scores that are
    reflected at zero, in the proposal and in the posterior. The diagnostic contains the Pareto shape (Vehtari et al.,
    JMLR 25, 2024) and the effective fraction of the draws.
    """

    def evidence(
        self, model: str, target: Target, mode: Mode, seed: int, draws: Draws | None = None
    ) -> Evidence:
        """Compute the evidence by importance sampling, after choosing a proposal distribution with pilot draws.

        The evidence is the mean weight of the final draws. The outcome is not "ok" if the Pareto shape of these weights
        is at least `K_LIMIT`, or if their effective number is below `LEAST_EFFECTIVE`. `draws` are not used.
        """
        rng = np.random.default_rng(seed)
        reflected = target.reflected
        shear = Shear.of_noise(target, mode)
        proposal = self._proposal(target, mode, shear)
        y, log_weights = self._weights(mode, proposal, shear, rng, PILOT_DRAWS)
        evaluations = PILOT_DRAWS
        poor = mode.linear is None and not _are_good(log_weights)
        if poor and (ridge := shear_of(target, mode)) is not None:
            straight = self._proposal(target, mode, ridge)
            pilot, weights = self._weights(mode, straight, ridge, rng, PILOT_DRAWS)
            evaluations += PILOT_DRAWS
            if not effective_size(log_weights) >= effective_size(weights):
                proposal, shear, y, log_weights = straight, ridge, pilot, weights
        for _ in range(MOST_REFITS):
            if _are_good(log_weights) or (refitted := self._refit(y, log_weights, reflected)) is None:
                break  # too few draws have weight, which the outcome reports
            proposal = refitted
            y, log_weights = self._weights(mode, proposal, shear, rng, PILOT_DRAWS)
            evaluations += PILOT_DRAWS
        # A likelihood with deviations takes longer.
        final = FINAL_DRAWS if mode.linear is None else FINAL_DRAWS // 2
        y, log_weights = self._weights(mode, proposal, shear, rng, final)
        evaluations += final
        k, share = pareto_k(log_weights), effective_size(log_weights) / final
        outcome = OK
        if not k < K_LIMIT:
            outcome = f"not to be trusted: Pareto shape of the weights is {k:.2f}, above {K_LIMIT}"
        elif not share * final >= LEAST_EFFECTIVE:  # then the Pareto shape means nothing
            few = f"a few draws have all the weight (effective number {share * final:.0f})"
            outcome = f"not to be trusted: {few}"
        log_evidence = float(scipy.special.logsumexp(log_weights) - np.log(final))
        return Evidence(
            model=model,
            method=self.name,
            log_evidence=log_evidence,
            stderr=float(np.std(np.exp(log_weights - log_evidence), ddof=1) / np.sqrt(final)),
            diagnostic=f"Pareto k {k:.2f}, effective share {share:.2f}",
            evaluations=evaluations,
            outcome=outcome,
        )

    @staticmethod
    def _weights(
        mode: Mode, proposal: ReflectedT, shear: Shear, rng: np.random.Generator, n: int
    ) -> tuple[np.ndarray, np.ndarray]:
        """Draw n points from a proposal distribution; return them, (n, d), and their log importance weights, (n,).

        shear: map from the coordinates of the points to standard normal scores; it may straighten a curved ridge of the
        posterior. A weight is the unnormalised posterior density, per unit of these coordinates, divided by the density
        of the proposal.
        """
        y = proposal.draw(rng, n)
        return y, mode.likelihood.folded(shear.scores(y)) + shear.log_volume(y) - proposal.log_density(y)

    @staticmethod
    def _proposal(target: Target, mode: Mode, shear: Shear) -> ReflectedT:
        """Return the Student t distribution with which a series of refits starts, in the coordinates of `shear`.

        `shear` maps these coordinates to standard normal scores, and may straighten a curved ridge of the posterior.
        The map that `evidence` tries first straightens none.

        Centre and scale matrix of the Student t are the mean and the covariance of the distribution of
        `truncated_about`, because a reflected Student t about the mode would have wrong correlations near a bound. If
        this covariance is singular, the Student t is centred at the mode. If the model allows for deviations from its
        laws, it is fitted to the draws in `Mode.linear` instead, and `shear` has no effect.
        """
        if mode.linear is not None:
            return fit_reflected_t(mode.linear.draws, target.reflected)
        try:
            return ReflectedT(*truncated_about(target, mode, shear).moments, target.reflected)
        except np.linalg.LinAlgError:
            return ReflectedT(*expansion(target, mode, shear), target.reflected)

    @staticmethod
    def _refit(y: np.ndarray, log_weights: np.ndarray, reflected: np.ndarray) -> ReflectedT | None:
        """Return a Student t distribution fitted to weighted draws y, (n, d), with 1.2 times their covariance.

        log_weights: log importance weights, (n,); in the fit no weight counts more than 50 times the mean weight.
        reflected: which coordinates are reflected at zero, (d,). The result is None if too few draws have weight, or if
        the covariance is singular.
        """
        # The weights are truncated so that a single draw cannot dominate the fit.
        w = np.exp(log_weights - scipy.special.logsumexp(log_weights))
        w = np.minimum(w, 50.0 / w.size)
        w /= w.sum()
        if 1.0 / np.sum(w**2) < reflected.size + 1:
            return None
        centre = w @ y
        spread = (y - centre) * np.sqrt(w)[:, None]
        covariance = spread.T @ spread * (T_DEGREES - 2) / T_DEGREES * 1.2
        covariance += 1e-10 * np.trace(covariance) / centre.size * np.eye(centre.size)
        try:
            return ReflectedT(centre, np.linalg.cholesky(covariance), reflected)
        except np.linalg.LinAlgError:
            return None


PLUGIN = Importance()
