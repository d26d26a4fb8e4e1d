"""Bridge sampling between the posterior's draws and a heavy-tailed fit to them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.special import logsumexp

from bayesdamp.inference.coordinates.whitening import Shear, shear_of
from bayesdamp.inference.diagnostics import effective_mean, monte_carlo_error
from bayesdamp.inference.evidence._method import Draws, EvidenceMethod
from bayesdamp.inference.mode import Mode
from bayesdamp.inference.model.target import Target
from bayesdamp.inference.samplers import SAMPLERS, Settings
from bayesdamp.numerics.orthant import fit_reflected_t
from bayesdamp.types import OK, Evidence

PROPOSALS = 2000
"""Draws of the fit for each half of the posterior's draws."""
ITERATIONS = 1000
TOLERANCE = 1e-10
OVERLAP_LIMIT = 0.1
HARDLY = 0.3
"""Overlap below which a curved ridge is looked for."""
APART = 3.0
"""Largest difference of the two halves, in standard errors."""


@dataclass(frozen=True)
class Span:
    """One bridge: log evidence, its standard error, and the overlap of the two densities, 1 where they are equal."""

    log_evidence: float
    stderr: float
    overlap: float


class Bridge(EvidenceMethod):
    """The optimal bridge from NUTS draws to a Student t that is reflected where a coefficient cannot be negative.

    One half of each chain shapes the fit and the other is bridged to it, and the other way round. Draws and fit are of
    the reflected scores, so that no mirror mode can be missed. Where posterior and fit hardly overlap, a curved ridge
    is straightened. The standard error is Frühwirth-Schnatter's (Econometrics Journal 7, 2004), and includes the
    autocorrelation of the chains.

    References
    ----------
    Meng and Wong, Statistica Sinica 6, 1996; Gronau et al., Journal of Mathematical Psychology 81, 2017.
    """

    name = "bridge"
    needs_draws = True

    def evidence(
        self, model: str, target: Target, mode: Mode, seed: int, draws: Draws | None = None
    ) -> Evidence:
        """Compute the evidence by bridge sampling between the posterior's draws and a heavy-tailed fit to them."""
        evaluations = 0
        if draws is None:
            posterior = SAMPLERS.get("nuts").sample(target, mode, Settings(seed=seed % 2**31))
            draws = Draws.of(target, posterior.draws, posterior.outcome)
            evaluations += posterior.evaluations
        rng = np.random.default_rng(seed)
        spans, count = _spans(target, mode, draws.z, Shear.of_noise(target, mode), rng)
        evaluations += count
        if not min(s.overlap for s in spans) > HARDLY:
            ridge = shear_of(target, mode)
            if ridge is not None:
                spans, count = _spans(target, mode, draws.z, ridge, rng)
                evaluations += count
        stderr = float(np.linalg.norm([s.stderr for s in spans]))
        apart = abs(spans[0].log_evidence - spans[1].log_evidence) / stderr
        overlap, outcome = min(s.overlap for s in spans), OK
        if draws.outcome != OK:
            outcome = f"not to be trusted: its posterior draws are {draws.outcome}"
        elif not overlap > OVERLAP_LIMIT:
            outcome = (
                f"not to be trusted: posterior and fit overlap by {overlap:.2f}, less than {OVERLAP_LIMIT}"
            )
        elif not apart < APART:
            outcome = f"not to be trusted: the two halves of the draws are {apart:.1f} standard errors apart"
        return Evidence(
            model=model,
            method=self.name,
            log_evidence=0.5 * sum(s.log_evidence for s in spans),
            stderr=0.5 * stderr,
            diagnostic=f"overlap {overlap:.2f}, halves {apart:.1f} standard errors apart",
            evaluations=evaluations,
            outcome=outcome,
        )


def _spans(
    target: Target, mode: Mode, z: np.ndarray, shear: Shear, rng: np.random.Generator
) -> tuple[list[Span], int]:
    """Bridge both halves of the chains z, (chains, draws, d), in straightened scores; return evaluations too."""
    reflected = target.reflected
    half, evaluations = z.shape[1] // 2, 0
    parts = shear.straight(z[:, :half]), shear.straight(z[:, half : 2 * half])
    spans = []
    for shaping, bridged in (parts, parts[::-1]):
        proposal = fit_reflected_t(shaping.reshape(-1, reflected.size), reflected)
        y = np.concatenate([bridged.reshape(-1, reflected.size), proposal.draw(rng, PROPOSALS)])
        ratio = mode.likelihood.folded(shear.scores(y)) + shear.log_volume(y) - proposal.log_density(y)
        evaluations += len(y)
        cut = len(y) - PROPOSALS
        spans.append(span(ratio[:cut].reshape(bridged.shape[:2]), ratio[cut:]))
    return spans, evaluations


def span(at_draws: np.ndarray, at_proposals: np.ndarray) -> Span:
    """Return the bridge from log ratios of posterior (not normalised) to proposal.

    Parameters
    ----------
    at_draws : ndarray, shape (chain, draw)
        The ratios at the posterior's draws.
    at_proposals : ndarray, shape (m,)
        The ratios at independent draws of the proposal.
    """
    effective = min(effective_mean(at_draws), float(at_draws.size))
    share = effective / (effective + at_proposals.size)
    a, b = np.log(share), np.log1p(-share)
    draws = at_draws.ravel()
    log_z = float(np.median(draws))
    for _ in range(ITERATIONS):
        before = log_z
        up = logsumexp(at_proposals - np.logaddexp(a + at_proposals, b + log_z)) - np.log(at_proposals.size)
        down = logsumexp(-np.logaddexp(a + draws, b + log_z)) - np.log(draws.size)
        log_z = float(up - down)
        if abs(log_z - before) < TOLERANCE:
            break
    # Both functions of the bridge with the normalised posterior; the error of their means' ratio.
    up = np.exp(at_proposals - log_z - np.logaddexp(a + at_proposals - log_z, b))
    down = np.exp(-np.logaddexp(a + at_draws - log_z, b))
    variance = np.var(up, ddof=1) / up.size / np.mean(up) ** 2
    variance += (monte_carlo_error(down) / np.mean(down)) ** 2
    return Span(log_z, float(np.sqrt(variance)), float(np.mean(up)))


PLUGIN = Bridge()
