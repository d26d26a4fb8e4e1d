"""The linear Gaussian model of a record about a motion, with deviations of the forces.

Evidence and posteriors over a grid of the deviations' hyperparameters, which are their sizes and correlation lengths.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache, partial
from itertools import product

import numpy as np
from scipy.special import log_ndtr

from bayesdamp.numerics.orthant import draw, log_probability
from bayesdamp.priors import SHARED_SIGMAS

PROBABILITY_EXACT = 0.8
"""Prior probability that a law holds exactly."""
MEAN_G, MEAN_H = 0.03, 0.01
"""Where it does not: means of the exponential priors of the relative deviations' sds, of damping and of frequency."""
SIZES_G = np.geomspace(0.002, 0.25, 9)
SIZES_H = np.geomspace(0.0003, 0.03, 6)
LENGTHS = (0.1, 0.3, 1.0)
"""Correlation lengths as shares of the record."""
WIDE_SIZES = (0.1, 0.3, 1.0, 3.0)
"""Sizes of a log deviation that may be anything: up to a factor of 20 either way."""
WIDE_LENGTHS = (0.1, 0.3, 1.0)
JITTER = 1e-6
LEAST_KNOTS, MOST_KNOTS = 4, 16
Size = tuple[float, float, float]
"""Size and correlation length of a deviation, and the log prior mass of both."""
NO_DEVIATION: Size = (0.0, 1.0, 0.0)
"""No deviation, for certain."""


@dataclass(frozen=True)
class Grid:
    """Combinations of hyperparameters.

    Attributes
    ----------
    size_g, size_h : ndarray, shape (c,)
        Sizes of both deviations.
    log_prior : ndarray, shape (c,)
        Log prior masses.
    scales : ndarray, shape (c, 2n)
        The sizes, of g and of h, by which the columns of a factor are multiplied.
    lengths : ndarray of int, shape (c,)
        Places of the factors.
    roots : ndarray, shape (p, 2n, 2n)
        Factors of the covariances of (g, h) for sizes of 1, one for each pair of correlation lengths.
    """

    size_g: np.ndarray
    size_h: np.ndarray
    log_prior: np.ndarray
    scales: np.ndarray
    lengths: np.ndarray
    roots: np.ndarray

    @property
    def factors(self) -> np.ndarray:
        """Factors of the covariances of (g, h), (c, 2n, 2n)."""
        return self.roots[self.lengths] * self.scales[:, None, :]

    def only(self, places: np.ndarray) -> Grid:
        """Return some of the combinations, by their places (k,)."""
        names = ("size_g", "size_h", "log_prior", "scales", "lengths")
        return replace(self, **{name: getattr(self, name)[places] for name in names})


def knots_of(duration: float, cycles: float) -> np.ndarray:
    """Return equidistant knots from 0 to the duration: one for every two cycles, 4 to 16 of them."""
    return np.linspace(0.0, duration, int(np.clip(round(cycles / 2) + 1, LEAST_KNOTS, MOST_KNOTS)))


@lru_cache(maxsize=32)
def grid_of(
    knots: int,
    exact: bool = False,
    coarse: bool = False,
    absorbed: tuple[bool, bool] = (False, False),
    phases: bool = True,
) -> Grid:
    """Return the grid for a number of knots.

    Parameters
    ----------
    knots : int
        Number of knots, n.
    exact : bool
        Only the combination in which both laws hold exactly.
    coarse : bool
        Every other size, and the shortest and the longest length.
    absorbed : tuple of bool
        Whether a parameter (a coefficient, the stiffness) already contains a constant deviation of the damping, and of
        the frequency. The deviation is then taken about its mean over the record: no record can separate the two, and
        both together would only stretch the posterior along a curve that its linear model leaves.
    phases : bool
        Whether the record has phases. Without them, the factors are those of g alone, (c, n, n).
    """
    step = 2 if coarse else 1
    of_g, of_h = [NO_DEVIATION], [NO_DEVIATION]
    if not exact:
        of_g = _with_none(SIZES_G[::step], MEAN_G, LENGTHS[::step])
        of_h = _with_none(SIZES_H[::step], MEAN_H, LENGTHS[::step])
    if phases:
        return _combine(knots, of_g, of_h, absorbed)
    grid = _combine(knots, of_g, [NO_DEVIATION], absorbed)
    return replace(grid, scales=grid.scales[:, :knots], roots=grid.roots[:, :knots, :knots])


