"""The linear Gaussian model of a record about a motion: evidence and posteriors over a grid of hyperparameters."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from bayesdamp.inference.deviation.hyperparameters import Grid
from bayesdamp.inference.deviation.orthant import log_probability


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
        return np.exp(self.log_each - self.log_evidence)


def condensed(columns: np.ndarray, r: np.ndarray, positive: np.ndarray) -> Linear:
    """The model from columns (n, K) and the record less the motion's constant part, r, (n,)."""
    whole = np.asarray(np.linalg.qr(np.column_stack([columns, r]), mode="r"))
    k = columns.shape[1]
    return Linear(whole[:k, :k], whole[:k, k], float(np.sum(whole[k:, k] ** 2)), r.size, positive)


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
    lower = np.linalg.cholesky(information)
    inverse = np.linalg.inv(lower)
    seen = target @ white
    half = (inverse @ seen[:, :, None])[:, :, 0]
    log_each = -0.5 * (target @ target + model.rest / variance - np.sum(half**2, axis=1))
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
