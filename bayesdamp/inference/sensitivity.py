"""What an evidence depends on.

Its change with the width of the damping's priors, with the first half of the record alone, and without one coefficient
(Savage and Dickey's ratio, from the posterior of the larger model).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
import scipy  # loads its modules when they are used
from numpy.typing import ArrayLike

from bayesdamp.inference.checks import DRAWS, Ahead
from bayesdamp.inference.diagnostics import effective_mean
from bayesdamp.inference.evidence.importance import K_LIMIT, Importance
from bayesdamp.inference.mode import Mode, mode_near
from bayesdamp.numerics.weights import effective_size, pareto_k, resample
from bayesdamp.priors import (
    SHARED_SIGMAS,
    HalfNormal,
    LogNormal,
    Prior,
    SharedHalfNormal,
    shared_log_density,
)
from bayesdamp.types import OK, Evidence, NestedRatio, Refusal

FACTORS = np.geomspace(0.1, 10.0, 9)
"""Factors on the prior's scale: two decades."""
ENOUGH = 400.0
"""Effective draws below which importance sampling under the prior itself replaces reweighting."""
FARTHEST = 5.0
"""Log Bayes factor beyond which draws do not determine the density at zero."""
DEGREE = 3
"""Of the polynomial that is the log density near zero."""
LOWER = 0.5
"""Share of the draws, the smallest, whose density the curve is fitted to: the other flank is irrelevant at zero."""
FAR_FROM_ZERO = 0.5
"""If the smallest draw exceeds this, in medians, the density at zero is not determined."""
NODES = 400
STEPS = 100


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
        log_evidence = float(scipy.special.logsumexp(weights) - np.log(weights.size))
        w = np.exp(weights - log_evidence)
        size = effective_size(weights)
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
    rows = resample(evidence.arrays["log_weights"], DRAWS, np.random.default_rng(seed))
    return replace(evidence, arrays={}), carry(evidence.arrays["y"][rows])


def log_predictive(whole: Evidence, half: Evidence) -> tuple[float, float]:
    """Return the log density of the second half given the first, and its standard error.

    It is a difference of log evidences, and nan where one of them is not trusted.
    """
    if not whole.outcome == half.outcome == OK:
        return float("nan"), float("nan")
    return whole.log_evidence - half.log_evidence, float(np.hypot(whole.stderr, half.stderr))


def savage_dickey(
    priors: Mapping[str, Prior],
    name: str,
    scores: Mapping[str, np.ndarray],
    scales: ArrayLike = SHARED_SIGMAS,
) -> NestedRatio:
    """Return the log Bayes factor of the model without a coefficient to the one with it.

    It is the log of the ratio of posterior to prior density of the coefficient at zero, on the reflected axis. Where
    the coefficient shares an unknown scale with others, the prior of these given that it is zero differs from their
    prior in the smaller model. The posterior is then weighted by the ratio of the two, which depends on the others' sum
    of squares.

    Parameters
    ----------
    priors : mapping of str to Prior
        Of the parameters of the larger model.
    name : str
        The coefficient. Its prior must be a half-normal with a given or a shared scale.
    scores : mapping of str to ndarray
        Posterior draws of the parameters' scores, shape (chain, draw) each.
    scales : array_like, shape (s,)
        Scales in scores that coefficients may share.

    Returns
    -------
    NestedRatio
        It applies within 5 nats: farther out no draw is near zero.

    References
    ----------
    Dickey, Annals of Mathematical Statistics 42, 1971; Verdinelli and Wasserman, Journal of the American Statistical
    Association 90, 1995, for other priors of the smaller model.
    """
    prior, draws = priors.get(name), scores.get(name)
    if draws is None or not isinstance(prior, HalfNormal | SharedHalfNormal):
        return NestedRatio(outcome="not applicable: its prior is not a half-normal")
    log_ratios = np.full(draws.shape, -0.5 * np.log(2.0 / np.pi))
    if isinstance(prior, SharedHalfNormal):
        others = [n for n, p in priors.items() if n != name and isinstance(p, SharedHalfNormal)]
        squares = np.sum([scores[n] ** 2 for n in others], axis=0) if others else np.zeros(draws.shape)
        smaller = shared_log_density(squares, len(others), scales)
        log_ratios = smaller - shared_log_density(squares, len(others) + 1, scales)
    top = float(log_ratios.max())
    weights = np.exp(log_ratios - top)
    size = effective_mean(draws)
    log_density, error = density_at_zero(draws.ravel(), size, weights.ravel() / weights.mean())
    ratio = log_density + top + float(np.log(weights.mean()))
    if not (abs(ratio) < FARTHEST and error < 1.0):
        return NestedRatio(ratio, error, "not applicable: beyond 5 nats, or too few draws near zero")
    return NestedRatio(ratio, error)


def density_at_zero(
    x: np.ndarray, effective: float, weights: np.ndarray | None = None
) -> tuple[float, float]:
    """Estimate the log density at 0 of draws.

    The density is the exponential of a cubic on [0, median], fitted by maximum likelihood. A truncated normal has this
    form, and nothing is smoothed across zero.

    Parameters
    ----------
    x : ndarray, shape (n,)
        Draws, not negative.
    effective : float
        Their effective number.
    weights : ndarray, shape (n,), optional
        With mean 1; equal by default.

    Returns
    -------
    log_density, stderr : float
        The log density and its standard error.
    """
    top = float(np.quantile(x, LOWER))
    low = x <= top
    u = x[low] / top
    w = np.ones(u.size) if weights is None else weights[low]
    if weights is not None:
        effective *= float(np.sum(weights) ** 2 / np.sum(weights**2) / weights.size)
    if u.min() > FAR_FROM_ZERO:
        return float("nan"), float("inf")
    nodes, cells = np.polynomial.legendre.leggauss(NODES)
    nodes, cells = 0.5 * (nodes + 1.0), 0.5 * cells
    basis = np.stack([nodes**k for k in range(1, DEGREE + 1)])
    wanted = np.array([np.average(u**k, weights=w) for k in range(1, DEGREE + 1)])
    c = np.zeros(DEGREE)

    def moments(c: np.ndarray) -> tuple[float, np.ndarray, np.ndarray]:
        height = c @ basis
        most = height.max()
        mass = cells * np.exp(height - most)
        total = mass.sum()
        mean = basis @ mass / total
        return most + np.log(total), mean, (basis * mass / total) @ basis.T - np.outer(mean, mean)

    log_total, mean, covariance = moments(c)
    for _ in range(STEPS):
        step = np.linalg.solve(covariance, wanted - mean)
        gain, size = float((wanted - mean) @ step), 1.0
        if gain < 1e-12:
            break
        # The log likelihood is concave: halve the step until it rises.
        before = wanted @ c - log_total
        while True:
            trial = moments(c + size * step)
            if wanted @ (c + size * step) - trial[0] >= before or size < 1e-6:
                break
            size *= 0.5
        c = c + size * step
        log_total, mean, covariance = trial
    # log f(0) = log share − log_total − log top; its gradient by c is −mean, c's covariance the inverse of the basis'.
    share = float(w.sum()) / x.size
    size = share * effective
    variance = mean @ np.linalg.solve(covariance, mean) / size + (1 - share) / size
    error = float(np.sqrt(variance)) if variance > 0 else float("inf")
    return float(np.log(share) - log_total - np.log(top)), error
