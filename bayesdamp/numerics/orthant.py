"""Distributions of coordinates of which some are not negative.

The probability that a few normal coordinates are not negative, draws under this condition, and a heavy-tailed
distribution that is reflected at zero.
"""

from __future__ import annotations

from itertools import product

import numpy as np
from scipy.special import gammaln, log_ndtr, logsumexp, ndtr, ndtri, ndtri_exp

POINTS = 24
"""Nodes of the Gauss–Legendre rule (conventional)."""
FAINTEST = 1e-280
"""Probability above zero below which quantiles are computed from its logarithm (conventional)."""
NESTED, LATTICE = 3, 256
"""Most coordinates for which rules are nested, and points of the lattice for more."""
SURE = 7.0
"""Standard deviations above zero of the least likely coordinate at which all are positive: to 1e-12 a coordinate."""
PRIMES = np.array([2, 3, 5, 7, 11, 13, 17, 19, 23, 29, 31, 37, 41, 43, 47, 53], float)
DEGREES = 7.0
"""Degrees of freedom of the reflected Student t."""
_X, _W = np.polynomial.legendre.leggauss(POINTS)
SHARES, WEIGHTS = 0.5 * (_X + 1), 0.5 * _W


def log_probability(mean: np.ndarray, covariance: np.ndarray) -> np.ndarray:
    """Return log P(all coordinates ≥ 0), shape (c,), for normals with means (c, k) and covariances (c, k, k).

    One coordinate after the other is conditioned on by Gauss–Legendre nodes in its own truncated probability, the least
    likely one first: the others, given it, are smooth in its share (G. J. Gibson, C. A. Glasbey and D. A. Elston, in
    Advances in Numerical Methods and Applications, World Scientific 1994, 120).
    """
    count, k = mean.shape
    if k == 0:
        return np.zeros(count)
    if k > 1:
        sd = np.sqrt(np.maximum(np.diagonal(covariance, axis1=1, axis2=2), 1e-300))
        order, rows = np.argsort(mean / sd, axis=1), np.arange(count)[:, None]
        mean = mean[rows, order]
        covariance = covariance[rows[:, :, None], order[:, :, None], order[:, None, :]]
        unsure = mean[:, 0] < SURE * np.sqrt(covariance[:, 0, 0])
        if not unsure.all():
            logs = np.zeros(count)
            if unsure.any():
                logs[unsure] = log_probability(mean[unsure], covariance[unsure])
            return logs
    if k > NESTED:
        return _log_probability_by_lattice(mean, covariance)
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


def _log_probability_by_lattice(mean: np.ndarray, covariance: np.ndarray) -> np.ndarray:
    """Return the same for many coordinates, for which nested rules would have too many nodes.

    It is Geweke, Hajivassiliou and Keane's product of conditional probabilities over a lattice of shares
    (R. D. Richtmyer 1951).
    """
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


def truncated(mean: np.ndarray, sd: np.ndarray, shares: np.ndarray) -> np.ndarray:
    """Return quantiles at `shares`, (c, p), of normals (c,) that are truncated at zero."""
    above = ndtr(mean / sd)[:, None]
    if above.min(initial=1.0) > FAINTEST:
        score = -ndtri(np.maximum((1 - shares) * above, 1e-300))
    else:
        with np.errstate(divide="ignore"):
            score = -ndtri_exp(np.log1p(-shares) + log_ndtr(mean / sd)[:, None])
    return np.maximum(mean[:, None] + sd[:, None] * score, 0.0)


def draw(
    rng: np.random.Generator,
    mean: np.ndarray,
    factor: np.ndarray,
    places: np.ndarray,
    count: int | np.ndarray,
) -> np.ndarray:
    """Draw from normals with means (c, d) and covariances factor·factorᵀ, factors (c, d, d), that are ≥ 0 at `places`.

    The constrained coordinates are drawn one after the other, the least likely first, from truncated normals (Geweke,
    Hajivassiliou and Keane) and resampled by their weights; the others follow by conditioning.

    Parameters
    ----------
    rng
        The random generator.
    mean, factor
        Of each normal; for a single one also (d,) and (d, d).
    places
        Coordinates that are not negative.
    count
        Number of draws from each normal, (c,).

    Returns
    -------
    np.ndarray
        The draws, (sum of count, d), those of the first normal first.
    """
    mean, counts = np.atleast_2d(mean), np.atleast_1d(count)
    factor = factor.reshape(-1, *factor.shape[-2:])
    owner = np.repeat(np.arange(counts.size), counts)
    parts = np.split(rng.standard_normal((owner.size, factor.shape[2])), np.cumsum(counts)[:-1])
    free = mean[owner] + np.concatenate([z @ f.T for z, f in zip(parts, factor, strict=True)])
    if places.size == 0:
        return free
    rows = np.arange(counts.size)[:, None]
    spread = np.einsum("cij,cij->ci", factor, factor)[:, places]
    places = places[np.argsort(mean[:, places] / np.sqrt(spread + 1e-300), axis=1)]  # (c, k)
    own = factor[rows, places]
    part = own @ np.swapaxes(own, 1, 2)
    part = part + (1e-14 * np.diagonal(part, axis1=1, axis2=2) + 1e-300)[:, :, None] * np.eye(places.shape[1])
    lower = np.linalg.cholesky(part)
    constrained = _truncated_draws(rng, mean[rows, places], lower, counts)
    gain = np.swapaxes(np.linalg.solve(part, own @ np.swapaxes(factor, 1, 2)), 1, 2)
    at = places[owner]
    off = constrained - np.take_along_axis(free, at, axis=1)
    parts = np.split(off, np.cumsum(counts)[:-1])
    draws = free + np.concatenate([o @ g.T for o, g in zip(parts, gain, strict=True)])
    np.put_along_axis(draws, at, np.maximum(constrained, 0.0), axis=1)
    return draws