@lru_cache(maxsize=8)
def wide_grid(knots: int) -> Grid:
    """Return the grid of a damping that follows no law: g of any size, all equally probable; h on the coarse grid."""
    mass = -float(np.log(len(WIDE_SIZES) * len(WIDE_LENGTHS)))
    of_g = [(size, length, mass) for size in WIDE_SIZES for length in WIDE_LENGTHS]
    return _combine(knots, of_g, _with_none(SIZES_H[::2], MEAN_H, LENGTHS[::2]))


def _with_none(sizes: np.ndarray, mean: float, lengths: tuple[float, ...]) -> list[Size]:
    """Return no deviation, and each size with an exponential's mass about it and equally probable lengths."""
    edges = np.concatenate([[0.0], np.sqrt(sizes[1:] * sizes[:-1]), [np.inf]])
    mass = np.diff(-np.exp(-edges / mean))
    share = (1 - PROBABILITY_EXACT) / len(lengths)
    deviating = [
        (float(size), length, float(np.log(share * m)))
        for size, m in zip(sizes, mass, strict=True)
        for length in lengths
    ]
    return [(0.0, 1.0, float(np.log(PROBABILITY_EXACT))), *deviating]


def _combine(
    knots: int, of_g: Sequence[Size], of_h: Sequence[Size], absorbed: tuple[bool, bool] = (False, False)
) -> Grid:
    """Combine sizes of g and of h."""
    weights = np.ones(knots)
    weights[:1] = weights[-1:] = 0.5
    # Minus the mean over the record of what is linear between knots.
    centre = np.eye(knots) - np.tile(weights / np.sum(weights), (knots, 1))
    about_g, about_h = (centre if yes else np.eye(knots) for yes in absorbed)
    pairs = list(product(of_g, of_h))
    lengths = {lengths: place for place, lengths in enumerate(dict.fromkeys((g[1], h[1]) for g, h in pairs))}
    roots = np.zeros((len(lengths), 2 * knots, 2 * knots))
    for (length_g, length_h), root in zip(lengths, roots, strict=True):
        root[:knots, :knots] = about_g @ smooth_root(knots, length_g)
        root[knots:, knots:] = about_h @ smooth_root(knots, length_h)
    size_g, size_h, log_prior = np.array([(g[0], h[0], g[2] + h[2]) for g, h in pairs]).T
    scales = np.repeat(np.column_stack([size_g, size_h]), knots, axis=1)
    places = np.array([lengths[g[1], h[1]] for g, h in pairs])
    return Grid(size_g, size_h, log_prior, scales, places, roots)


@lru_cache(maxsize=32)
def smooth_root(knots: int, length: float) -> np.ndarray:
    """Return the factor of the covariance of a deviation of size 1 at equidistant knots, (n, n)."""
    s = np.linspace(0.0, 1.0, knots)
    return np.linalg.cholesky(np.exp(-np.abs(s[:, None] - s) / length) + JITTER * np.eye(knots))


NO_DEVIATIONS = grid_of(0, exact=True)
"""No deviations."""


LARGEST_INFORMATION = 1e11
"""Largest information, relative to the prior's, for which its Cholesky factor and differences of squares keep at least
five digits, half of the digits of a number (measured)."""
SMALL = 12
"""Rows up to which a triangle is inverted like any other matrix."""
LEFT_OUT = 1e-3
"""Total posterior probability of the least probable combinations of hyperparameters, which are left out: evidence is
lower by a thousandth of a nat, the same for all candidates."""


