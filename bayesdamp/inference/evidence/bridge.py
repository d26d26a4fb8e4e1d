"""Compute the evidence by bridge sampling between posterior draws and a heavy-tailed distribution fitted to them."""

from dataclasses import dataclass

import numpy as np
from scipy.special import logsumexp

from bayesdamp.inference.coordinates import Shear, shear_of
from bayesdamp.inference.diagnostics import effective_mean, monte_carlo_error
from bayesdamp.inference.evidence._method import SE_APART, Draws, EvidenceMethod
from bayesdamp.inference.mode import Mode
from bayesdamp.inference.model.target import Target
from bayesdamp.inference.samplers import SAMPLERS, Settings
from bayesdamp.numerics.orthant import fit_reflected_t
from bayesdamp.types import OK, Evidence

PROPOSAL_DRAWS = 2000
"""Bridge sampling makes two estimates of the evidence, one from each half of the posterior draws. This is the number of
draws of the fitted distribution (the proposal) in each of them."""
MOST_ITERATIONS = 1000
"""Greatest number of iterations for the log evidence from one half of the draws."""
BRIDGE_TOLERANCE = 1e-10
"""The iteration of bridge sampling ends when the log evidence changes by less than this, in nats."""
OVERLAP_LIMIT = 0.1
"""The result of bridge sampling is unreliable if the overlap of the posterior and the fitted distribution (1 if they
are equal) is at most this (conventional)."""
SMALL_OVERLAP = 0.3
"""If the overlap of the posterior and the fitted distribution is at most this, a curved ridge of the posterior is
straightened by a change of coordinates, and the evidence is computed again (conventional)."""


@dataclass(frozen=True)
class BridgeEstimate:
    """Log evidence (nats) by bridge sampling from one half of the draws, and its standard error (nats).

    overlap: overlap of the posterior and the distribution fitted to the other half of the draws; 1 if they are equal.
    """

    log_evidence: float
    stderr: float
    overlap: float


