"""Coordinates of the scores without walls: where a folded score must not be negative, theirs may have any value."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jax import Array
from jax import numpy as jnp
from jax.scipy.special import log_ndtr, ndtri

from bayesdamp.inference.coordinates.cut_normal import CutNormal

FAINTEST = -500.0
"""Logarithm of a probability below which the quantile is taken from the normal's asymptotic tail."""


def _beyond(log_tail: Array) -> Array:
    """x with log P(X > x) = log_tail for a standard normal X; finite, with a derivative, however faint."""
    faint = log_tail < FAINTEST
    x = jnp.sqrt(-2.0 * jnp.where(faint, log_tail, FAINTEST))
    for _ in range(3):
        x = x + (log_ndtr(-x) - jnp.where(faint, log_tail, FAINTEST)) / x
    return jnp.where(faint, x, -ndtri(jnp.exp(jnp.where(faint, FAINTEST, log_tail))))


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
    def of(normal: CutNormal) -> Unbounded:
        """The coordinates in which this normal is round."""
        rest = np.setdiff1d(np.arange(normal.mean.size), normal.walls)
        # The wall that cuts most comes first: what it leaves hardly meets the others.
        near = normal.walls[np.argsort((normal.mean / np.sqrt(np.diag(normal.covariance)))[normal.walls])]
        order = np.r_[near, rest].astype(int)
        factor = np.linalg.cholesky(normal.covariance[np.ix_(order, order)])
        return Unbounded(order, normal.mean[order], factor, normal.walls.size)


def scores(v: Array, mean: Array, factor: Array, walls: int) -> tuple[Array, Array]:
    """Scores in the order of the coordinates, (d,), and the log determinant of the map's derivative, shape ().

    At each wall in turn, v's normal quantile is taken in the part of the conditional normal that lies inside.
    """
    white, log_slope = [], jnp.sum(jnp.log(jnp.diag(factor)))
    for j in range(walls):
        low = -(mean[j] + sum((factor[j, i] * white[i] for i in range(j)), jnp.asarray(0.0))) / factor[j, j]
        tail = log_ndtr(-low) + log_ndtr(-v[j])
        x = _beyond(tail)
        white.append(x)
        log_slope = log_slope + log_ndtr(-low) + 0.5 * (x**2 - v[j] ** 2)
    whole = jnp.concatenate([jnp.stack(white), v[walls:]]) if walls else v
    return mean + factor @ whole, log_slope
