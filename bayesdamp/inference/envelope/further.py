"""Parameters of terms beside their coefficients: points of their posterior, by adaptive importance sampling.

Rounds of points, each from a normal about what the earlier ones found, are weighed against the mixture of all of these
(J.-M. Cornuet, J.-M. Marin, A. Mira and C. P. Robert, Scand. J. Stat. 39, 798 (2012)); a low-discrepancy sequence takes
the place of random numbers.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.special import ndtri

ROUND = 16
ROUNDS = 12
"""At most: a parameter that is known to a thousandth of its prior takes eight."""
ENOUGH = 32.0
"""Effective points at which it is done."""
WIDER = 1.5
"""Variance of a round's normal over that of the points so far."""
FLATTER = 0.8
"""Powers of weights that are tried, each of the one before."""
REACH = 5.0
"""Of scores: normals beyond are one in a million."""

Normal = tuple[np.ndarray, np.ndarray]
"""Mean (e,) and triangle (e, e)."""


@dataclass(frozen=True)
class Explored:
    """points: scores (n, e); log_weight: of each, (n,), whose exponentials sum to the integral."""

    points: np.ndarray
    log_weight: np.ndarray

    @property
    def log_integral(self) -> float:
        """ln of the integral of the density."""
        return float(np.logaddexp.reduce(self.log_weight))

    @property
    def best(self) -> np.ndarray:
        """The point of the largest weight, (e,)."""
        return self.points[int(np.argmax(self.log_weight))]

    def resampled(self, count: int) -> np.ndarray:
        """Points, (count, e), that are worth the same each, evenly through the posterior."""
        weight = _normalised(self.log_weight)
        off = self.points - weight @ self.points
        widest = np.linalg.eigh((off.T * weight) @ off)[1][:, -1]
        order = np.argsort(self.points @ widest)
        cumulative = np.cumsum(_normalised(self.log_weight[order]))
        at = np.searchsorted(cumulative, (np.arange(count) + 0.5) / count)
        return self.points[order][np.minimum(at, len(order) - 1)]


def explore(
    log_likelihood: Callable[[tuple[float, ...]], float], count: int, rounds: int = ROUNDS
) -> Explored:
    """Points of the density of `count` scores, standard normal before, times a likelihood of them."""
    prior: Normal = (np.zeros(count), np.eye(count))
    proposals = [prior]
    points, logs = np.empty((0, count)), np.empty(0)
    used = 0
    while True:
        for mean, triangle in proposals[used:]:
            drawn = np.clip(ndtri(_even(len(points), count)) @ triangle.T + mean, -REACH, REACH)
            points = np.vstack([points, drawn])
            logs = np.append(logs, [log_likelihood(tuple(one)) for one in drawn.tolist()])
        used = len(proposals)
        mixture = np.logaddexp.reduce([_log_normal(points, *one) for one in proposals], axis=0)
        log_weight = logs + _log_normal(points, *prior) - mixture - np.log(ROUND)
        if _effective(log_weight) >= ENOUGH or used >= rounds:
            return Explored(points, log_weight)
        proposals.append(_fitted(points, log_weight, 2.0 + 2.0 * count))


def _fitted(points: np.ndarray, log_weight: np.ndarray, least: float) -> Normal:
    """A normal of the weighted points; weights are flattened until they are worth `least` of them."""

    power = 1.0
    while _effective(power * log_weight) < least:
        power *= FLATTER
    weight = _normalised(power * log_weight)
    mean = weight @ points
    off = points - mean
    covariance = WIDER * (off.T * weight) @ off
    covariance += 1e-10 * np.eye(mean.size) + 1e-4 * np.diag(np.diag(covariance))
    return mean, np.linalg.cholesky(covariance)


def _even(first: int, count: int) -> np.ndarray:
    """The next ROUND points of an additive recurrence that fills the unit cube evenly, (ROUND, count): its steps are
    powers of the root of x^(count + 1) = x + 1 (M. Roberts 2018, after the golden ratio)."""
    root = 2.0
    for _ in range(40):
        root = (1.0 + root) ** (1.0 / (count + 1))
    steps = root ** -np.arange(1.0, count + 1)
    return (0.5 + np.arange(first + 1, first + ROUND + 1)[:, None] * steps) % 1.0


def _effective(log_weight: np.ndarray) -> float:
    weight = _normalised(log_weight)
    return float(1.0 / (weight @ weight))


def _normalised(log_weight: np.ndarray) -> np.ndarray:
    weight = np.exp(log_weight - log_weight.max())
    return weight / weight.sum()


def _log_normal(points: np.ndarray, mean: np.ndarray, triangle: np.ndarray) -> np.ndarray:
    z = np.linalg.solve(triangle, (points - mean).T)
    return (
        -0.5 * np.sum(z * z, axis=0) - np.log(np.diag(triangle)).sum() - 0.5 * mean.size * np.log(2 * np.pi)
    )