def _truncated_draws(
    rng: np.random.Generator, mean: np.ndarray, lower: np.ndarray, counts: np.ndarray
) -> np.ndarray:
    """Draw from normals with means (c, k) and triangles (c, k, k), all of whose coordinates are ≥ 0."""
    tries = np.repeat(np.arange(counts.size), 4 * counts)
    scores, log_weight = np.zeros((tries.size, mean.shape[1])), np.zeros(tries.size)
    for i in range(mean.shape[1]):
        centre = mean[tries, i] + np.einsum("ni,ni->n", scores[:, :i], lower[tries, i, :i])
        sd = lower[tries, i, i]
        log_weight += log_ndtr(centre / sd)
        value = truncated(centre, sd, rng.random((tries.size, 1)))[:, 0]
        scores[:, i] = (value - centre) / sd
    highest = np.full(counts.size, -np.inf)
    np.maximum.at(highest, tries, log_weight)
    weight = np.exp(log_weight - highest[tries])
    weight /= np.bincount(tries, weight)[tries]
    owner = np.repeat(np.arange(counts.size), counts)
    # The weights of each normal sum to 1, so those of the next begin 1 further along.
    chosen = np.searchsorted(np.cumsum(weight), owner + rng.random(owner.size))
    chosen = np.clip(chosen, 4 * (np.cumsum(counts) - counts)[owner], 4 * np.cumsum(counts)[owner] - 1)
    return mean[owner] + np.einsum("nij,nj->ni", lower[owner], scores[chosen])


class ReflectedT:
    """A multivariate Student t, reflected onto the non-negative side of some directions.

    Parameters
    ----------
    centre : ndarray, shape (d,)
        Before it is reflected.
    factor : ndarray, shape (d, d)
        Cholesky factor of the scale.
    reflected : ndarray of bool, shape (d,)
        Which directions are reflected.
    """

    def __init__(self, centre: np.ndarray, factor: np.ndarray, reflected: np.ndarray) -> None:
        self.centre, self.factor, self.reflected = centre, factor, reflected
        d = factor.shape[0]
        self._constant = (
            gammaln(0.5 * (DEGREES + d))
            - gammaln(0.5 * DEGREES)
            - 0.5 * d * np.log(DEGREES * np.pi)
            - np.sum(np.log(np.diag(factor)))
        )
        index = np.flatnonzero(reflected)
        self._signs = np.ones((2**index.size, d))
        self._signs[:, index] = list(product((1.0, -1.0), repeat=index.size))

    def draw(self, rng: np.random.Generator | np.random.RandomState, n: int) -> np.ndarray:
        """Return independent draws, (n, d)."""
        normal = rng.standard_normal((n, self.factor.shape[0]))
        scale = np.sqrt(DEGREES / rng.chisquare(DEGREES, n))[:, None]
        z = self.centre + (normal * scale) @ self.factor.T
        return np.where(self.reflected, np.abs(z), z)

    def log_density(self, y: np.ndarray) -> np.ndarray:
        """Return the log density at reflected points y, (n, d): the sum over all mirror images."""
        d = self.factor.shape[0]
        images = (y[None] * self._signs[:, None] - self.centre).reshape(-1, d)
        white = np.linalg.solve(self.factor, images.T)
        kernel = -0.5 * (DEGREES + d) * np.log1p(np.sum(white**2, axis=0) / DEGREES)
        return self._constant + logsumexp(kernel.reshape(len(self._signs), -1), axis=0)


def fitted(y: np.ndarray, reflected: np.ndarray) -> ReflectedT:
    """Return the reflected t with the mean and covariance of draws on the reflected side, (n, d)."""
    covariance = np.atleast_2d(np.cov(y.T, ddof=1)) * (DEGREES - 2) / DEGREES
    return ReflectedT(y.mean(axis=0), np.linalg.cholesky(covariance), reflected)
