"""The evidence of a law that holds approximately, its deviations integrated out: by importance, bridge and nested
sampling.

All are of `Marginal`, the density that NUTS and emcee draw from; the first two are proposed to by a Student t that is
reflected where a coefficient cannot be negative.
"""

from __future__ import annotations

import time

import numpy as np
from numpy.typing import NDArray
from scipy.special import logsumexp

from bayesdamp.inference.approximate.law import Approximate
from bayesdamp.inference.checks.diagnostics import pareto_k
from bayesdamp.inference.curves.weighted import effective
from bayesdamp.inference.deviation.sampled.marginal import Marginal, marginal_of
from bayesdamp.inference.evidence.methods.bridge import APART, OVERLAP_LIMIT, PROPOSALS, Span, fitted, span
from bayesdamp.inference.evidence.methods.importance import FEWEST, K_LIMIT, trusted
from bayesdamp.inference.evidence.methods.nested import Density, integrated, standard_normal
from bayesdamp.types import OK, Evidence

Array = NDArray[np.float64]
FINAL = 2000
"""Weighted draws: a motion each."""
ROUNDS = 3
"""How often the proposal is moved to weighted draws, at most."""
LINEAR = "the linear model's own: parameters and deviations integrated out about the best motion"


def linear(law: Approximate, model: str, method: str) -> Evidence:
    """Of the model that is linear in parameters and deviations: without sampling, and without an error."""
    weighed = law.single.result.weighed
    assert weighed is not None
    return Evidence(model, method, float(weighed.log_evidence), diagnostic=LINEAR)


def by_importance(law: Approximate, model: str, method: str, seed: int) -> Evidence:
    """The mean importance weight, from a fit to the linear posterior that is moved to the weighted draws where it
    hardly meets the density. Raises Refusal where no motion with deviations can be followed."""
    began, rng = time.perf_counter(), np.random.default_rng(seed)
    target = marginal_of(law.single.weighing, law.single.result)
    z = law.scores[:, : target.positive.size]
    y, log_weights, count = np.empty(0), np.empty(0), 0
    for _ in range(ROUNDS):
        proposal = fitted(z, target.positive)
        y = proposal.draw(rng, FINAL)
        log_weights = target.log_density(y) - proposal.log_density(y)
        count += FINAL
        if pareto_k(log_weights) < K_LIMIT and effective(log_weights) >= 2 * FEWEST:
            break
        weights = np.exp(log_weights - logsumexp(log_weights))
        z = y[rng.choice(FINAL, FINAL, p=weights)]
        if len(np.unique(z, axis=0)) <= target.positive.size:
            break  # too few to span a volume
    log_evidence = float(logsumexp(log_weights) - np.log(FINAL))
    relative = np.exp(log_weights - log_evidence)
    k, worth = float(pareto_k(log_weights)), float(effective(log_weights))
    return Evidence(
        model=model,
        method=method,
        log_evidence=log_evidence,
        stderr=float(np.std(relative, ddof=1) / np.sqrt(FINAL)),
        diagnostic=f"Pareto k {k:.2f}, effective share {worth / FINAL:.2f}",
        evaluations=count,
        seconds=time.perf_counter() - began,
        outcome=trusted(k, worth),
        arrays={"y": y, "log_weights": log_weights},
    )


def by_bridge(law: Approximate, model: str, method: str, draws: Array, drawn: str, seed: int) -> Evidence:
    """Meng and Wong's bridge from draws of the posterior, (chain, draw, parameter) in natural units, to a fit to half
    of them, and the other way round. drawn: the sampler's outcome. Raises Refusal where no motion with deviations can
    be followed."""
    began, rng = time.perf_counter(), np.random.default_rng(seed)
    target = marginal_of(law.single.weighing, law.single.result)
    priors = law.single.found.priors
    z = np.stack([np.asarray(priors[n].score(draws[..., i])) for i, n in enumerate(law.names)], axis=-1)
    half = z.shape[1] // 2
    parts = z[:, :half], z[:, half : 2 * half]
    spans = [_span(target, shaping, bridged, rng) for shaping, bridged in (parts, parts[::-1])]
    apart = abs(spans[0].log_evidence - spans[1].log_evidence) / np.linalg.norm([s.stderr for s in spans])
    overlap = min(s.overlap for s in spans)
    outcome = OK
    if drawn != OK:
        outcome = f"not to be trusted: its posterior draws are {drawn}"
    elif not overlap > OVERLAP_LIMIT:
        outcome = f"not to be trusted: posterior and fit overlap by {overlap:.2f}, less than {OVERLAP_LIMIT}"
    elif not apart < APART:
        outcome = f"not to be trusted: the two halves of the draws are {apart:.1f} standard errors apart"
    return Evidence(
        model=model,
        method=method,
        log_evidence=0.5 * sum(s.log_evidence for s in spans),
        stderr=0.5 * float(np.linalg.norm([s.stderr for s in spans])),
        diagnostic=f"overlap {overlap:.2f}, halves {apart:.1f} standard errors apart",
        evaluations=z.shape[0] * 2 * half + 2 * PROPOSALS,
        seconds=time.perf_counter() - began,
        outcome=outcome,
    )


def by_nested(law: Approximate, model: str, method: str, seed: int) -> Evidence:
    """Nested sampling over the prior, or about the linear posterior where the prior is too wide for it. Raises Refusal
    where no motion with deviations can be followed."""
    target = marginal_of(law.single.weighing, law.single.result)
    d = target.positive.size
    factor = np.linalg.cholesky(np.atleast_2d(np.cov(law.scores[:, :d].T)))
    mode = law.best[0, :d]
    doubled = target.positive.sum() * np.log(2.0)
    density = Density(
        target.positive,
        lambda z: target.log_density(z) - standard_normal(z) - doubled,
        target.log_density,
        mode,
        factor,
    )
    return integrated(model, method, density, seed, linear(law, model, method).log_evidence)


def _span(target: Marginal, shaping: Array, bridged: Array, rng: np.random.Generator) -> Span:
    proposal = fitted(shaping.reshape(-1, target.positive.size), target.positive)
    there = proposal.draw(rng, PROPOSALS)
    flat = bridged.reshape(-1, target.positive.size)
    at_draws = target.log_density(flat) - proposal.log_density(flat)
    at_proposals = target.log_density(there) - proposal.log_density(there)
    return span(at_draws.reshape(bridged.shape[:2]), at_proposals)
