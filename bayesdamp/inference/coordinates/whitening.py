"""Coordinates in which a posterior is round, also one that ends at zero."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from bayesdamp.inference.coordinates.shear import Shear
from bayesdamp.inference.fit.mode import Mode
from bayesdamp.inference.model.target import Target
from bayesdamp.numerics.orthant import draw

H = 0.3
"""Whitened units over which second differences are taken: they reach 0.6 sds from the centre, and the mean of
a distribution that is cut off is an sd or more from the wall."""
FLATTEST = 0.1
"""Least curvature that is believed, in units of the Gauss–Newton one."""
DRAWS = 20_000
"""Of a normal distribution between walls, behind its moments."""
FAR = 8.0
"""A wall so many sds away cuts nothing off."""


@dataclass(frozen=True)
class Whitening:
    """Straightened scores (`shear`) are centre + factor @ u; u has mean about 0 and covariance about the identity.

    centre: (d,); factor: (d, d); lacking: what the curvature of the linearised trajectory lacks at the
    centre, (d, d); good: whether it could be measured.
    """

    centre: np.ndarray
    factor: np.ndarray
    lacking: np.ndarray
    good: bool
    shear: Shear

    def scores(self, u: np.ndarray) -> np.ndarray:
        """Scores at coordinates u, both (..., d)."""
        return self.shear.scores(self.centre + u @ self.factor.T)

    def whitened(self, z: np.ndarray) -> np.ndarray:
        """Coordinates of scores z, both (m, d)."""
        return np.linalg.solve(self.factor, (self.shear.straight(z) - self.centre).T).T


def whitening_of(target: Target, mode: Mode, shear: Shear | None = None) -> Whitening:
    """The frame of a posterior from its mode, and the gradient and the whole curvature beside it.

    shear: the shear of its ridge, where that is to be straightened; else that of its noise. Where laws may hold
    approximately the posterior is a mixture, wider than its mode: the frame is that of the linear model's draws.
    """
    d = mode.z.size
    shear = Shear.of_noise(target, mode) if shear is None else shear
    if mode.linear is not None:
        level = shear.straight(mode.linear.draws)
        factor = np.linalg.cholesky(np.atleast_2d(np.cov(level.T)))
        return Whitening(level.mean(axis=0), factor, np.zeros((d, d)), True, shear)
    reflected = np.flatnonzero(target.reflected)
    at = np.where(target.reflected, np.maximum(np.abs(mode.z), 1e-12), mode.z)

    def slope(at: np.ndarray) -> np.ndarray:
        return mode.near.gradient(shear.scores(at))[1] @ shear.slope(at)

    information = np.linalg.inv(mode.factor @ mode.factor.T)
    centre, factor = truncated_moments(information, slope(at), at, reflected)
    whole, linear = _curvatures(target, mode, centre, factor, shear)
    if not (np.all(np.isfinite(whole)) and np.all(np.isfinite(linear))):
        return Whitening(centre, factor, np.zeros((d, d)), False, shear)
    values, vectors = np.linalg.eigh(whole)
    inverse = np.linalg.inv(factor)
    believed = inverse.T @ (vectors * np.maximum(values, FLATTEST)) @ vectors.T @ inverse
    factor = truncated_moments(believed, slope(centre), centre, reflected)[1]
    return Whitening(centre, factor, inverse.T @ (whole - linear) @ inverse, True, shear)


def whitening_under(mode: Mode, combination: int, shear: Shear) -> Whitening:
    """The frame of a posterior given a combination of hyperparameters of its deviations: that of the normal
    distribution about the mode, cut off where a damping is zero."""
    reflected, d = mode.likelihood.target.reflected, mode.z.size
    at = np.where(reflected, np.maximum(np.abs(mode.z), 1e-12), mode.z)
    _, gradient, information = mode.near.under(combination).curvature(at)
    centre, factor = truncated_moments(information, gradient, at, np.flatnonzero(reflected))
    return Whitening(shear.straight(centre), factor, np.zeros((d, d)), True, shear)


def truncated_moments(
    information: np.ndarray, gradient: np.ndarray, at: np.ndarray, reflected: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Mean and covariance's factor of the normal distribution with this information and, at `at`, this
    gradient, cut off at zero in the reflected scores."""
    covariance = np.linalg.inv(information)
    covariance = 0.5 * (covariance + covariance.T)
    mean = at + covariance @ gradient
    reflected = reflected[mean[reflected] < FAR * np.sqrt(np.diag(covariance)[reflected])]
    if reflected.size:
        inner = covariance[np.ix_(reflected, reflected)]
        rng, places = np.random.default_rng(0), np.arange(reflected.size)  # it only shapes coordinates
        inside = draw(rng, mean[reflected], np.linalg.cholesky(inner), places, DRAWS)
        # The other scores follow the reflected ones linearly.
        follow = covariance[:, reflected] @ np.linalg.inv(inner)
        mean = mean + follow @ (inside.mean(axis=0) - mean[reflected])
        covariance = covariance + follow @ (np.cov(inside.T, ddof=1).reshape(inner.shape) - inner) @ follow.T
    return mean, np.linalg.cholesky(0.5 * (covariance + covariance.T))


def _curvatures(
    target: Target, mode: Mode, at: np.ndarray, factor: np.ndarray, shear: Shear
) -> tuple[np.ndarray, np.ndarray]:
    """Return −∂² of the log posterior and of that with the motion linearised, in units of factor, both (d, d).

    By second differences.
    """
    d = at.size
    pairs = [(i, j) for i in range(d) for j in range(i, d)]
    corners = np.array(
        [[a * np.eye(d)[i] + b * np.eye(d)[j] for a in (1, -1) for b in (1, -1)] for i, j in pairs]
    )
    away = H * corners.reshape(-1, d) @ factor.T
    near = mode.near
    line = near.line(shear.scores(at))

    def hessian(values: list[float]) -> np.ndarray:
        f = np.array(values).reshape(-1, 4)
        found = np.zeros((d, d))
        for (i, j), v in zip(pairs, -(f[:, 0] - f[:, 1] - f[:, 2] + f[:, 3]) / (4 * H * H), strict=True):
            found[i, j] = found[j, i] = v
        return found

    whole = hessian([near.log_posterior(z) for z in shear.scores(at + away)])
    straight = shear.noise.sheared(shear.level(at) + away)
    return whole, hessian([near.log_posterior_along(line, z) for z in straight])