@dataclass(frozen=True)
class LinearModel:
    """The sum of squares as a function of u = (scores (d,), log g, h at the knots): |root u − target|² + rest.

    Attributes
    ----------
    root : ndarray, shape (K, K)
        Upper triangle.
    target : ndarray, shape (K,)
        In the record's unit.
    rest : float
        Smallest sum of squares.
    count : int
        Number of samples.
    positive : ndarray of bool, shape (d,)
        Scores that must not be negative.
    shared : ndarray of bool, shape (d,)
        Scores of coefficients whose half-normal priors share an unknown scale.
    damping : ndarray of bool, shape (d,)
        Scores of the damping.
    """

    root: np.ndarray
    target: np.ndarray
    rest: float
    count: int
    positive: np.ndarray
    shared: np.ndarray
    damping: np.ndarray

    def only(self, scores: np.ndarray) -> LinearModel:
        """Return the model of some of the scores, (d,) of bool, with the others at 0."""
        columns = np.concatenate([scores, np.ones(self.root.shape[1] - scores.size, bool)])
        masks = (mask[scores] for mask in (self.positive, self.shared, self.damping))
        model = condense(self.root[:, columns], self.target, *masks)
        return replace(model, rest=self.rest + model.rest, count=self.count)


@dataclass(frozen=True)
class DampingLikelihood:
    """The likelihood of a record as a function of the damping's scores x, (k,), with everything else integrated out.

    Under each combination of the deviations' hyperparameters it is the exponential of log + xᵀ slope − xᵀ information
    x / 2: arrays of shape (c,), (c, k) and (c, k, k). It does not contain the prior of x.
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
class LinearPosterior:
    """The model at one noise over m combinations of hyperparameters and scales.

    Attributes
    ----------
    log_each : ndarray, shape (m,)
        Log evidence of each combination, in nats.
    log_evidence : float
        Log evidence of all, in nats.
    combos : ndarray of int, shape (m,)
        Place of each combination in the grid of the deviations' hyperparameters.
    scales : ndarray of int, shape (m,), optional
        Place of each combination's scale of the shared scores; None where no scores share one.
    positive, shared : ndarray of bool, shape (d,)
        Scores that must not be negative, and that share a scale.
    whole : callable
        Returns the posteriors under N(0, 1) priors under some places of the grid.
    damping : DampingLikelihood, optional
        The likelihood of the damping alone.
    """

    log_each: np.ndarray
    log_evidence: float
    combos: np.ndarray
    scales: np.ndarray | None
    positive: np.ndarray
    shared: np.ndarray
    whole: Callable[[np.ndarray], Normals]
    damping: DampingLikelihood | None = None

    def posteriors(self, places: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return means (k, K) and factors F, (k, K, K), of the covariances F Fᵀ at places (k,), not yet cut at zero."""
        combos, rows = np.unique(self.combos[places], return_inverse=True)
        normals = self.whole(combos)
        if self.scales is None:
            return normals.means[rows], normals.factors[rows]
        return _ScaledPriors.of(normals, self.positive, self.shared).posteriors(rows, self.scales[places])

    @cached_property
    def _every(self) -> tuple[np.ndarray, np.ndarray]:
        return self.posteriors(np.arange(self.combos.size))

    @property
    def means(self) -> np.ndarray:
        """Posterior mean under every combination, (m, K)."""
        return self._every[0]

    @property
    def factors(self) -> np.ndarray:
        """Factor of the covariance under every combination, (m, K, K)."""
        return self._every[1]

    def only(self, which: np.ndarray) -> LinearPosterior:
        """Return the result over some of the combinations, (m,) of bool, without the likelihood of the damping."""
        log = self.log_each[which]
        scales = None if self.scales is None else self.scales[which]
        total = float(np.logaddexp.reduce(log))
        return replace(
            self, log_each=log, log_evidence=total, combos=self.combos[which], scales=scales, damping=None
        )

    @property
    def weights(self) -> np.ndarray:
        """Posterior probability of each combination of hyperparameters, (m,)."""
        return np.exp(self.log_each - self.log_evidence)

    def draws(
        self, positive: np.ndarray, count: int, rng: np.random.Generator
    ) -> tuple[np.ndarray, np.ndarray]:
        """Draw scores, g and h, (count, K), over all combinations, and the place of each draw's, (count,)."""
        numbers = rng.multinomial(count, self.weights / self.weights.sum())
        places = np.flatnonzero(numbers)
        u = draw(rng, *self.posteriors(places), np.flatnonzero(positive), numbers[places])
        return u, np.repeat(places, numbers[places])


