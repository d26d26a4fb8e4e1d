"""The linear Gaussian model of a record about a motion: evidence and posteriors over a grid of hyperparameters."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.special import log_ndtr

from bayesdamp.inference.deviation.gaussian.hyperparameters import Grid
from bayesdamp.numerics.orthant import draw, log_probability
from bayesdamp.priors import SHARED_SIGMAS

PRECISE = 1e11
"""Information, in priors' own, up to which Cholesky's factor of it and differences of squares keep five digits and
more: half of the digits of a number (measured)."""
SMALL = 12
"""Rows up to which a triangle is inverted as any matrix."""
LEFT_OUT = 1e-5
"""Posterior probability of all combinations of hyperparameters together that are left out, the least probable ones."""


@dataclass(frozen=True)
class Linear:
    """|y − f|² = |root u − target|² + rest, u = (scores (d,), g, h at the knots).

    count: samples that this stands for; positive: which scores must not be negative, (d,); shared: which scores are
    coefficients whose half-normal priors share an unknown scale, (d,); damping: which scores are of the damping, (d,).
    """

    root: np.ndarray
    target: np.ndarray
    rest: float
    count: int
    positive: np.ndarray
    shared: np.ndarray
    damping: np.ndarray


@dataclass(frozen=True)
class DampingLikelihood:
    """The likelihood of a record as a function of the damping's scores x, (k,), all else integrated out.

    Under each combination of the deviations' hyperparameters it is the exponential of log + xᵀ slope − xᵀ information
    x / 2: arrays of shape (c,), (c, k) and (c, k, k). Nothing of the prior of x is in it.
    """

    log: np.ndarray
    slope: np.ndarray
    information: np.ndarray

    def mapped(self, offset: np.ndarray, matrix: np.ndarray) -> DampingLikelihood:
        """Return the likelihood as a function of y where x = offset + matrix y, (k,) and (k, k)."""
        pull = self.slope - self.information @ offset
        log = self.log + self.slope @ offset - 0.5 * np.einsum("i,cij,j->c", offset, self.information, offset)
        return DampingLikelihood(log, pull @ matrix, matrix.T @ self.information @ matrix)


@dataclass(frozen=True)
class Weighed:
    """The model at one noise over m combinations of hyperparameters and scales: log evidence of each and in all (nats).

    combos: of each, its place in the grid of the deviations' hyperparameters, (m,); normals: the posteriors under N(0,
    1) priors over this grid; scaled, scales: the same under other scales of the shared scores, and which scale each
    combination has, (m,); None where no scores share one.
    """

    log_each: np.ndarray
    log_evidence: float
    combos: np.ndarray
    normals: Normals
    scaled: _Scaled | None = None
    scales: np.ndarray | None = None
    damping: DampingLikelihood | None = None

    def posteriors(self, places: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return means (k, d + 2n) and factors F, (k, d + 2n, d + 2n), of the covariances F Fᵀ of combinations (k,),
        before they are cut off at zero."""
        combos = self.combos[places]
        if self.scaled is None or self.scales is None:
            return self.normals.means[combos], self.normals.factors[combos]
        return self.scaled.posteriors(combos, self.scales[places])

    @cached_property
    def _whole(self) -> tuple[np.ndarray, np.ndarray]:
        return self.posteriors(np.arange(self.combos.size))

    @property
    def means(self) -> np.ndarray:
        """Of every combination, (m, d + 2n)."""
        return self._whole[0]

    @property
    def factors(self) -> np.ndarray:
        """Of the covariance of every combination, (m, d + 2n, d + 2n)."""
        return self._whole[1]

    def only(self, which: np.ndarray) -> Weighed:
        """Return these of the combinations, (m,) of bool."""
        log = self.log_each[which]
        scales = None if self.scales is None else self.scales[which]
        return Weighed(
            log, float(np.logaddexp.reduce(log)), self.combos[which], self.normals, self.scaled, scales
        )

    @property
    def weights(self) -> np.ndarray:
        """Posterior probability of each combination of hyperparameters, (m,)."""
        return np.exp(self.log_each - self.log_evidence)

    def draws(
        self, positive: np.ndarray, count: int, rng: np.random.Generator
    ) -> tuple[np.ndarray, np.ndarray]:
        """Draw scores, g and h, (count, d + 2n), over all combinations; and the place of each one's, (count,)."""
        numbers = rng.multinomial(count, self.weights / self.weights.sum())
        taken = np.flatnonzero(numbers)
        u = draw(rng, *self.posteriors(taken), np.flatnonzero(positive), numbers[taken])
        return u, np.repeat(taken, numbers[taken])

    def probable(self, least: float) -> np.ndarray:
        """Places in the grid of the combinations whose posterior probability, over all scales, is above `least`."""
        total = np.bincount(self.combos, self.weights)
        return np.flatnonzero(total > least)


