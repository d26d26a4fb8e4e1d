"""Coordinates of the scores without walls: where a reflected score must not be negative, theirs may have any value."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.special import log_ndtr, ndtri_exp

from bayesdamp.inference.coordinates.truncated_normal import TruncatedNormal


@dataclass(frozen=True)
class Mapped:
    """Scores of points v, with what a density needs that is moved from one to the other.

    Attributes
    ----------
    z : ndarray, shape (n, d)
        The scores.
    slopes : ndarray, shape (n, d, d)
        Their derivatives by v.
    log_volume : ndarray, shape (n,)
        Log determinant of these.
    volume_slopes : ndarray, shape (n, d)
        The derivative of that by v.
    """

    z: np.ndarray
    slopes: np.ndarray
    log_volume: np.ndarray
    volume_slopes: np.ndarray


@dataclass(frozen=True)
class Unbounded:
    """A triangular map from v in R^d to the scores (Genz, Journal of Computational and Graphical Statistics 1, 1992).

    Built from a cut-off normal: a standard normal v becomes that one, exactly where no more than one wall is near.

    order: the scores with those at walls first, (d,); mean, factor: of the normal in this order, (d,), (d, d); walls:
    how many there are.
    """

    order: np.ndarray
    mean: np.ndarray
    factor: np.ndarray
    walls: int

    @staticmethod
    def of(normal: TruncatedNormal) -> Unbounded:
        """Return the coordinates in which this normal is round."""
        rest = np.setdiff1d(np.arange(normal.mean.size), normal.walls)
        # The wall that cuts most comes first: what it leaves hardly meets the others.
        near = normal.walls[np.argsort((normal.mean / np.sqrt(np.diag(normal.covariance)))[normal.walls])]
        order = np.r_[near, rest].astype(int)
        factor = np.linalg.cholesky(normal.covariance[np.ix_(order, order)])
        return Unbounded(order, normal.mean[order], factor, normal.walls.size)

    def mapped(self, v: np.ndarray) -> Mapped:
        """Map points v, (n, d), to scores.

        At each wall in turn, v's normal quantile is taken in the part of the conditional normal that lies inside.
        """
        n, d = v.shape
        factor = self.factor
        x, by_v = v.copy(), np.tile(np.eye(d), (n, 1, 1))
        log_volume = np.full(n, np.sum(np.log(np.diag(factor))))
        volume_slopes = np.zeros((n, d))
        for j in range(self.walls):
            row = factor[j, :j] / factor[j, j]
            low = -self.mean[j] / factor[j, j] - x[:, :j] @ row
            by_low = -np.einsum("i,nik->nk", row, by_v[:, :j])
            tail = log_ndtr(-low) + log_ndtr(-v[:, j])
            x[:, j] = -ndtri_exp(tail)
            beyond, beside = _hazard(low)[:, None], _hazard(v[:, j])[:, None]
            by_tail = -beyond * by_low - beside * np.eye(d)[j]
            by_v[:, j] = -by_tail / _hazard(x[:, j])[:, None]
            log_volume += log_ndtr(-low) + 0.5 * (x[:, j] ** 2 - v[:, j] ** 2)
            volume_slopes += -beyond * by_low + x[:, j, None] * by_v[:, j] - v[:, j, None] * np.eye(d)[j]
        z, slopes = np.empty((n, d)), np.empty((n, d, d))
        z[:, self.order] = self.mean + x @ factor.T
        slopes[:, self.order] = factor @ by_v
        return Mapped(z, slopes, log_volume, volume_slopes)


def _hazard(x: np.ndarray) -> np.ndarray:
    """φ(x)/Φ(−x) of the standard normal distribution."""
    return np.exp(-0.5 * x**2 - 0.5 * np.log(2 * np.pi) - log_ndtr(-x))
