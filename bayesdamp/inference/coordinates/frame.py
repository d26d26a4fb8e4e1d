"""Coordinates in which a posterior is round, also one that ends at zero."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from jax import Array
from scipy.special import log_ndtr, ndtri_exp

from bayesdamp.inference.coordinates.bend import Bend
from bayesdamp.inference.fit.mode import Mode
from bayesdamp.inference.model.batches import in_batches
from bayesdamp.inference.model.compiled import compiled
from bayesdamp.inference.model.target import Target

H = 0.3
"""Whitened units over which second differences are taken: they reach 0.6 sds from the centre, and the mean of
a distribution that is cut off is an sd or more from the wall."""
FLATTEST = 0.1
"""Least curvature that is believed, in units of the Gauss–Newton one."""
FAR = 8.0
"""A wall so many sds away cuts nothing off."""


@dataclass(frozen=True)
class Frame:
    """Straightened scores (`bent`) are centre + factor @ u; u has mean about 0 and covariance about the identity.

    centre: (d,); factor: (d, d); lacking: what the curvature of the linearised trajectory lacks at the
    centre, (d, d); good: whether it could be measured.
    """

    centre: np.ndarray
    factor: np.ndarray
    lacking: np.ndarray
    good: bool
    bent: Bend

    def scores(self, u: np.ndarray) -> np.ndarray:
        """Scores at coordinates u, both (..., d)."""
        return self.bent.scores(self.centre + u @ self.factor.T)

    def whitened(self, z: np.ndarray) -> np.ndarray:
        """Coordinates of scores z, both (m, d)."""
        return np.linalg.solve(self.factor, (self.bent.straight(z) - self.centre).T).T


def frame(target: Target, mode: Mode, bent: Bend | None = None) -> Frame:
    """The frame of a posterior from its mode, and the gradient and the whole curvature beside it.

    bent: the bend of its ridge, where that is to be straightened; else that of its noise.
    """
    layout, d = target.layout, mode.z.size
    bent = Bend.of_noise(target, mode) if bent is None else bent
    folded = np.flatnonzero(layout.folded)
    at = np.where(layout.folded, np.maximum(np.abs(mode.z), 1e-12), mode.z)

    def slope(at: np.ndarray) -> np.ndarray:
        return np.asarray(compiled(layout).curvature(mode.context, bent.scores(at))[1]) @ bent.slope(at)

    centre, factor = cut_off_moments(mode.information, slope(at), at, folded)
    whole, linear = _curvatures(target, mode, centre, factor, bent)
    if not (np.all(np.isfinite(whole)) and np.all(np.isfinite(linear))):
        return Frame(centre, factor, np.zeros((d, d)), False, bent)
    values, vectors = np.linalg.eigh(whole)
    inverse = np.linalg.inv(factor)
    believed = inverse.T @ (vectors * np.maximum(values, FLATTEST)) @ vectors.T @ inverse
    factor = cut_off_moments(believed, slope(centre), centre, folded)[1]
    return Frame(centre, factor, inverse.T @ (whole - linear) @ inverse, True, bent)


def cut_off_moments(
    information: np.ndarray, gradient: np.ndarray, at: np.ndarray, folded: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Mean and covariance's factor of the normal distribution with this information and, at `at`, this
    gradient, cut off at zero in the folded scores."""
    covariance = np.linalg.inv(information)
    covariance = 0.5 * (covariance + covariance.T)
    mean = at + covariance @ gradient
    folded = folded[mean[folded] < FAR * np.sqrt(np.diag(covariance)[folded])]
    if folded.size:
        inner = covariance[np.ix_(folded, folded)]
        inside = cut_off(mean[folded], inner)
        # The other scores follow the folded ones linearly.
        follow = covariance[:, folded] @ np.linalg.inv(inner)
        mean = mean + follow @ (inside.mean(axis=0) - mean[folded])
        covariance = covariance + follow @ (np.cov(inside.T, ddof=1).reshape(inner.shape) - inner) @ follow.T
    return mean, np.linalg.cholesky(0.5 * (covariance + covariance.T))


def cut_off(
    mean: np.ndarray,
    covariance: np.ndarray,
    chains: int = 1000,
    sweeps: int = 120,
    rng: np.random.Generator | None = None,
) -> np.ndarray:
    """Draws of a normal distribution of mean (k,) and covariance (k, k) where all is ≥ 0, (4 chains, k).

    Gibbs sampling from many starts, along the principal axes: what is left may be a thin sheet between the walls, which
    no step along a single coordinate gets on in. By default with a seed of its own, where it only shapes coordinates.
    """
    rng = np.random.default_rng(0) if rng is None else rng
    values, axes = np.linalg.eigh(covariance)
    axes = axes * np.sqrt(np.maximum(values, 1e-15 * values[-1]))
    x = np.maximum(mean, np.sqrt(np.diag(covariance))) + np.zeros((chains, 1))
    kept = []
    for sweep in range(sweeps):
        for axis, scale in zip(axes.T, np.linalg.inv(axes)):
            at = (x - mean) @ scale  # sds from the mean along this axis
            with np.errstate(divide="ignore", invalid="ignore"):
                ends = at[:, None] - x / axis
            low = np.max(np.where(axis > 0, ends, -np.inf), axis=1)
            high = np.min(np.where(axis < 0, ends, np.inf), axis=1)
            x = np.maximum(x + (_between(low, high, rng.uniform(size=chains)) - at)[:, None] * axis, 0.0)
        if sweep >= sweeps // 2 and sweep % (sweeps // 8) == 0:
            kept.append(x.copy())
    return np.concatenate(kept)


def _between(low: np.ndarray, high: np.ndarray, share: np.ndarray) -> np.ndarray:
    """Where the standard normal distribution between low and high has this share below it, all of one shape."""
    flip = low > 0  # the tails' logarithms are exact on the left
    left, right = np.where(flip, -high, low), np.where(flip, -low, high)
    share = np.where(flip, 1.0 - share, share)
    with np.errstate(divide="ignore"):
        below = np.logaddexp(np.log(share) + log_ndtr(right), np.log1p(-share) + log_ndtr(left))
    found = np.clip(ndtri_exp(below), left, right)
    return np.where(flip, -found, found)


def _curvatures(
    target: Target, mode: Mode, at: np.ndarray, factor: np.ndarray, bent: Bend
) -> tuple[np.ndarray, np.ndarray]:
    """−∂² of the log posterior and of that with the trajectory linearised, in units of factor, both (d, d).

    By second differences, all in batches of one size.
    """
    layout, d = target.layout, at.size
    pairs = [(i, j) for i in range(d) for j in range(i, d)]
    corners = np.array(
        [[a * np.eye(d)[i] + b * np.eye(d)[j] for a in (1, -1) for b in (1, -1)] for i, j in pairs]
    )
    away = H * corners.reshape(-1, d) @ factor.T
    functions = compiled(layout)
    line = functions.tight(mode.context, bent.scores(at))

    def hessian(fun: Callable[[Array], Array], points: np.ndarray) -> np.ndarray:
        f = in_batches(fun, points).reshape(-1, 4)
        found = np.zeros((d, d))
        for (i, j), v in zip(pairs, -(f[:, 0] - f[:, 1] - f[:, 2] + f[:, 3]) / (4 * H * H), strict=True):
            found[i, j] = found[j, i] = v
        return found

    whole = hessian(lambda part: functions.batch(mode.context, part), bent.scores(at + away))
    straight = bent.lift.lifted(bent.level(at) + away)
    return whole, hessian(lambda part: functions.linearised_batch(mode.context, line, part), straight)