def condense(
    columns: np.ndarray,
    r: np.ndarray,
    positive: np.ndarray,
    shared: np.ndarray | None = None,
    damping: np.ndarray | None = None,
) -> LinearModel:
    """Condense a linear least-squares problem.

    Parameters
    ----------
    columns : ndarray, shape (n, K)
        Tangents of the motion.
    r : ndarray, shape (n,)
        Record minus the constant part of the motion.
    positive, shared, damping : ndarray of bool, shape (d,)
        As of `LinearModel`; by default no score shares a scale, and none belongs to the damping.
    """
    whole = np.asarray(np.linalg.qr(np.column_stack([columns, r]), mode="r"))
    k = columns.shape[1]
    none = np.zeros(positive.size, bool)
    shared, damping = (none if mask is None else mask for mask in (shared, damping))
    rest = float(np.sum(whole[k:, k] ** 2))
    return LinearModel(whole[:k, :k], whole[:k, k], rest, r.size, positive, shared, damping)


def _inverse(lower: np.ndarray) -> np.ndarray:
    """Invert lower triangles, (c, K, K), by halves: two triangles and the square between them."""
    k = lower.shape[1]
    if k <= SMALL:
        return np.linalg.inv(lower)
    half = k // 2
    inverse = np.zeros_like(lower)
    first, last = _inverse(lower[:, :half, :half]), _inverse(lower[:, half:, half:])
    inverse[:, :half, :half], inverse[:, half:, half:] = first, last
    inverse[:, half:, :half] = -last @ (lower[:, half:, :half] @ first)
    return inverse


@dataclass(frozen=True)
class Normals:
    """Normal posteriors under each of c combinations, with the prior N(0, 1) of either sign for each score.

    Log evidence (c,), means (c, K), and factors of the covariances, (c, K, K), of the scores, or of scores, g and h.
    """

    log: np.ndarray
    means: np.ndarray
    factors: np.ndarray

    def only(self, places: np.ndarray) -> Normals:
        """Return some of the combinations, by their places or as a mask."""
        return Normals(self.log[places], self.means[places], self.factors[places])


@dataclass(frozen=True)
class _Triangles:
    """Cholesky factors of a posterior's information under each combination of a grid.

    In coordinates w, in which the prior is N(0, I): lower (c, K, K), half = lower⁻¹ of the pull of the record, (c, K),
    and left, the least |residuals|² + |w|² in units of the noise, (c,).
    """

    lower: np.ndarray
    half: np.ndarray
    left: np.ndarray

    @classmethod
    def of(cls, model: LinearModel, grid: Grid, variance: np.ndarray, order: np.ndarray) -> _Triangles:
        """Factorise with the coordinates of (scores, g, h) in an order, (K,)."""
        d, total = model.positive.size, model.root.shape[1]
        sd = np.sqrt(variance)[:, None]
        roots = np.zeros((len(grid.roots), total, total))
        roots[:, np.arange(d), np.arange(d)] = 1.0
        roots[:, d:, d:] = grid.roots
        white = (model.root @ roots)[:, :, order]
        scales = np.concatenate([np.ones((grid.log_prior.size, d)), grid.scales], axis=1)[:, order] / sd
        products = np.swapaxes(white, 1, 2) @ white
        information = products[grid.lengths] * scales[:, :, None] * scales[:, None, :]
        information[:, np.arange(total), np.arange(total)] += 1.0
        squares = model.target @ model.target / variance
        if information.diagonal(axis1=1, axis2=2).max() < LARGEST_INFORMATION:
            lower = np.linalg.cholesky(information)
            half = (model.target @ white)[grid.lengths] * scales / sd
            for i in range(total):  # forward substitution
                half[:, i] -= np.einsum("ci,ci->c", lower[:, i, :i], half[:, :i])
                half[:, i] /= lower[:, i, i]
            return cls(lower, half, squares - np.sum(half**2, axis=1))
        # With hardly any noise, the information has lost its digits: |white w − target|² + |w|² by QR.
        c = variance.size
        aim = np.broadcast_to((model.target / sd)[:, :, None], (c, model.target.size, 1))
        prior = np.broadcast_to(np.eye(total, total + 1), (c, total, total + 1))
        stacked = np.concatenate([white[grid.lengths] * scales[:, None, :], aim], axis=2)
        upper = np.asarray(np.linalg.qr(np.concatenate([stacked, prior], axis=1), mode="r"))
        upper = upper * np.where(np.diagonal(upper, axis1=1, axis2=2) < 0, -1.0, 1.0)[:, :, None]
        return cls(
            np.swapaxes(upper[:, :total, :total], 1, 2), upper[:, :total, total], upper[:, total, total] ** 2
        )


