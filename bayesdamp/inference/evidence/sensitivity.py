"""How the evidence depends on the width of the damping's priors, and how well a first half predicts the second."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.special import logsumexp

from bayesdamp.inference.checks.checks import DRAWS
from bayesdamp.inference.checks.forecast import Ahead
from bayesdamp.inference.curves.weighted import effective, resampled
from bayesdamp.inference.evidence.methods.importance import K_LIMIT, Importance
from bayesdamp.inference.fit.mode import Mode, mode_near
from bayesdamp.numerics.pareto import pareto_k
from bayesdamp.priors import HalfNormal, LogNormal, Prior
from bayesdamp.types import OK, Evidence, Refusal

FACTORS = np.geomspace(0.1, 10.0, 9)
"""Factors on the prior's scale: two decades."""
ENOUGH = 400.0
"""Effective draws below which importance sampling under the prior itself replaces reweighting."""


@dataclass(frozen=True)
class Widths:
    """Log evidence against the factor on the prior's scale, in arrays of shape (m,).

    Attributes
    ----------
    varied : tuple of str
        Coefficients whose priors changed.
    factors, log_evidence, stderr : ndarray
        The factors, and the log evidence with its standard error in nats.
    effective : ndarray
        Effective number of the reweighted draws.
    anew : ndarray of bool
        Where importance sampling under that prior replaced reweighting.
    trusted : ndarray of bool
        Where the diagnostics are good.
    """

    varied: tuple[str, ...]
    factors: np.ndarray
    log_evidence: np.ndarray
    stderr: np.ndarray
    effective: np.ndarray
    anew: np.ndarray
    trusted: np.ndarray


def widened(prior: Prior, factor: float) -> Prior | None:
    """Return the prior with its scale times the factor and the same support.

    The result is None where the prior has no such scale, or where its scale is unknown and averaged over.
    """
    if isinstance(prior, HalfNormal):
        return HalfNormal(scale=prior.scale * factor)
    if isinstance(prior, LogNormal):
        return LogNormal(median=prior.median, sigma=prior.sigma * factor)
    return None


def against_width(
    priors: Mapping[str, Prior],
    coefficients: Sequence[str],
    y: np.ndarray,
    log_weights: np.ndarray,
    near: Callable[[Mapping[str, Prior]], Mode],
    seed: int,
) -> Widths:
    """Compute the evidence under narrower and wider priors of the damping coefficients, all at once.

    The likelihoods of importance draws do not depend on the prior: each width needs prior densities alone.

    Parameters
    ----------
    priors : mapping of str to Prior
        Of all inferred parameters.
    coefficients : sequence of str
        Of the damping.
    y : ndarray, shape (n, d)
        Importance draws of the reflected scores, in the order of the priors.
    log_weights : ndarray, shape (n,)
        Their log weights under the given priors.
    near : callable
        Returns the mode under other priors. Raises Refusal where there is none.
    seed : int
        Of the draws under other priors.
    """
    varied = tuple(n for n in coefficients if widened(priors[n], 2.0) is not None)
    values = {n: np.asarray(p.value(y[:, i])) for i, (n, p) in enumerate(priors.items()) if n in varied}

    def weighed(factor: float, seed: int) -> tuple[float, float, float, bool, bool]:
        others = {n: p for n in varied if (p := widened(priors[n], factor)) is not None}
        weights = log_weights.copy()
        for name, other in others.items():
            weights += np.asarray(other.log_density(values[name]) - priors[name].log_density(values[name]))
        log_evidence = float(logsumexp(weights) - np.log(weights.size))
        w = np.exp(weights - log_evidence)
        size = effective(weights)
        if size >= ENOUGH and pareto_k(weights) < K_LIMIT:
            return log_evidence, float(np.std(w, ddof=1) / np.sqrt(w.size)), size, False, True
        try:
            mode = near({**priors, **others})
            evidence = Importance().evidence("", mode.likelihood.target, mode, seed)
        except Refusal:
            return np.nan, np.nan, size, True, False
        return evidence.log_evidence, evidence.stderr, size, True, evidence.outcome == OK

    rows = [weighed(factor, seed + i) for i, factor in enumerate(FACTORS if varied else (1.0,))]
    rows *= 1 if varied else FACTORS.size
    return Widths(varied, FACTORS, *(np.array(column) for column in zip(*rows, strict=True)))


def under_priors(mode: Mode, priors: Mapping[str, Prior]) -> Mode:
    """Return the mode under other priors of the same parameters, where laws hold exactly.

    Raises Refusal where there is none.
    """
    target = mode.likelihood.target
    values = target.all_values(mode.z)
    start = np.array([float(p.score(values[n])) for n, p in priors.items()])
    return mode_near(replace(mode.likelihood, target=replace(target, priors=priors)), mode, start)


def first_half(mode: Mode) -> Mode:
    """Return the mode on the first half of the samples, where laws hold exactly. Raises Refusal where there is none."""
    target = mode.likelihood.target
    part = slice(0, target.signal.t.size // 2)
    if part.stop <= len(target.names):
        raise Refusal(f"half the record has {part.stop} samples for {len(target.names)} parameters")
    return mode_near(mode.likelihood.on(part), mode, mode.z)


def predict(
    model: str, half: Mode, carry: Callable[[np.ndarray], Ahead], seed: int
) -> tuple[Evidence, Ahead]:
    """Compute the evidence on the first half of a record by importance sampling, and predict the second half.

    Parameters
    ----------
    model : str
        Name of the model.
    half : Mode
        Of the density on the first half.
    carry : callable
        Maps draws of the scores, (m, d), to the prediction of the second half. Raises Refusal where no draw has a
        finite motion there.
    seed : int
        Of the draws.

    Raises
    ------
    Refusal
        Where the first half has no posterior, or no draw a finite motion over the second.
    """
    evidence = Importance().evidence(model, half.likelihood.target, half, seed)
    rows = resampled(evidence.arrays["log_weights"], DRAWS, np.random.default_rng(seed))
    return replace(evidence, arrays={}), carry(evidence.arrays["y"][rows])


def log_predictive(whole: Evidence, half: Evidence) -> tuple[float, float]:
    """Return the log density of the second half given the first, and its standard error.

    It is a difference of log evidences, and nan where one of them is not trusted.
    """
    if not whole.outcome == half.outcome == OK:
        return float("nan"), float("nan")
    return whole.log_evidence - half.log_evidence, float(np.hypot(whole.stderr, half.stderr))