class Bridge(EvidenceMethod):
    """Bridge sampling between NUTS draws and a reflected Student t distribution that is fitted to them.

    The distribution is fitted to the first half of each chain and compared with the second half, and vice versa. The
    log evidence is the mean of the two estimates. Coefficients that cannot be negative are represented by scores that
    are reflected at zero in both densities. If the posterior and the fitted distribution overlap little, a curved ridge
    of the posterior is straightened by a change of coordinates. The standard error is that of Frühwirth-Schnatter
    (Econometrics Journal 7, 2004), with the autocorrelation of the chains.

    References
    ----------
    Meng and Wong, Statistica Sinica 6, 1996; Gronau et al., Journal of Mathematical Psychology 81, 2017.
    """

    needs_draws = True

    def evidence(
        self, model: str, target: Target, mode: Mode, seed: int, draws: Draws | None = None
    ) -> Evidence:
        """Compute the evidence by bridge sampling. Without draws, sample them by NUTS first.

        The outcome is not "ok" in three cases: the draws are unreliable, the overlap is at most `OVERLAP_LIMIT`, or the
        log evidences from the two halves of the draws differ by at least `SE_APART` standard errors.
        """
        evaluations = 0
        if draws is None:
            posterior = SAMPLERS.get("nuts").sample(target, mode, Settings(seed=seed % 2**31))
            draws = Draws.of(target, posterior.draws, posterior.outcome)
            evaluations += posterior.evaluations
        rng = np.random.default_rng(seed)
        estimates = _bridge_halves(target, mode, draws.z, Shear.of_noise(target, mode), rng)
        each = 2 * (draws.z.shape[0] * (draws.z.shape[1] // 2) + PROPOSAL_DRAWS)  # evaluations of two bridges
        evaluations += each
        if not min(s.overlap for s in estimates) > SMALL_OVERLAP:
            ridge = shear_of(target, mode)
            if ridge is not None:
                estimates = _bridge_halves(target, mode, draws.z, ridge, rng)
                evaluations += each
        stderr = float(np.linalg.norm([s.stderr for s in estimates]))
        apart = abs(estimates[0].log_evidence - estimates[1].log_evidence) / stderr
        overlap, outcome = min(s.overlap for s in estimates), OK
        if draws.outcome != OK:
            outcome = f"not to be trusted: its posterior draws are unreliable ({draws.outcome})"
        elif not overlap > OVERLAP_LIMIT:
            outcome = (
                f"not to be trusted: posterior and fitted distribution overlap by {overlap:.2f} (1 if they are equal), "
                f"less than {OVERLAP_LIMIT}"
            )
        elif not apart < SE_APART:
            outcome = f"not to be trusted: the two halves of the draws are {apart:.1f} standard errors apart"
        return Evidence(
            model=model,
            method=self.name,
            log_evidence=0.5 * sum(s.log_evidence for s in estimates),
            stderr=0.5 * stderr,
            diagnostic=f"overlap {overlap:.2f}, two halves of the draws {apart:.1f} standard errors apart",
            evaluations=evaluations,
            outcome=outcome,
        )


def _bridge_halves(
    target: Target, mode: Mode, z: np.ndarray, shear: Shear, rng: np.random.Generator
) -> list[BridgeEstimate]:
    """Estimate the evidence from each half of the chains, with a proposal fitted to the other half.

    z: posterior draws as standard normal scores, (chains, draws, d). shear: map that straightens a curved ridge of the
    posterior; the proposal is fitted in straightened scores. The first estimate is from the second half of the draws,
    the second from the first.
    """
    reflected, half = target.reflected, z.shape[1] // 2
    parts = shear.straight(z[:, :half]), shear.straight(z[:, half : 2 * half])
    estimates = []
    for fitted_half, bridged in (parts, parts[::-1]):
        proposal = fit_reflected_t(fitted_half.reshape(-1, reflected.size), reflected)
        y = np.concatenate([bridged.reshape(-1, reflected.size), proposal.draw(rng, PROPOSAL_DRAWS)])
        ratio = mode.likelihood.folded(shear.scores(y)) + shear.log_volume(y) - proposal.log_density(y)
        cut = len(y) - PROPOSAL_DRAWS
        estimates.append(bridge(ratio[:cut].reshape(bridged.shape[:2]), ratio[cut:]))
    return estimates


def bridge(at_draws: np.ndarray, at_proposals: np.ndarray) -> BridgeEstimate:
    """Estimate the log evidence from log ratios posterior/proposal, by iterating the optimal bridge (Meng and Wong).

    Parameters
    ----------
    at_draws : ndarray, shape (chain, draw)
        Log ratios of the unnormalised posterior density to the proposal density, at posterior draws.
    at_proposals : ndarray, shape (m,)
        The same log ratios at independent draws of the proposal.

    Returns
    -------
    BridgeEstimate
        Log evidence, standard error, and overlap of posterior and proposal.
    """
    effective = min(effective_mean(at_draws), float(at_draws.size))
    fraction = effective / (effective + at_proposals.size)
    a, b = np.log(fraction), np.log1p(-fraction)
    draws = at_draws.ravel()
    log_z = float(np.median(draws))
    for _ in range(MOST_ITERATIONS):
        before = log_z
        up = logsumexp(at_proposals - np.logaddexp(a + at_proposals, b + log_z)) - np.log(at_proposals.size)
        down = logsumexp(-np.logaddexp(a + draws, b + log_z)) - np.log(draws.size)
        log_z = float(up - down)
        if abs(log_z - before) < BRIDGE_TOLERANCE:
            break
    # The relative variance of the estimate, from the two functions whose means the bridge compares.
    up = np.exp(at_proposals - log_z - np.logaddexp(a + at_proposals - log_z, b))
    down = np.exp(-np.logaddexp(a + at_draws - log_z, b))
    variance = np.var(up, ddof=1) / up.size / np.mean(up) ** 2
    variance += (monte_carlo_error(down) / np.mean(down)) ** 2
    return BridgeEstimate(log_z, float(np.sqrt(variance)), float(np.mean(up)))


PLUGIN = Bridge()