def normals(
    model: LinearModel, grid: Grid, variance: float | np.ndarray, samples: float, scores_only: bool = False
) -> Normals:
    """Compute the posteriors over a grid.

    Parameters
    ----------
    model, grid, variance, samples
        As of `linear_posterior`; the variance may be one per combination, (c,).
    scores_only : bool
        Whether g and h are integrated out, which takes a third of the time.
    """
    d, total = model.positive.size, model.root.shape[1]
    variance = np.broadcast_to(variance, grid.log_prior.size)
    # The last coordinates of a Cholesky factor are the marginal distribution of these.
    order = np.roll(np.arange(total), -d if scores_only else 0)
    triangles = _Triangles.of(model, grid, variance, order)
    lower, half = triangles.lower, triangles.half
    log = -0.5 * (triangles.left + model.rest / variance)
    log -= np.sum(np.log(np.diagonal(lower, axis1=1, axis2=2)), axis=1)
    log += grid.log_prior - 0.5 * samples * np.log(2 * np.pi * variance)
    if scores_only:
        lower, half = lower[:, total - d :, total - d :], half[:, total - d :]
    factors = np.swapaxes(_inverse(lower), 1, 2).copy()
    if not scores_only:
        factors[:, d:] = grid.factors @ factors[:, d:]
    return Normals(log, (factors @ half[:, :, None])[:, :, 0], factors)


def linear_posterior(model: LinearModel, grid: Grid, variance: float, samples: float) -> LinearPosterior:
    """Compute evidence and posteriors under white noise.

    The prior of each score is N(0, 1), that of the shared ones N(0, σ²) with the same σ for all, one of
    `SHARED_SIGMAS`; densities of positive scores are doubled.

    Parameters
    ----------
    model : LinearModel
        The record about a motion.
    grid : Grid
        Hyperparameters of the deviations.
    variance : float
        Of the noise, in the record's unit squared.
    samples : float
        Number of independent samples that the record stands for. The density of what the model leaves is −samples/2 ·
        log(2π variance) − rest / (2 variance), so that models with other variances can be compared.
    """
    posteriors = normals(model, grid, variance, samples, scores_only=True)
    posterior = with_priors(posteriors, model.positive, model.shared)
    posterior = replace(posterior, whole=partial(_whole, model, grid, variance, samples))
    places = np.flatnonzero(model.damping)
    if not places.size:
        return posterior
    return replace(posterior, damping=damping_likelihood(posteriors, places, grid.log_prior))


def _whole(model: LinearModel, grid: Grid, variance: float, samples: float, combos: np.ndarray) -> Normals:
    """Return the posteriors of scores, g and h under some combinations, by their places (k,)."""
    return normals(model, grid.only(combos), variance, samples)


def with_priors(posteriors: Normals, positive: np.ndarray, shared: np.ndarray) -> LinearPosterior:
    """Turn posteriors under N(0, 1) priors of either sign into those under the priors themselves.

    Parameters
    ----------
    posteriors : Normals
        Posteriors under N(0, 1) priors.
    positive : ndarray of bool, shape (d,)
        Scores that must not be negative.
    shared : ndarray of bool, shape (d,)
        Scores with the prior N(0, σ²) and the same unknown σ.
    """
    places = np.flatnonzero(positive)
    scaled, scales, combos, log_each = None, None, np.arange(posteriors.log.size), posteriors.log
    if shared.any():
        scaled = _ScaledPriors.of(posteriors, positive, shared)
        combos, scales = scaled.probable()
        log_each = scaled.log[combos, scales]
    if places.size:
        if scaled is None or scales is None:
            means, factors = posteriors.means[:, places], posteriors.factors[:, places]
        else:
            means, factors = scaled.posteriors(combos, scales, places)
        # The share of the doubled normals that is positive.
        inside = log_probability(means, factors @ np.swapaxes(factors, 1, 2))
        log_each = log_each + (means.shape[1] * np.log(2.0) + inside)
    evidence = float(np.logaddexp.reduce(log_each))
    return LinearPosterior(log_each, evidence, combos, scales, positive, shared, posteriors.only)


