"""Importance sampling of a joint posterior: shared scores first, then each record's own given these.

A record's own scores only meet those of the others through the shared ones, so that the proposal is a product, and the
weight of a shared draw a product of the records' means over some draws of their own (an unbiased estimate of each
record's likelihood with its own parameters integrated out; Andrieu & Roberts, Annals of Statistics 37, 2009). Fits have
no more dimensions than the shared scores and those of one record, however many records there are.
"""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

import numpy as np
from scipy.special import logsumexp

from bayesdamp.inference.checks import diagnostics
from bayesdamp.inference.coordinates.reflected_t import DEGREES, ReflectedT
from bayesdamp.inference.coordinates.whitening import truncated_moments
from bayesdamp.inference.curves.weighted import effective, shares
from bayesdamp.inference.evidence.methods.importance import K_GOOD, K_LIMIT
from bayesdamp.inference.many.joint import Joint, JointMode
from bayesdamp.machine.threads import cores
from bayesdamp.priors import log_prior_of
from bayesdamp.types import OK

PILOT = 500
FINAL = 2000
ROUNDS = 6
INNER = 4
"""Draws of a record's own scores for one of the shared ones, where all goes well: at most this, or as many as there are
records."""
MOST_INNER = 16
LEAST = 200
"""Effective draws below which intervals are not to be trusted."""
ENOUGH = 0.2
"""Effective share of a pilot that is good, and that a fit is made from: where there is less, from flattened weights."""
WIDER = 1.2


@dataclass(frozen=True)
class Weighed:
    """Evidence of a joint posterior (nats) with its standard error, and weighted draws of the shared scores.

    scores: (n, k); log_weights: (n,); effective: how many equal draws they are worth.
    """

    log_evidence: float
    stderr: float
    pareto_k: float
    effective: float
    evaluations: int
    outcome: str
    scores: np.ndarray
    log_weights: np.ndarray


@dataclass(frozen=True)
class _Own:
    """A record's own scores given the shared ones: mean + slope (φ − centre), and the factor of their scale."""

    mean: np.ndarray
    slope: np.ndarray
    factor: np.ndarray

    def given(self, away: np.ndarray, reflected: np.ndarray) -> ReflectedT:
        """Their distribution at shared scores so far, (n, k), from the centre."""
        return ReflectedT(self.mean + away @ self.slope.T, self.factor, reflected)


class _Proposal:
    """From the mean and covariance of the shared scores, (k,) and (k, k), and, for each record, the mean (m,) of its
    own ones, their covariance with the shared ones (m, k), and among themselves (m, m)."""

    def __init__(
        self,
        joint: Joint,
        mean: np.ndarray,
        covariance: np.ndarray,
        records: Sequence[tuple[np.ndarray, np.ndarray, np.ndarray]],
    ) -> None:
        k = mean.size
        self.joint = joint
        self.shared = ReflectedT(mean, _factor(covariance), joint.reflected[:k])
        self.own = []
        for own_mean, across, own in records:
            slope = np.linalg.solve(covariance, across.T).T
            self.own.append(_Own(own_mean, slope, _factor(own - slope @ across.T)))

    @staticmethod
    def at(mode: JointMode) -> _Proposal:
        """The normal of the mode's gradient and information, cut off at zero."""
        joint, k = mode.joint, len(mode.joint.shared)
        mean, factor = truncated_moments(
            mode.information, mode.gradient, mode.x, np.flatnonzero(joint.reflected)
        )
        c = factor @ factor.T
        parts = [(mean[p], c[p, :k], c[np.ix_(p, p)]) for p in joint.parts]
        return _Proposal(joint, mean[:k], c[:k, :k], parts)


@dataclass(frozen=True)
class _Drawn:
    """Shared scores (n, k), each record's own, (n, inner, m), log weights (n,), and of each record (n, inner)."""

    shared: np.ndarray
    own: list[np.ndarray]
    log_weights: np.ndarray
    inner: list[np.ndarray]


