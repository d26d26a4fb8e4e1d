"""A normal distribution of the scores that ends where a reflected one is zero."""

from __future__ import annotations

from functools import cached_property

import numpy as np

from bayesdamp.inference.coordinates.whitening import FAR, truncated_moments
from bayesdamp.inference.fit.mode import Mode
from bayesdamp.inference.model.likelihood import Likelihood
from bayesdamp.inference.model.target import Target
from bayesdamp.numerics.orthant import draw
from bayesdamp.types import Refusal

H = 0.01
"""Whitened units to each side over which gradients are compared for the Hessian."""
RARE = 0.02
"""Share inside the walls below which rejection gives way to importance resampling."""


class TruncatedNormal:
    """N(mean, covariance), shapes (d,) and (d, d), where the reflected scores, (d,) of bool, are not negative.

    walls: indices of the reflected scores that are near enough to zero for this to matter.
    """

    def __init__(self, mean: np.ndarray, covariance: np.ndarray, reflected: np.ndarray) -> None:
        self.mean, self.covariance, self.reflected = mean, 0.5 * (covariance + covariance.T), reflected
        self.walls = np.flatnonzero(reflected & (mean < FAR * np.sqrt(np.diag(covariance))))

    @cached_property
    def moments(self) -> tuple[np.ndarray, np.ndarray]:
        """Mean (d,) and the Cholesky factor of the covariance (d, d) of what is left."""
        none = np.zeros(self.mean.size)
        return truncated_moments(np.linalg.inv(self.covariance), none, self.mean, self.walls)

    def draw(self, rng: np.random.Generator, n: int) -> np.ndarray:
        """Independent draws, shape (n, d)."""
        factor = np.linalg.cholesky(self.covariance)
        kept = np.empty((0, self.mean.size))
        while len(kept) < n:
            z = self.mean + rng.standard_normal((max(n, 1000), self.mean.size)) @ factor.T
            inside = np.all(z[:, self.walls] >= 0, axis=1)
            if np.mean(inside) < RARE:
                return draw(rng, self.mean, factor, self.walls, n)
            kept = np.concatenate([kept, z[inside]])
        return kept[:n]

    def log_density(self, z: np.ndarray) -> np.ndarray:
        """Log density at scores z, (n, d), up to a constant; −∞ beyond a wall."""
        white = np.linalg.solve(np.linalg.cholesky(self.covariance), (z - self.mean).T)
        inside = np.all(z[:, self.walls] >= 0, axis=1)
        return np.where(inside, -0.5 * np.sum(white**2, axis=0), -np.inf)


def about(mode: Mode) -> TruncatedNormal:
    """Return the normal with the mode's covariance and the log posterior's gradient there, cut off."""
    return near(mode.near, mode.z, mode.factor)


def near(likelihood: Likelihood, z: np.ndarray, factor: np.ndarray) -> TruncatedNormal:
    """Return the normal with the covariance factor @ factor.T and the log posterior's gradient at z, (d,), cut off."""
    reflected = likelihood.target.reflected
    at = np.where(reflected, np.abs(z), z)
    slope = likelihood.gradient(at)[1]
    covariance = factor @ factor.T
    return TruncatedNormal(at + covariance @ slope, covariance, reflected)


def laplace(target: Target, mode: Mode) -> TruncatedNormal:
    """The normal with the log posterior's gradient and whole Hessian at the mode, cut off; of the scales that
    coefficients may share, with the one that stands for all near the mode.

    The Hessian by differences of gradients, from a point that is moved off a wall so far that none crosses it. A mode
    at zero, where the gradient is not zero, makes a normal with its mean beyond the wall.
    Raises Refusal where the Hessian is not positive definite.
    """
    reflected, factor = target.reflected, mode.factor
    at = np.where(reflected, np.maximum(np.abs(mode.z), 2 * H * mode.sd()), mode.z)

    def slope(z: np.ndarray) -> np.ndarray:
        return mode.near.gradient(z)[1]

    rows = [(slope(at - H * column) - slope(at + H * column)) / (2 * H) for column in factor.T]
    white = np.stack(rows) @ factor
    white = 0.5 * (white + white.T)
    if not np.all(np.isfinite(white)) or np.linalg.eigvalsh(white)[0] <= 0:
        raise Refusal("the posterior has no width at its mode: the Hessian there is not positive definite")
    covariance = factor @ np.linalg.inv(white) @ factor.T
    return TruncatedNormal(at + covariance @ slope(at), covariance, reflected)
