"""The linear Gaussian model of a record about a motion: evidence and posteriors over a grid of hyperparameters."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from bayesdamp.inference.deviation.gaussian.hyperparameters import Grid
from bayesdamp.inference.deviation.gaussian.orthant import log_probability

PRECISE = 1e11
"""Information, in priors' own, up to which Cholesky's factor of it and differences of squares keep five digits and
more: half of the digits of a number (measured)."""
SMALL = 12
"""Rows up to which a triangle is inverted as any matrix."""


@dataclass(frozen=True)
class Linear:
    """|y − f|² = |root u − target|² + rest, u = (scores (d,), g, h at the knots).

    count: samples that this stands for; positive: which scores must not be negative, (d,).
    """

    root: np.ndarray
    target: np.ndarray
    rest: float
    count: int
    positive: np.ndarray


@dataclass(frozen=True)
class Weighed:
    """The model at one noise over a grid of c combinations: log evidence of each and in all (nats), means (c, d + 2n)
    and factors F, (c, d + 2n, d + 2n), of the covariances F Fᵀ before they are cut off at zero."""

    log_each: np.ndarray
    log_evidence: float
    means: np.ndarray
    factors: np.ndarray

    @property
    def weights(self) -> np.ndarray:
        """Posterior probability of each combination of hyperparameters, (c,)."""
        return np.exp(self.log_each - self.log_evidence)


def condensed(columns: np.ndarray, r: np.ndarray, positive: np.ndarray) -> Linear:
    """The model from columns (n, K) and the record less the motion's constant part, r, (n,)."""
    whole = np.asarray(np.linalg.qr(np.column_stack([columns, r]), mode="r"))
    k = columns.shape[1]
    return Linear(whole[:k, :k], whole[:k, k], float(np.sum(whole[k:, k] ** 2)), r.size, positive)


def _orthogonal(white: np.ndarray, target: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Factors, projections and least squares of |white u − target|² + |u|², (c, K, K), (c, K), (c,), by QR: for records
    with hardly any noise, where the information matrix has lost its digits."""
    combos, _, k = white.shape
    aim = np.broadcast_to(target[:, None], (combos, target.size, 1))
    prior = np.broadcast_to(np.eye(k, k + 1), (combos, k, k + 1))
    stacked = np.concatenate([np.concatenate([white, aim], axis=2), prior], axis=1)
    upper = np.asarray(np.linalg.qr(stacked, mode="r"))
    upper = upper * np.where(np.diagonal(upper, axis1=1, axis2=2) < 0, -1.0, 1.0)[:, :, None]
    return np.swapaxes(upper[:, :k, :k], 1, 2), upper[:, :k, k], upper[:, k, k] ** 2


def _inverse(lower: np.ndarray) -> np.ndarray:
    """Inverses of lower triangles, (c, K, K), by halves: of two triangles and the square between them."""
    k = lower.shape[1]
    if k <= SMALL:
        return np.linalg.inv(lower)
    half = k // 2
    found = np.zeros_like(lower)
    first, last = _inverse(lower[:, :half, :half]), _inverse(lower[:, half:, half:])
    found[:, :half, :half], found[:, half:, half:] = first, last
    found[:, half:, :half] = -last @ (lower[:, half:, :half] @ first)
    return found


def weigh(model: Linear, grid: Grid, variance: float, samples: float) -> Weighed:
    """Evidence and posteriors under noise of this variance, its prior N(0, 1) of each score, the positive ones doubled.

    variance: in the record's unit squared. samples: how many independent ones the rest stands for; its own density is
    −samples/2 · log(2π variance) − rest / (2 variance), so that models with other variances can be compared.
    """
    d, total = model.positive.size, model.root.shape[1]
    combos = grid.log_prior.size
    roots = np.zeros((combos, total, total))
    roots[:, np.arange(d), np.arange(d)] = 1.0
    roots[:, d:, d:] = grid.factors
    sd = np.sqrt(variance)
    white = (model.root / sd) @ roots
    target = model.target / sd
    information = np.swapaxes(white, 1, 2) @ white
    information[:, np.arange(total), np.arange(total)] += 1.0
    if information.diagonal(axis1=1, axis2=2).max() < PRECISE:
        lower = np.linalg.cholesky(information)
        inverse = _inverse(lower)
        half = (inverse @ (target @ white)[:, :, None])[:, :, 0]
        left = target @ target - np.sum(half**2, axis=1)
    else:
        lower, half, left = _orthogonal(white, target)
        inverse = _inverse(lower)
    log_each = -0.5 * (left + model.rest / variance)
    log_each -= np.sum(np.log(np.diagonal(lower, axis1=1, axis2=2)), axis=1)
    log_each += grid.log_prior - 0.5 * samples * np.log(2 * np.pi * variance)
    factors = roots @ np.swapaxes(inverse, 1, 2)
    means = (factors @ half[:, :, None])[:, :, 0]
    places = np.flatnonzero(model.positive)
    if places.size:
        part = factors[:, places]
        covariance = part @ np.swapaxes(part, 1, 2)
        log_each += places.size * np.log(2.0) + log_probability(means[:, places], covariance)
    top = log_each.max()
    return Weighed(log_each, float(top + np.log(np.sum(np.exp(log_each - top)))), means, factors)
