"""A heavy-tailed proposal on folded scores."""

from __future__ import annotations

from itertools import product

import numpy as np
from scipy.special import gammaln, logsumexp

DEGREES = 7.0


class FoldedT:
    """A multivariate Student t, folded onto the non-negative side of some directions.

    centre: (d,), or one for each of n draws, (n, d); factor: Cholesky factor of the scale, (d, d); folded: (d,) of
    bool.
    """

    def __init__(self, centre: np.ndarray, factor: np.ndarray, folded: np.ndarray) -> None:
        self.centre, self.factor, self.folded = centre, factor, folded
        d = factor.shape[0]
        self._constant = (
            gammaln(0.5 * (DEGREES + d))
            - gammaln(0.5 * DEGREES)
            - 0.5 * d * np.log(DEGREES * np.pi)
            - np.sum(np.log(np.diag(factor)))
        )
        index = np.flatnonzero(folded)
        self._signs = np.ones((2**index.size, d))
        for row, signs in zip(self._signs, product((1.0, -1.0), repeat=index.size)):
            row[index] = signs

    def draw(self, rng: np.random.Generator | np.random.RandomState, n: int) -> np.ndarray:
        """Draws, shape (n, d)."""
        normal = rng.standard_normal((n, self.factor.shape[0]))
        scale = np.sqrt(DEGREES / rng.chisquare(DEGREES, n))[:, None]
        z = self.centre + (normal * scale) @ self.factor.T
        return np.where(self.folded, np.abs(z), z)

    def log_density(self, y: np.ndarray) -> np.ndarray:
        """Log density at folded points y, shape (n, d): the sum over all mirror images."""
        d = self.factor.shape[0]
        images = (y[None] * self._signs[:, None] - self.centre).reshape(-1, d)
        white = np.linalg.solve(self.factor, images.T)
        kernel = -0.5 * (DEGREES + d) * np.log1p(np.sum(white**2, axis=0) / DEGREES)
        return self._constant + logsumexp(kernel.reshape(len(self._signs), -1), axis=0)
