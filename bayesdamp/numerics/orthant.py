"""The part of a normal distribution in which a few coordinates are not negative: its probability, and draws from it."""

from __future__ import annotations

import numpy as np
from scipy.special import log_ndtr, ndtr, ndtri, ndtri_exp

POINTS = 24
FAINTEST = 1e-280
"""Probability above zero below which quantiles are found from its logarithm (conventional)."""
NESTED, LATTICE = 3, 256
"""Coordinates up to which rules are nested, and points for more."""
SURE = 7.0
"""Standard deviations above zero of the least likely coordinate at which all are positive: to 1e-12 a coordinate."""
PRIMES = np.array([2, 3, 5, 7, 11, 13, 17, 19, 23, 29, 31, 37, 41, 43, 47, 53], float)
_X, _W = np.polynomial.legendre.leggauss(POINTS)
SHARES, WEIGHTS = 0.5 * (_X + 1), 0.5 * _W


def log_probability(mean: np.ndarray, covariance: np.ndarray) -> np.ndarray:
    """Log of P(all coordinates ≥ 0), shape (c,), for normals with means (c, k) and covariances (c, k, k).

    One coordinate after the other is conditioned on by Gauss–Legendre nodes in its own truncated probability, the one
    that is least likely first: the others, given it, are smooth in its share (G. J. Gibson, C. A. Glasbey and
    D. A. Elston, in Advances in Numerical Methods and Applications, World Scientific 1994, 120).
    """
    count, k = mean.shape
    if k == 0:
        return np.zeros(count)
    if k > 1:
        mean, covariance = _least_likely_first(mean, covariance)
        unsure = mean[:, 0] < SURE * np.sqrt(covariance[:, 0, 0])
        if not unsure.all():
            found = np.zeros(count)
            if unsure.any():
                found[unsure] = log_probability(mean[unsure], covariance[unsure])
            return found
    if k > NESTED:
        return _by_lattice(mean, covariance)
    sd = np.sqrt(np.maximum(covariance[:, 0, 0], 1e-300))
    first = log_ndtr(mean[:, 0] / sd)
    if k == 1:
        return first
    at = truncated(mean[:, 0], sd, SHARES[None, :])
    slope = covariance[:, 1:, 0] / covariance[:, :1, 0]
    rest = covariance[:, 1:, 1:] - slope[:, :, None] * covariance[:, None, 0, 1:]
    means = mean[:, None, 1:] + (at - mean[:, :1])[:, :, None] * slope[:, None, :]
    if k == 2:
        inner = log_ndtr(means[:, :, 0] / np.sqrt(np.maximum(rest[:, 0], 1e-300)))
    else:
        inner = log_probability(means.reshape(-1, k - 1), np.repeat(rest, POINTS, axis=0)).reshape(count, -1)
    top = inner.max(axis=1, keepdims=True)
    return first + top[:, 0] + np.log(np.exp(inner - top) @ WEIGHTS)


def _by_lattice(mean: np.ndarray, covariance: np.ndarray) -> np.ndarray:
    """The same of many coordinates, by Geweke, Hajivassiliou and Keane's product of conditional probabilities over a
    lattice of shares (R. D. Richtmyer 1951), which nested rules would be too many for."""
    count, k = mean.shape
    scale = np.sqrt(np.maximum(np.diagonal(covariance, axis1=1, axis2=2), 1e-300))
    part = covariance / (scale[:, :, None] * scale[:, None, :]) + 1e-9 * np.eye(k)
    lower, centres = np.linalg.cholesky(part), mean / scale
    shares = np.mod(0.5 + np.arange(1, LATTICE + 1)[:, None] * np.sqrt(PRIMES[:k]), 1.0)
    scores, log = np.zeros((count, LATTICE, k)), np.zeros((count, LATTICE))
    for i in range(k):
        centre = centres[:, i, None] + np.einsum("cpj,cj->cp", scores[:, :, :i], lower[:, i, :i])
        sd = np.broadcast_to(lower[:, i, i, None], centre.shape)
        log += log_ndtr(centre / sd)
        at = np.broadcast_to(shares[:, i], centre.shape).reshape(-1, 1)
        value = truncated(centre.ravel(), sd.ravel(), at)[:, 0].reshape(centre.shape)
        scores[:, :, i] = (value - centre) / sd
    top = log.max(axis=1, keepdims=True)
    return top[:, 0] + np.log(np.mean(np.exp(log - top), axis=1))


def _least_likely_first(mean: np.ndarray, covariance: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The same normals, (c, k) and (c, k, k), their coordinates in order of the probability of each alone."""
    sd = np.sqrt(np.maximum(np.diagonal(covariance, axis1=1, axis2=2), 1e-300))
    order = np.argsort(mean / sd, axis=1)
    rows = np.arange(len(mean))[:, None]
    return mean[rows, order], covariance[rows[:, :, None], order[:, :, None], order[:, None, :]]


def truncated(mean: np.ndarray, sd: np.ndarray, shares: np.ndarray) -> np.ndarray:
    """Quantiles at `shares`, (c, p), of normals (c,) that are cut off at zero."""
    above = ndtr(mean / sd)[:, None]
    if above.min(initial=1.0) > FAINTEST:
        score = -ndtri(np.maximum((1 - shares) * above, 1e-300))
    else:
        with np.errstate(divide="ignore"):
            score = -ndtri_exp(np.log1p(-shares) + log_ndtr(mean / sd)[:, None])
    return np.maximum(mean[:, None] + sd[:, None] * score, 0.0)


def draw(
    rng: np.random.Generator, mean: np.ndarray, factor: np.ndarray, places: np.ndarray, count: int
) -> np.ndarray:
    """Draws, (count, d), of a normal with mean (d,) and covariance factor·factorᵀ, ≥ 0 at `places`.

    The constrained coordinates are drawn one after the other, the least likely first, from truncated normals (Geweke,
    Hajivassiliou and Keane) and resampled by their weights; the others follow by conditioning.
    """
    if places.size == 0:
        return mean + rng.standard_normal((count, mean.size)) @ factor.T
    covariance = factor @ factor.T
    places = places[np.argsort(mean[places] / np.sqrt(np.diag(covariance)[places] + 1e-300))]
    part = covariance[np.ix_(places, places)]
    lower = np.linalg.cholesky(part + 1e-14 * np.diag(np.diag(part)) + 1e-300 * np.eye(places.size))
    tries = 4 * count
    scores, log_weight = np.zeros((tries, places.size)), np.zeros(tries)
    for i in range(places.size):
        centre = mean[places[i]] + scores[:, :i] @ lower[i, :i]
        sd = np.full(tries, lower[i, i])
        log_weight += log_ndtr(centre / sd)
        value = truncated(centre, sd, rng.random((tries, 1)))[:, 0]
        scores[:, i] = (value - centre) / sd
    weight = np.exp(log_weight - log_weight.max())
    chosen = rng.choice(tries, count, p=weight / weight.sum())
    constrained = mean[places] + scores[chosen] @ lower.T
    free = mean + rng.standard_normal((count, mean.size)) @ factor.T
    gain = covariance[:, places] @ np.linalg.inv(part + 1e-14 * np.diag(np.diag(part)))
    found = free + (constrained - free[:, places]) @ gain.T
    found[:, places] = np.maximum(constrained, 0.0)
    return found
