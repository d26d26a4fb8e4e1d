"""Normal distributions of standard normal scores, truncated at zero in some of the scores.

A reflected score is that of a parameter with a half-normal prior, which depends only on the score's absolute value; it
is restricted to values ≥ 0. The boundary, where such a score is 0, is called a wall.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cached_property

import numpy as np

from bayesdamp.inference.mode import Mode
from bayesdamp.inference.model.likelihood import Likelihood
from bayesdamp.inference.model.target import Target
from bayesdamp.numerics.orthant import draw
from bayesdamp.types import Refusal

GRADIENT_STEP = 0.01
"""Step of the finite differences of gradients that give the full Hessian of the log posterior in `laplace`, in
posterior sds."""
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
    """The distribution N(mean, covariance) of d scores, in which the reflected scores are restricted to values ≥ 0.

    Scores are parameters transformed to standard normal priors; reflected ones are those of half-normal priors. mean:
    (d,). covariance: (d, d). reflected: boolean mask of the restricted scores, (d,). walls: indices of those reflected
    scores whose mean is less than `FAR_WALL_SDS` sds above zero; the restriction of the others is ignored.
    """

    def __init__(self, mean: np.ndarray, covariance: np.ndarray, reflected: np.ndarray) -> None:
        self.mean, self.covariance, self.reflected = mean, 0.5 * (covariance + covariance.T), reflected
        self.walls = np.flatnonzero(reflected & (mean < FAR_WALL_SDS * np.sqrt(np.diag(covariance))))

    @classmethod
    def about(
        cls, at: np.ndarray, gradient: np.ndarray, covariance: np.ndarray, reflected: np.ndarray
    ) -> TruncatedNormal:
        """Return the truncated normal distribution whose log density has a given gradient at a point.

        at: the point, (d,). gradient: (d,). covariance: before the truncation, (d, d). reflected: mask of the
        coordinates that are restricted to values ≥ 0, (d,). The mean before the truncation is at + covariance @
        gradient.
        """
        return cls(at + covariance @ gradient, covariance, reflected)

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

    def log_density(self, z: np.ndarray) -> np.ndarray:
        """Return the log density (nats), up to a constant, at points z, (n, d): (n,).

        It is −∞ if a coordinate in `walls` is negative. The restriction of other coordinates is ignored.
        """
        white = np.linalg.solve(np.linalg.cholesky(self.covariance), (z - self.mean).T)
        inside = np.all(z[:, self.walls] >= 0, axis=1)
        return np.where(inside, -0.5 * np.sum(white**2, axis=0), -np.inf)


def truncated_near(likelihood: Likelihood, z: np.ndarray, factor: np.ndarray) -> TruncatedNormal:
    """Return a truncated normal whose log density has the same gradient at z, (d,), as the log posterior.

    Its covariance before the truncation is factor @ factor.T. Reflected scores (those with half-normal priors) in z are
    first replaced by their absolute values, and the distribution is restricted to values ≥ 0 of these scores.
    """
    reflected = likelihood.target.reflected
    at = np.where(reflected, np.abs(z), z)
    return TruncatedNormal.about(at, likelihood.gradient(at)[1], factor @ factor.T, reflected)


def laplace(target: Target, mode: Mode) -> TruncatedNormal:
    """Return Laplace's approximation at a mode: a truncated normal with the log posterior's gradient and full Hessian.

    The Hessian is computed by finite differences of gradients about the mode; reflected scores (of parameters with
    half-normal priors) that are nearer to zero than two steps are first moved to two steps from zero. For a mode with a
    reflected score at zero, the gradient is not zero and the mean of the normal distribution is negative. The unknown
    scale of the priors of coefficients is fixed at the value in `Mode.near`.

    Raises
    ------
    Refusal
        If the Hessian is not finite or not positive definite.
    """
    reflected, factor = target.reflected, mode.factor
    at = np.where(reflected, np.maximum(np.abs(mode.z), 2 * GRADIENT_STEP * mode.sd()), mode.z)

    def slope(z: np.ndarray) -> np.ndarray:
        return mode.near.gradient(z)[1]

    white = negative_hessian(slope, at, factor, GRADIENT_STEP)
    if not np.all(np.isfinite(white)) or np.linalg.eigvalsh(white)[0] <= 0:
        raise Refusal(
            "the posterior has no normal approximation: its Hessian at the mode is not positive definite"
        )
    return TruncatedNormal.about(at, slope(at), factor @ np.linalg.inv(white) @ factor.T, reflected)


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