def condensed(
    columns: np.ndarray,
    r: np.ndarray,
    positive: np.ndarray,
    shared: np.ndarray | None = None,
    damping: np.ndarray | None = None,
) -> Linear:
    """The model from columns (n, K) and the record less the motion's constant part, r, (n,); no score shares a scale,
    and none is of the damping, where that is not given."""
    whole = np.asarray(np.linalg.qr(np.column_stack([columns, r]), mode="r"))
    k = columns.shape[1]
    none = np.zeros(positive.size, bool)
    return Linear(
        whole[:k, :k],
        whole[:k, k],
        float(np.sum(whole[k:, k] ** 2)),
        r.size,
        positive,
        none if shared is None else shared,
        none if damping is None else damping,
    )


def _orthogonal(white: np.ndarray, target: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Factors, projections and least squares of |white u − target|² + |u|², (c, K, K), (c, K), (c,), by QR: for records
    with hardly any noise, where the information matrix has lost its digits."""
    combos, rows, k = white.shape
    aim = np.broadcast_to(target[:, :, None], (combos, rows, 1))
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


@dataclass(frozen=True)
class Normals:
    """The model's normal posterior under each combination of a grid, each score having the prior N(0, 1) of either
    sign: log evidence (c,), means (c, K), and factors of the covariances, (c, K, K)."""

    log: np.ndarray
    means: np.ndarray
    factors: np.ndarray


def normals(model: Linear, grid: Grid, variance: float | np.ndarray, samples: float) -> Normals:
    """The posteriors over a grid. Arguments as of `weigh`; variance: also one for each combination, (c,)."""
    d, total = model.positive.size, model.root.shape[1]
    combos = grid.log_prior.size
    roots = np.zeros((combos, total, total))
    roots[:, np.arange(d), np.arange(d)] = 1.0
    roots[:, d:, d:] = grid.factors
    variance = np.broadcast_to(variance, combos)
    sd = np.sqrt(variance)[:, None]
    white = model.root @ roots / sd[:, :, None]
    target = model.target / sd
    information = np.swapaxes(white, 1, 2) @ white
    information[:, np.arange(total), np.arange(total)] += 1.0
    if information.diagonal(axis1=1, axis2=2).max() < PRECISE:
        lower = np.linalg.cholesky(information)
        inverse = _inverse(lower)
        half = (inverse @ (np.swapaxes(white, 1, 2) @ target[:, :, None]))[:, :, 0]
        left = np.sum(target**2, axis=1) - np.sum(half**2, axis=1)
    else:
        lower, half, left = _orthogonal(white, target)
        inverse = _inverse(lower)
    log = -0.5 * (left + model.rest / variance)
    log -= np.sum(np.log(np.diagonal(lower, axis1=1, axis2=2)), axis=1)
    log += grid.log_prior - 0.5 * samples * np.log(2 * np.pi * variance)
    factors = roots @ np.swapaxes(inverse, 1, 2)
    return Normals(log, (factors @ half[:, :, None])[:, :, 0], factors)


def weigh(model: Linear, grid: Grid, variance: float, samples: float) -> Weighed:
    """Evidence and posteriors under noise of this variance.

    The prior of each score is N(0, 1), that of the shared ones N(0, σ²) with the same σ for all, one of
    `SHARED_SIGMAS`; densities of positive scores are doubled.
    variance: in the record's unit squared. samples: how many independent ones the rest stands for; its own density is
    −samples/2 · log(2π variance) − rest / (2 variance), so that models with other variances can be compared.
    """
    found = normals(model, grid, variance, samples)
    places = np.flatnonzero(model.damping)
    damping = damping_likelihood(found, places, grid.log_prior) if places.size else None
    return with_priors(found, model.positive, model.shared, damping)


def with_priors(
    found: Normals, positive: np.ndarray, shared: np.ndarray, damping: DampingLikelihood | None = None
) -> Weighed:
    """Normal posteriors, found under N(0, 1) priors of either sign, under the priors themselves.

    positive: which scores must not be negative, (d,); shared: which have N(0, σ²) with the same unknown σ, (d,).
    """
    places = np.flatnonzero(positive)
    scaled, scales, combos, log_each = None, None, np.arange(found.log.size), found.log
    if shared.any():
        scaled = _Scaled.of(found, positive, shared)
        combos, scales = scaled.kept()
        log_each = scaled.log[combos, scales]
    if places.size:
        if scaled is None or scales is None:
            means, factors = found.means[:, places], found.factors[:, places]
        else:
            means, factors = scaled.posteriors(combos, scales, places)
        # The part of the doubled normals that is positive.
        inside = log_probability(means, factors @ np.swapaxes(factors, 1, 2))
        log_each = log_each + (means.shape[1] * np.log(2.0) + inside)
    evidence = float(np.logaddexp.reduce(log_each))
    return Weighed(log_each, evidence, combos, found, scaled, scales, damping)


@dataclass(frozen=True)
class _Scaled:
    """The posteriors when the shared scores have the prior N(0, σ²) in place of N(0, 1), for every σ.

    With u = mean + F x, x ~ N(0, I), the shared scores are m + S x. Another prior of these adds δ |m + S x|² / 2, δ =
    1/σ² − 1, to −log p, which changes x along the k directions of S = U D Wᵀ alone.

    inside: which of the shared scores must not be negative, (i,). log: evidence before anything is cut off at zero,
    (c, s). aim: Uᵀ m, (c, k); sizes: D, (c, k); left: U, (c, k, k);
    right: W, (c, K, k); extra: δ, (s,).
    """

    normals: Normals
    inside: np.ndarray
    log: np.ndarray
    aim: np.ndarray
    sizes: np.ndarray
    left: np.ndarray
    right: np.ndarray
    extra: np.ndarray

    @classmethod
    def of(cls, found: Normals, positive: np.ndarray, shared: np.ndarray) -> _Scaled:
        inside, shared = np.flatnonzero(positive[shared]), np.flatnonzero(shared)
        left, sizes, right = np.linalg.svd(found.factors[:, shared], full_matrices=False)
        aim = np.einsum("cij,ci->cj", left, found.means[:, shared])
        extra = 1.0 / SHARED_SIGMAS**2 - 1.0
        shrunk = 1.0 + extra[:, None] * sizes[:, None, :] ** 2
        log = found.log[:, None] - 0.5 * np.sum(np.log(shrunk), axis=2)
        log = log - 0.5 * extra * np.sum(aim[:, None, :] ** 2 / shrunk, axis=2)
        log = log - shared.size * np.log(SHARED_SIGMAS) - np.log(SHARED_SIGMAS.size)
        return cls(found, inside, log, aim, sizes, left, np.swapaxes(right, 1, 2), extra)

    def kept(self) -> tuple[np.ndarray, np.ndarray]:
        """The combinations and scales that count, (m,) each.

        Evidence is bounded from above by the probability that the least likely positive score is positive.
        """
        bound = self.log
        if self.inside.size:
            shrunk = 1.0 + self.extra[:, None] * self.sizes[:, None, :] ** 2
            left = self.left[:, self.inside]
            mean = np.einsum("cij,csj->csi", left, self.aim[:, None, :] / shrunk)
            variance = np.einsum("cij,csj->csi", left**2, self.sizes[:, None, :] ** 2 / shrunk)
            bound = bound + log_ndtr(mean / np.sqrt(variance)).min(axis=2)
        order = np.argsort(-bound, axis=None)
        weight = np.exp(bound.ravel()[order] - bound.max())
        total = np.cumsum(weight)
        count = int(np.searchsorted(total, (1 - LEFT_OUT) * total[-1])) + 1
        combos, scales = np.unravel_index(np.sort(order[:count]), bound.shape)
        return combos, scales

    def posteriors(
        self, combos: np.ndarray, scales: np.ndarray, rows: np.ndarray | slice = slice(None)
    ) -> tuple[np.ndarray, np.ndarray]:
        """Means (m, K) and factors of the covariances, (m, K, K). rows: of both, all by default."""
        sizes, right, extra = self.sizes[combos], self.right[combos], self.extra[scales][:, None]
        factors = self.normals.factors[:, rows][combos]
        shrunk = 1.0 + extra * sizes**2
        along = factors @ right
        move = extra * sizes / shrunk * self.aim[combos]
        means = self.normals.means[:, rows][combos] - (along @ move[:, :, None])[:, :, 0]
        factors = factors + (along * (1 / np.sqrt(shrunk) - 1)[:, None, :]) @ np.swapaxes(right, 1, 2)
        return means, factors


def damping_likelihood(found: Normals, places: np.ndarray, log_prior: np.ndarray) -> DampingLikelihood:
    """The likelihood of the damping's scores alone, which are at `places`; log_prior: of the combinations, (c,)."""
    part = found.factors[:, places]
    mean = found.means[:, places]
    left, sizes, _ = np.linalg.svd(part, full_matrices=False)
    # The posterior's information less the prior's, by the directions that it is diagonal in.
    gained = np.maximum(1.0 / sizes**2 - 1.0, 0.0)
    aim = np.einsum("cij,ci->cj", left, mean)
    information = np.einsum("cij,cj,ckj->cik", left, gained, left)
    slope = np.einsum("cij,cj->ci", left, aim / sizes**2)
    log = found.log - log_prior - np.sum(np.log(sizes), axis=1)
    log = log - 0.5 * np.sum((aim / sizes) ** 2, axis=1)
    return DampingLikelihood(log, slope, information)