def weigh(mode: JointMode, seed: int, draws: int = FINAL) -> Weighed:
    """Evidence and draws of a joint posterior around its mode.

    The proposal is fitted anew to the weighted draws of a pilot until their Pareto shape is good, each time with more
    draws of the records' own scores; the draws that count are fresh. Where these are poor, a last fit is made from
    them. A shape that stays poor, or few effective draws, is in the outcome.
    """
    rng = np.random.default_rng(seed)
    several = any(mode.joint.live)
    proposal, inner = _Proposal.at(mode), min(INNER, len(mode.local)) if several else 1
    evaluations, best, kept = 0, -1.0, (proposal, inner)

    def more(inner: int) -> int:
        return min(2 * inner, MOST_INNER) if several else 1

    for _ in range(ROUNDS):
        drawn = _draw(mode, proposal, rng, PILOT, inner)
        evaluations += PILOT * inner * len(mode.local)
        share = effective(drawn.log_weights) / PILOT
        if share > best:
            best, kept = share, (proposal, inner)
        # On a pilot of this size the fitted shape scatters by about 0.1.
        if diagnostics.pareto_k(drawn.log_weights) < K_GOOD - 0.1 and share > ENOUGH:
            break
        proposal, inner = _refitted(mode.joint, drawn), more(inner)
    proposal, inner = kept
    drawn = _draw(mode, proposal, rng, draws, inner)
    evaluations += draws * inner * len(mode.local)
    if _poor(drawn.log_weights) != OK:
        inner = more(inner)
        drawn = _draw(mode, _refitted(mode.joint, drawn), rng, draws, inner)
        evaluations += draws * inner * len(mode.local)
    w = drawn.log_weights
    log_evidence = float(np.asarray(logsumexp(w)) - np.log(draws))
    return Weighed(
        log_evidence,
        stderr=float(np.std(np.exp(w - log_evidence), ddof=1) / np.sqrt(draws)),
        pareto_k=diagnostics.pareto_k(w),
        effective=effective(w),
        evaluations=evaluations,
        outcome=_poor(w),
        scores=drawn.shared,
        log_weights=w,
    )


def _poor(log_weights: np.ndarray) -> str:
    """Why weights, (n,), are not to be trusted, or `ok`."""
    k, size = diagnostics.pareto_k(log_weights), effective(log_weights)
    if not k < K_LIMIT:
        return f"not to be trusted: Pareto shape of the weights is {k:.2f}, above {K_LIMIT}"
    return OK if size >= LEAST else f"not to be trusted: {size:.0f} effective draws, below {LEAST}"


def _draw(mode: JointMode, proposal: _Proposal, rng: np.random.Generator, n: int, inner: int) -> _Drawn:
    joint, k = mode.joint, len(mode.joint.shared)
    shared = proposal.shared.draw(rng, n)
    weights = log_prior_of(shared, joint.reflected[:k], joint.scaled[:k]) - proposal.shared.log_density(
        shared
    )
    repeated = np.repeat(shared, inner, axis=0)
    scores, densities = [], []
    for j in range(len(joint.records)):
        y, density = np.zeros((n * inner, 0)), np.zeros(n * inner)
        if joint.live[j]:
            reflected = joint.reflected[joint.parts[j]]
            given = proposal.own[j].given(repeated - proposal.shared.centre, reflected)
            y = given.draw(rng, n * inner)
            density = log_prior_of(y, reflected, joint.scaled[joint.parts[j]]) - given.log_density(y)
        scores.append(y)
        densities.append(density)

    def likelihood(j: int) -> np.ndarray:
        return mode.local[j].log_likelihood(joint.scores(j, repeated, scores[j]))

    # Records side by side, in threads: nearly all of it is compiled, and other processes have nothing to do by now.
    with ThreadPoolExecutor(min(len(joint.records), cores())) as threads:
        heights = list(threads.map(likelihood, range(len(joint.records))))
    own_weights = [(h + d).reshape(n, inner) for h, d in zip(heights, densities, strict=True)]
    for one in own_weights:
        weights = weights + logsumexp(one, axis=1) - np.log(inner)
    own = [y.reshape(n, inner, -1) for y in scores]
    return _Drawn(shared, own, np.asarray(weights), own_weights)


def _refitted(joint: Joint, drawn: _Drawn) -> _Proposal:
    w = shares(_flattened(drawn.log_weights))
    mean = w @ drawn.shared
    away = drawn.shared - mean
    parts = []
    for own, log_inner in zip(drawn.own, drawn.inner, strict=True):
        some = np.where(np.isfinite(log_inner), log_inner, -1e300)
        v = w[:, None] * np.exp(some - logsumexp(some, axis=1, keepdims=True))
        centre = np.einsum("ij,ijm->m", v, own)
        apart = own - centre
        across = np.einsum("ij,ijm,ik->mk", v, apart, away)
        parts.append((centre, across, np.einsum("ij,ijm,ijl->ml", v, apart, apart)))
    # The covariance of a Student t is wider than its scale; the factor makes up for it, and for few pilot draws.
    scale = (DEGREES - 2) / DEGREES * WIDER
    covariance = np.einsum("i,ik,il->kl", w, away, away)
    return _Proposal(joint, mean, scale * covariance, [(m, scale * a, scale * c) for m, a, c in parts])


def _flattened(log_weights: np.ndarray) -> np.ndarray:
    """Log weights times a power of at most 1 at which enough draws are effective: the fit is then too wide, not one
    lucky draw's."""
    power = 1.0
    while effective(power * log_weights) < ENOUGH * log_weights.size:
        power *= 0.8
    return power * log_weights


def _factor(covariance: np.ndarray) -> np.ndarray:
    """Cholesky factor of a covariance that rounding, or few draws, may have left without full rank."""
    if not covariance.size:
        return covariance
    sd = np.sqrt(np.diag(covariance))
    correlation = 0.5 * (covariance + covariance.T) / np.outer(sd, sd)
    return sd[:, None] * np.linalg.cholesky(correlation + 1e-9 * np.eye(sd.size))
