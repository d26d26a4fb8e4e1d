"""A normal distribution of the scores that ends where a folded one is zero."""

from __future__ import annotations

from functools import cached_property

import numpy as np

from bayesdamp.inference.frame import cut_off, cut_off_moments

FAR = 8.0
"""A wall so many sds away cuts nothing off."""
RARE = 0.02
"""Share inside the walls below which rejection gives way to Gibbs sampling."""


class CutNormal:
    """N(mean, covariance), shapes (d,) and (d, d), where the folded scores, (d,) of bool, are not negative."""

    def __init__(self, mean: np.ndarray, covariance: np.ndarray, folded: np.ndarray) -> None:
        self.mean, self.covariance, self.folded = mean, 0.5 * (covariance + covariance.T), folded
        self._walls = np.flatnonzero(folded & (mean < FAR * np.sqrt(np.diag(covariance))))

    @cached_property
    def moments(self) -> tuple[np.ndarray, np.ndarray]:
        """Mean (d,) and the Cholesky factor of the covariance (d, d) of what is left."""
        none = np.zeros(self.mean.size)
        return cut_off_moments(np.linalg.inv(self.covariance), none, self.mean, self._walls)

    def draw(self, rng: np.random.Generator, n: int) -> np.ndarray:
        """Independent draws, shape (n, d)."""
        factor = np.linalg.cholesky(self.covariance)
        kept = np.empty((0, self.mean.size))
        while len(kept) < n:
            z = self.mean + rng.standard_normal((max(n, 1000), self.mean.size)) @ factor.T
            inside = np.all(z[:, self._walls] >= 0, axis=1)
            if np.mean(inside) < RARE:
                return self._by_gibbs(rng, n)
            kept = np.concatenate([kept, z[inside]])
        return kept[:n]

    def _by_gibbs(self, rng: np.random.Generator, n: int) -> np.ndarray:
        w, c = self._walls, self.covariance
        inner = c[np.ix_(w, w)]
        ends = rng.permutation(cut_off(self.mean[w], inner, chains=-(-n // 4), rng=rng))[:n]
        # The other scores follow those at the walls linearly.
        follow = c[:, w] @ np.linalg.inv(inner)
        rest = np.linalg.eigh(c - follow @ c[w])
        spread = rest.eigenvectors * np.sqrt(np.maximum(rest.eigenvalues, 0.0))
        z = self.mean + (ends - self.mean[w]) @ follow.T + rng.standard_normal((n, c.shape[0])) @ spread.T
        z[:, w] = ends
        return z

    def log_density(self, z: np.ndarray) -> np.ndarray:
        """Log density at scores z, (n, d), up to a constant; −∞ beyond a wall."""
        white = np.linalg.solve(np.linalg.cholesky(self.covariance), (z - self.mean).T)
        inside = np.all(z[:, self._walls] >= 0, axis=1)
        return np.where(inside, -0.5 * np.sum(white**2, axis=0), -np.inf)
