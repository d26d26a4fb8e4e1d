"""The Savage–Dickey ratio: the Bayes factor of two nested models from the posterior of the larger one alone."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import ArrayLike

from bayesdamp.inference.checks import diagnostics
from bayesdamp.priors import SHARED_SIGMAS, HalfNormal, Prior, SharedHalfNormal, shared_log_density
from bayesdamp.types import NestedRatio

FARTHEST = 5.0
"""Log Bayes factor beyond which draws do not determine the density at zero."""
DEGREE = 3
LOWER = 0.5
"""Share of the draws, the smallest, whose density the curve is fitted to: the other flank is irrelevant at zero."""
FAR_FROM_ZERO = 0.5
"""If the smallest draw exceeds this, in medians, the density at zero is not determined."""
NODES = 400
STEPS = 100


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
    size = diagnostics.effective_mean(draws)
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
