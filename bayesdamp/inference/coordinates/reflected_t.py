"""A heavy-tailed proposal on reflected scores."""

from __future__ import annotations

from itertools import product

import numpy as np
from scipy.special import gammaln, logsumexp

DEGREES = 7.0


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
