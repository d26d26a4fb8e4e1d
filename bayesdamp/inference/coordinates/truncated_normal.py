"""Normal distributions of standard normal scores, truncated at zero in some of the scores.

A reflected score is that of a parameter with a half-normal prior, which depends only on the score's absolute value; it
is restricted to values ≥ 0. The boundary, where such a score is 0, is called a wall.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cached_property

import numpy as np

from bayesdamp.inference.model.likelihood import Likelihood
from bayesdamp.numerics.orthant import draw

LEAST_INSIDE = 0.02
"""`TruncatedNormal.draw` draws from a normal distribution and rejects draws with negative values where these are not
allowed. If less than this fraction of the draws is accepted, it uses the approximate sampler of `numerics.orthant`
instead."""
MOMENT_DRAWS = 20_000
"""Number of draws from which the mean and covariance of a normal distribution with values restricted to ≥ 0 are
computed."""
FAR_WALL_SDS = 8.0
"""The restriction of a standard normal score to values ≥ 0 is ignored if its mean is at least this many sds above
zero."""


class TruncatedNormal:
    """A normal distribution of d scores, truncated at zero, whose log density has a given gradient at a point.

    Scores are parameters transformed to standard normal priors; reflected ones are those of half-normal priors.

    Parameters
    ----------
    at, gradient : ndarray, shape (d,)
        The point, and the gradient there. The mean before the truncation is at + covariance @ gradient.
    covariance : ndarray, shape (d, d)
        The covariance before the truncation.
    reflected : ndarray of bool, shape (d,)
        Which scores are restricted to values ≥ 0. The restriction of those whose mean is at least `FAR_WALL_SDS` sds
        above zero is ignored; `walls` has the indices of the others.
    """

    def __init__(
        self, at: np.ndarray, gradient: np.ndarray, covariance: np.ndarray, reflected: np.ndarray
    ) -> None:
        self.mean, self.covariance = at + covariance @ gradient, 0.5 * (covariance + covariance.T)
        self.walls = np.flatnonzero(reflected & (self.mean < FAR_WALL_SDS * np.sqrt(np.diag(covariance))))

    @cached_property
    def moments(self) -> tuple[np.ndarray, np.ndarray]:
        """Mean, (d,), and lower Cholesky factor of the covariance, (d, d), of the truncated distribution.

        The effect of the restriction is estimated from `MOMENT_DRAWS` draws with a fixed seed. Raises LinAlgError if a
        matrix is singular.
        """
        mean, covariance, walls = self.mean, self.covariance, self.walls
        if walls.size:
            inner = covariance[np.ix_(walls, walls)]
            rng = np.random.default_rng(0)  # a fixed seed: the moments only define coordinates
            inside = draw(rng, mean[walls], np.linalg.cholesky(inner), np.arange(walls.size), MOMENT_DRAWS)
            # Regression of all scores on the restricted ones.
            regression = covariance[:, walls] @ np.linalg.inv(inner)
            mean = mean + regression @ (inside.mean(axis=0) - mean[walls])
            change = np.cov(inside.T, ddof=1).reshape(inner.shape) - inner
            covariance = covariance + regression @ change @ regression.T
        return mean, np.linalg.cholesky(covariance)

    def draw(self, rng: np.random.Generator, n: int) -> np.ndarray:
        """Return n draws of the truncated distribution, (n, d).

        They are independent normal draws that meet the restriction. If a fraction of less than `LEAST_INSIDE` meets it,
        they are from `numerics.orthant.draw`, whose values can repeat.
        """
        factor = np.linalg.cholesky(self.covariance)
        draws = np.empty((0, self.mean.size))
        while len(draws) < n:
            z = self.mean + rng.standard_normal((max(n, 1000), self.mean.size)) @ factor.T
            inside = np.all(z[:, self.walls] >= 0, axis=1)
            if np.mean(inside) < LEAST_INSIDE:
                return draw(rng, self.mean, factor, self.walls, n)
            draws = np.concatenate([draws, z[inside]])
        return draws[:n]


def truncated_near(likelihood: Likelihood, z: np.ndarray, factor: np.ndarray) -> TruncatedNormal:
    """Return a truncated normal whose log density has the same gradient at z, (d,), as the log posterior.

    Its covariance before the truncation is factor @ factor.T. Reflected scores (those with half-normal priors) in z are
    first replaced by their absolute values, and the distribution is restricted to values ≥ 0 of these scores.
    """
    reflected = likelihood.target.reflected
    at = np.where(reflected, np.abs(z), z)
    return TruncatedNormal(at, likelihood.gradient(at)[1], factor @ factor.T, reflected)


def negative_hessian(
    gradient: Callable[[np.ndarray], np.ndarray], at: np.ndarray, factor: np.ndarray, step: float
) -> np.ndarray:
    """Return the negative Hessian of a function by coordinates u, (d, d), at the point `at`, (d,).

    It is computed by central differences of the gradient with respect to points x = at + factor @ u.

    Parameters
    ----------
    gradient : callable
        Function that returns the gradient, (d,), by x at a point x, (d,).
    at : ndarray, shape (d,)
        The point.
    factor : ndarray, shape (d, d)
        Derivatives of x by u.
    step : float
        Step of the differences, in u.
    """
    rows = [gradient(at - step * column) - gradient(at + step * column) for column in factor.T]
    hessian = np.stack(rows) @ factor / (2 * step)
    return 0.5 * (hessian + hessian.T)