@dataclass(frozen=True)
class _ScaledPriors:
    """The posteriors when the shared scores have the prior N(0, σ²) instead of N(0, 1), for every σ.

    With u = mean + F x, x ~ N(0, I), the shared scores are m + S x. Another prior of these adds δ |m + S x|² / 2, δ =
    1/σ² − 1, to −log p, which changes x only along the k directions of S = U D Wᵀ.

    inside: places among the shared scores of those that must not be negative, (i,). log: evidence before anything is
    cut off at zero, (c, s). aim: Uᵀ m, (c, k); sizes: D, (c, k); left: U, (c, k, k); right: W, (c, K, k); extra: δ,
    (s,).
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
    def of(cls, posteriors: Normals, positive: np.ndarray, shared: np.ndarray) -> _ScaledPriors:
        inside, shared = np.flatnonzero(positive[shared]), np.flatnonzero(shared)
        left, sizes, right = np.linalg.svd(posteriors.factors[:, shared], full_matrices=False)
        aim = np.einsum("cij,ci->cj", left, posteriors.means[:, shared])
        extra = 1.0 / SHARED_SIGMAS**2 - 1.0
        shrunk = 1.0 + extra[:, None] * sizes[:, None, :] ** 2
        log = posteriors.log[:, None] - 0.5 * np.sum(np.log(shrunk), axis=2)
        log = log - 0.5 * extra * np.sum(aim[:, None, :] ** 2 / shrunk, axis=2)
        log = log - shared.size * np.log(SHARED_SIGMAS) - np.log(SHARED_SIGMAS.size)
        return cls(posteriors, inside, log, aim, sizes, left, np.swapaxes(right, 1, 2), extra)

    def probable(self) -> tuple[np.ndarray, np.ndarray]:
        """Return the combinations and scales that count, (m,) each.

        The probability that the least likely positive score is positive gives an upper bound of the evidence.
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
        """Return means (m, K) and factors of the covariances, (m, K, K), or some of the rows of both."""
        sizes, right, extra = self.sizes[combos], self.right[combos], self.extra[scales][:, None]
        factors = self.normals.factors[:, rows][combos]
        shrunk = 1.0 + extra * sizes**2
        along = factors @ right
        move = extra * sizes / shrunk * self.aim[combos]
        means = self.normals.means[:, rows][combos] - (along @ move[:, :, None])[:, :, 0]
        factors = factors + (along * (1 / np.sqrt(shrunk) - 1)[:, None, :]) @ np.swapaxes(right, 1, 2)
        return means, factors


def damping_likelihood(posteriors: Normals, places: np.ndarray, log_prior: np.ndarray) -> DampingLikelihood:
    """Compute the likelihood of the damping's scores alone.

    Parameters
    ----------
    posteriors : Normals
        Posteriors under N(0, 1) priors.
    places : ndarray of int, shape (k,)
        Of the damping's scores.
    log_prior : ndarray, shape (c,)
        Of the combinations of hyperparameters.
    """
    left, sizes, _ = np.linalg.svd(posteriors.factors[:, places], full_matrices=False)
    # The posterior's information minus the prior's, along the directions in which it is diagonal.
    gained = np.maximum(1.0 / sizes**2 - 1.0, 0.0)
    aim = np.einsum("cij,ci->cj", left, posteriors.means[:, places])
    information = np.einsum("cij,cj,ckj->cik", left, gained, left)
    slope = np.einsum("cij,cj->ci", left, aim / sizes**2)
    log = posteriors.log - log_prior - np.sum(np.log(sizes), axis=1)
    log = log - 0.5 * np.sum((aim / sizes) ** 2, axis=1)
    return DampingLikelihood(log, slope, information)
