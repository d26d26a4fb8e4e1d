"""Posterior and evidence of a linear Gaussian model, over a grid of the hyperparameters of its deviations.

The unknowns are the scores of the parameters, and the deviations from the laws: g (log damping) and h (relative
frequency) at knots in time. The hyperparameters are the prior sds (sizes) and the correlation lengths of g and h.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache, partial

import numpy as np
import scipy  # loads its modules when they are used

from bayesdamp.numerics.orthant import draw, log_probability
from bayesdamp.priors import SHARED_SIGMAS

PROBABILITY_EXACT = 0.8
"""Prior probability that a law holds exactly, separately for the damping and for the restoring force. Otherwise the
damping (the frequency) deviates from its law during the record."""
MEAN_G, MEAN_H = 0.03, 0.01
"""Means of the exponential priors of the sizes (prior standard deviations) of g and h, where the law is not exact. g is
the log deviation of the damping, h the relative deviation of the frequency."""
SIZES_G = np.geomspace(0.002, 0.25, 9)
SIZES_H = np.geomspace(0.0003, 0.03, 6)
"""`SIZES_G` and `SIZES_H`: grid values of the sizes (prior standard deviations, dimensionless) of the deviations from
the laws, g (log damping) and h (relative frequency)."""
LENGTHS = (0.1, 0.3, 1.0)
"""Grid values of the correlation lengths of the deviations from the laws, g (log damping) and h (relative frequency),
as fractions of the record's duration."""
JITTER = 1e-6
"""Variance that is added to the diagonal of the prior covariance of a deviation, whose variance is 1, so that it has a
Cholesky factor (conventional)."""
LEAST_KNOTS, MOST_KNOTS = 4, 16
"""Smallest and largest number of knots in time between which the deviation of the damping, or of the frequency, from
its law is interpolated."""


@dataclass(frozen=True)
class Grid:
    """Grid points: combinations of the hyperparameters of g and h, with their prior probabilities.

    g and h, at n knots in time each, are the deviations of the damping (log) and of the frequency (relative) from their
    laws. Their hyperparameters are sizes (prior standard deviations) and correlation lengths. For a record without
    phases (`grid_of`), h has no knots.

    Attributes
    ----------
    size_g, size_h : ndarray, shape (c,)
        Sizes (prior standard deviations, dimensionless) of g and h at each grid point.
    length_g, length_h : ndarray of int, shape (c,)
        Index of each grid point's correlation length in `roots_g` and in `roots_h`.
    log_prior : ndarray, shape (c,)
        Log prior probability of each grid point.
    roots_g, roots_h : ndarray, shape (l, n, n)
        Matrices R where R Rᵀ is the covariance of g (of h) for a size of 1, one for each correlation length.
    """

    size_g: np.ndarray
    size_h: np.ndarray
    length_g: np.ndarray
    length_h: np.ndarray
    log_prior: np.ndarray
    roots_g: np.ndarray
    roots_h: np.ndarray

    @property
    def factors(self) -> np.ndarray:
        """Return matrices F, (c, 2n, 2n), where F Fᵀ is the prior covariance of (g, h) at each of c grid points.

        A grid point is a combination of sizes (prior sds) and correlation lengths. g is the deviation of the log
        damping, h the relative one of the frequency, at n knots in time each.
        """
        n, total = self.roots_g.shape[1], self.roots_g.shape[1] + self.roots_h.shape[1]
        factors = np.zeros((self.log_prior.size, total, total))
        factors[:, :n, :n] = self.roots_g[self.length_g] * self.size_g[:, None, None]
        factors[:, n:, n:] = self.roots_h[self.length_h] * self.size_h[:, None, None]
        return factors

    @cached_property
    def of_h(self) -> tuple[np.ndarray, np.ndarray]:
        """Return the k different factors F of the prior covariances F Fᵀ of h, (k, n, n), and each point's index, (c,).

        h is the relative deviation of the frequency at n knots in time.
        """
        both = np.column_stack([self.size_h, self.length_h])
        _, first, places = np.unique(both, axis=0, return_index=True, return_inverse=True)
        return self.roots_h[self.length_h[first]] * self.size_h[first, None, None], places.ravel()

    def only(self, places: np.ndarray) -> Grid:
        """Return the grid with only the points at the indices `places`, (k,)."""
        names = ("size_g", "size_h", "length_g", "length_h", "log_prior")
        return replace(self, **{name: getattr(self, name)[places] for name in names})


def knots_of(duration: float, cycles: float) -> np.ndarray:
    """Return equidistant times, in s from 0 to `duration`, between which a deviation from a law is interpolated.

    There is one knot for every two cycles and one more, but at least 4 and at most 16. cycles: number of cycles in the
    record.
    """
    return np.linspace(0.0, duration, int(np.clip(round(cycles / 2) + 1, LEAST_KNOTS, MOST_KNOTS)))


@lru_cache(maxsize=32)
def grid_of(
    knots: int,
    exact: bool = False,
    coarse: bool = False,
    absorbed: tuple[bool, bool] = (False, False),
    phases: bool = True,
) -> Grid:
    """Return the grid of sizes and correlation lengths of the deviations g (log damping) and h (relative frequency).

    Parameters
    ----------
    knots : int
        Number of knots of each deviation, n.
    exact : bool
        Whether the grid has only the point g = h = 0.
    coarse : bool
        Whether the grid has only every other size, and only the shortest and the longest length.
    absorbed : tuple of bool
        Whether a parameter (a coefficient, the stiffness) has the same effect as a constant g, and as a constant h. The
        deviation then has zero mean over the record. Otherwise the posterior would lie along a curve (coefficient times
        exp g is constant), which a linear model does not follow.
    phases : bool
        Whether the record has phases. Without them h has no effect, and the grid is for g alone.
    """
    step = 2 if coarse else 1
    of_g = _with_none(SIZES_G[::step], MEAN_G, step) if not exact else np.zeros((3, 1))
    of_h = _with_none(SIZES_H[::step], MEAN_H, step) if not exact and phases else np.zeros((3, 1))
    size_g, length_g, log_g = np.repeat(of_g, of_h.shape[1], axis=1)
    size_h, length_h, log_h = np.tile(of_h, of_g.shape[1])
    root_g, root_h = _roots(knots, absorbed[0]), _roots(knots if phases else 0, absorbed[1])
    return Grid(size_g, size_h, length_g.astype(int), length_h.astype(int), log_g + log_h, root_g, root_h)


def _with_none(sizes: np.ndarray, mean: float, step: int) -> np.ndarray:
    """Return the grid of one deviation: n sizes, indices of their lengths, and log prior probabilities, (3, n).

    The first grid point is "no deviation", with probability `PROBABILITY_EXACT`. At the others, the size has an
    exponential prior with the given mean, and every `step`-th of `LENGTHS` is equally probable.
    """
    edges = np.concatenate([[0.0], np.sqrt(sizes[1:] * sizes[:-1]), [np.inf]])
    lengths = np.arange(len(LENGTHS))[::step]
    mass = np.diff(-np.exp(-edges / mean)) * (1 - PROBABILITY_EXACT) / lengths.size
    deviating = [
        np.repeat(sizes, lengths.size), np.tile(lengths, sizes.size), np.log(np.repeat(mass, lengths.size))
    ]  # fmt: skip
    return np.column_stack([[0.0, 0.0, np.log(PROBABILITY_EXACT)], deviating])


def _roots(knots: int, centred: bool) -> np.ndarray:
    """Return a factor F of the prior covariance F Fᵀ of a deviation of size 1, for each of `LENGTHS`: (l, n, n).

    centred: whether the deviation has zero mean over the record.
    """
    roots = np.array([smooth_root(knots, length) for length in LENGTHS])
    if not centred:
        return roots
    weights = np.ones(knots)
    weights[:1] = weights[-1:] = 0.5
    # Subtract the mean over the record of a function that is linear between knots (trapezoidal rule).
    return roots - (weights / np.sum(weights) @ roots)[:, None, :]


@lru_cache(maxsize=32)
def smooth_root(knots: int, length: float) -> np.ndarray:
    """Return the Cholesky factor, (n, n), of the covariance exp(−|Δs| / length) at n equidistant knots in 0 ≤ s ≤ 1.

    s is the time as a fraction of the record, and length the correlation length in this unit. A variance of `JITTER` is
    added to the diagonal.
    """
    s = np.linspace(0.0, 1.0, knots)
    return np.linalg.cholesky(np.exp(-np.abs(s[:, None] - s) / length) + JITTER * np.eye(knots))


NO_DEVIATIONS = grid_of(0, exact=True)
"""The grid of exact laws: its one grid point has no deviations of damping (g) and frequency (h), which have no knots in
time."""


LARGEST_INFORMATION = 1e11
"""Largest information about a deviation at a knot, relative to the prior's, up to which Cholesky factors and
differences of squares keep at least five digits (measured)."""
NEGLIGIBLE = 30.0
"""The evidence is a sum over grid points (sizes and correlation lengths of the deviations) and values of the
coefficients' common prior scale. A combination is left out if its log evidence is this many nats below an estimate of
the best."""
LEFT_OUT = 1e-3
"""Total posterior probability of the least probable combinations of grid point (sizes and correlation lengths of the
deviations) and common prior scale that are left out. This lowers every log evidence by a thousandth of a nat."""


@dataclass(frozen=True)
class LinearModel:
    """The sum of squared residuals of a linearised candidate as a quadratic form: |root u − target|² + rest.

    u contains the d standard normal scores of the parameters, then the deviations from the laws, g (log damping) and h
    (relative frequency), at knots in time.

    Attributes
    ----------
    root : ndarray, shape (K, K)
        Upper triangular matrix.
    target : ndarray, shape (K,)
        Right-hand side, in the record's unit.
    rest : float
        Smallest sum of squares, in the record's unit squared, at root u = target.
    count : int
        Number of values of the record, n.
    positive : ndarray of bool, shape (d,)
        Which scores must not be negative.
    shared : ndarray of bool, shape (d,)
        Which scores are of coefficients whose half-normal priors have a common, unknown scale.
    damping : ndarray of bool, shape (d,)
        Which scores are of parameters of damping terms.
    """

    root: np.ndarray
    target: np.ndarray
    rest: float
    count: int
    positive: np.ndarray
    shared: np.ndarray
    damping: np.ndarray

    def squares(self, u: np.ndarray) -> np.ndarray:
        """Return the sum of squared residuals, (n,), in the record's unit squared, at n points u, (n, K)."""
        return np.sum((u @ self.root.T - self.target) ** 2, axis=1) + self.rest

    def transform(self, u: np.ndarray, matrix: np.ndarray) -> LinearModel:
        """Return the model as a function of new coordinates w, (K,), where the old ones are u + matrix (w − u).

        u: fixed point, (K,). matrix: (K, K).
        """
        target = self.target - self.root @ (u - matrix @ u)
        model = condense(self.root @ matrix, target, self.positive, self.shared, self.damping)
        return replace(model, rest=self.rest + model.rest, count=self.count)


@dataclass(frozen=True)
class DampingLikelihood:
    """The likelihood of the damping's parameters, with all other unknowns integrated out.

    The parameters are expressed as k scores x, which have standard normal priors. The logarithm of the likelihood (in
    nats) at each of c grid points (sizes and correlation lengths of the deviations from the laws) is log + slopeᵀ x −
    xᵀ information x / 2, with arrays of shape (c,), (c, k) and (c, k, k). It does not contain the prior of x.
    """

    log: np.ndarray
    slope: np.ndarray
    information: np.ndarray

    def transform(self, offset: np.ndarray, matrix: np.ndarray) -> DampingLikelihood:
        """Return the likelihood as a function of y, where x = offset + matrix y are the present parameters.

        offset: (k,). matrix: (k, k).
        """
        pull = self.slope - self.information @ offset
        log = self.log + self.slope @ offset - 0.5 * np.einsum("i,cij,j->c", offset, self.information, offset)
        return DampingLikelihood(log, pull @ matrix, matrix.T @ self.information @ matrix)


@dataclass(frozen=True)
class LinearPosterior:
    """The posterior of a linear model: a mixture of m normal distributions, cut off where coefficients are negative.

    Each component has one grid point (sizes and correlation lengths of the deviations from the laws) and one value of
    the common prior scale of coefficients. The d + 2n unknowns are the parameters as standard normal scores and the
    deviations at n knots in time.

    Attributes
    ----------
    log_each : ndarray, shape (m,)
        Log evidence of each component times its prior probability, in nats.
    log_evidence : float
        Log evidence of the model, in nats.
    combos : ndarray of int, shape (m,)
        Index of each component's grid point.
    scales : ndarray of int, shape (m,), optional
        Index of each component's common prior scale in `SHARED_SIGMAS`; None where no scores have a common scale.
    positive, shared : ndarray of bool, shape (d,)
        Which scores must not be negative, and which have priors with the common scale.
    whole : callable
        Function that maps indices of grid points to the `Normals` there, under priors N(0, 1) and without the cut-off.
    damping_likelihood : callable, optional
        Function without arguments that returns the likelihood of the damping's scores at each grid point of the
        hyperparameters; None if there are none.
    """

    log_each: np.ndarray
    log_evidence: float
    combos: np.ndarray
    scales: np.ndarray | None
    positive: np.ndarray
    shared: np.ndarray
    whole: Callable[[np.ndarray], Normals]
    damping_likelihood: Callable[[], DampingLikelihood] | None = None

    def posteriors(self, places: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return means (k, K) and covariance factors (k, K, K) of k components before the cut-off at zero.

        Scores of coefficients are cut off where they would be negative. The covariance of a factor F is F Fᵀ. places:
        indices of the components, (k,).
        """
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
        """Return the mean of every component of the mixture, (m, K), before the cut-off of coefficients at zero."""
        return self._every[0]

    @property
    def factors(self) -> np.ndarray:
        """Return a factor F of the covariance F Fᵀ of every component of the mixture, (m, K, K).

        The covariances are those before the cut-off of coefficients at zero.
        """
        return self._every[1]

    def only(self, which: np.ndarray) -> LinearPosterior:
        """Return the posterior with only the components marked in `which`, booleans (m,).

        Its log evidence is the log of the sum of their evidences, and its `damping_likelihood` is None.
        """
        log = self.log_each[which]
        scales = None if self.scales is None else self.scales[which]
        total = float(np.logaddexp.reduce(log))
        return replace(
            self,
            log_each=log,
            log_evidence=total,
            combos=self.combos[which],
            scales=scales,
            damping_likelihood=None,
        )

    @property
    def weights(self) -> np.ndarray:
        """Return the posterior probability of each component of the mixture, (m,); their sum is 1."""
        return np.exp(self.log_each - self.log_evidence)

    def sds(self, combinations: np.ndarray) -> np.ndarray:
        """Return the sd of each of n linear combinations of the unknowns u within the mixture's components, (n,).

        u contains the parameters as standard normal scores, then the deviations from the laws, g (log damping) and h
        (relative frequency), at knots in time. combinations: coefficients of the n combinations, (n, K). The variance
        is averaged over the components; it is that before the cut-off of coefficients at 0.
        """
        return np.sqrt(self.weights @ np.sum((combinations @ self.factors) ** 2, axis=2))

    def draws(self, count: int, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
        """Draw the unknowns u, (count, K); return also the index of each draw's component in the mixture, (count,).

        u contains the parameters as standard normal scores, then the deviations from the laws, g (log damping) and h
        (relative frequency), at knots in time. The draws are ordered by component.
        """
        numbers = rng.multinomial(count, self.weights / self.weights.sum())
        places = np.flatnonzero(numbers)
        u = draw(rng, *self.posteriors(places), np.flatnonzero(self.positive), numbers[places])
        return u, np.repeat(places, numbers[places])

    def crank_nicolson_step(
        self, u: np.ndarray, places: np.ndarray, step: float, rng: np.random.Generator
    ) -> np.ndarray:
        """Return draws u, (n, K), after one Crank–Nicolson step, which leaves each component's distribution unchanged.

        With step s, a draw is moved to mean + √(1 − s²) (u − mean) + s times a random vector with the component's
        covariance; s = 1 gives an independent draw. places: index of each draw's component, (n,). The step ignores the
        cut-off at zero, so scores of coefficients may become negative.
        """
        means, factors = self.means[places], self.factors[places]
        noise = np.einsum("nij,nj->ni", factors, rng.standard_normal(u.shape))
        return means + np.sqrt(1 - step**2) * (u - means) + step * noise


def condense(
    columns: np.ndarray,
    r: np.ndarray,
    positive: np.ndarray,
    shared: np.ndarray | None = None,
    damping: np.ndarray | None = None,
) -> LinearModel:
    """Condense the n equations of a linear least-squares problem for K unknowns to K equations, by a QR factorisation.

    Parameters
    ----------
    columns : ndarray, shape (n, K)
        Jacobian of the motion.
    r : ndarray, shape (n,)
        Record minus the constant part of the linearised motion.
    positive, shared, damping : ndarray of bool, shape (d,)
        Which of the d standard normal scores, the first unknowns, must not be negative, have priors with a common
        scale, or belong to damping terms; by default none is shared or belongs to the damping.
    """
    k = columns.shape[1]
    lacking = max(k + 1 - r.size, 0)  # equations 0 = 0 make up for too few
    whole = np.asarray(np.linalg.qr(np.pad(np.column_stack([columns, r]), ((0, lacking), (0, 0))), mode="r"))
    none = np.zeros(positive.size, bool)
    shared, damping = (none if mask is None else mask for mask in (shared, damping))
    rest = float(np.sum(whole[k:, k] ** 2))
    return LinearModel(whole[:k, :k], whole[:k, k], rest, r.size, positive, shared, damping)


@dataclass(frozen=True)
class Normals:
    """Normal posteriors at c grid points, where each parameter has a standard normal score that may be negative.

    A grid point is a combination of the sizes (prior sds) and correlation lengths of the deviations g (log damping) and
    h (relative frequency) from the laws.

    log: log of evidence times prior probability of the grid point, in nats, (c,). means: (c, K). factors: F in the
    covariances F Fᵀ, (c, K, L). The K unknowns are either the scores alone, or scores, g and h.
    """

    log: np.ndarray
    means: np.ndarray
    factors: np.ndarray

    def only(self, places: np.ndarray) -> Normals:
        """Return the posteriors at some combinations of hyperparameters; places: their indices or a mask."""
        return Normals(self.log[places], self.means[places], self.factors[places])

    def given(self, known: np.ndarray, values: np.ndarray) -> Normals:
        """Return the posteriors of the other unknowns if some scores are known, with the evidence of this model.

        known: booleans, (K,). values: the known scores, (K,); those of unknown ones have no effect.
        """
        basis, triangle = np.linalg.qr(np.swapaxes(self.factors[:, known], 1, 2))
        off = np.linalg.solve(np.swapaxes(triangle, 1, 2), (values[known] - self.means[:, known])[:, :, None])
        factors = self.factors[:, ~known]
        along = factors @ basis
        log = self.log - np.sum(np.log(np.abs(np.diagonal(triangle, axis1=1, axis2=2))), axis=1)
        log = log - 0.5 * np.sum(off[:, :, 0] ** 2, axis=1) + 0.5 * values[known] @ values[known]
        means = self.means[:, ~known] + (along @ off)[:, :, 0]
        return Normals(log, means, factors - along @ np.swapaxes(basis, 1, 2))


@dataclass(frozen=True)
class _Principal:
    """A linear model whose scores are replaced by their principal coordinates v, relative to a fit without deviations.

    The scores are axes (at + v), where the matrix `axes`, (d, d), is orthogonal, and `at`, (d,), is the posterior mean
    without deviations. In `model`, with the unknowns v, g and h, the information about v without deviations is
    diagonal and the target is small, so that sums of their products keep their digits also where a record determines
    some scores far better than others.
    """

    model: LinearModel
    axes: np.ndarray
    at: np.ndarray

    @classmethod
    def of(cls, model: LinearModel, variance: float) -> _Principal:
        """Change the coordinates of a model. variance: variance of the noise, in the record's unit squared."""
        d = model.positive.size
        left, sizes, axes = np.linalg.svd(model.root[:, :d], full_matrices=False)
        at = sizes * (left.T @ model.target) / (sizes**2 + variance)
        root = np.concatenate([left * sizes, model.root[:, d:]], axis=1)
        target = model.target - left @ (sizes * at)
        return cls(replace(model, root=root, target=target), axes.T, at)

    def keeps_digits(self, grid: Grid, variance: float) -> bool:
        """Return whether the information about every deviation is less than `LARGEST_INFORMATION`.

        variance: least variance of the noise, in the record's unit squared.
        """
        root, n = self.model.root[:, self.at.size :], grid.roots_g.shape[1]
        of_g = np.sum((root[:, :n] @ grid.roots_g) ** 2, axis=1).max(initial=0.0) * grid.size_g.max() ** 2
        of_h = np.sum((root[:, n:] @ grid.roots_h) ** 2, axis=1).max(initial=0.0) * grid.size_h.max() ** 2
        return bool(max(of_g, of_h) < LARGEST_INFORMATION * variance)


@dataclass(frozen=True)
class _Triangles:
    """Cholesky factors of the posterior's information matrix (inverse covariance) at c combinations of hyperparameters.

    In coordinates w, which are the principal coordinates of the scores and independent coordinates of g and h with the
    prior N(0, I) in some order, the log posterior is −wᵀ L Lᵀ w / 2 + bᵀ w + constant. lower: L, (c, K, K). half:
    L⁻¹ b, (c, K). left: least value of |root u − target|² / noise variance + |scores|² + |w of g and h|², (c,), without
    `LinearModel.rest`; if h is integrated out, plus the log determinant of the information about it.
    """

    lower: np.ndarray
    half: np.ndarray
    left: np.ndarray

    @classmethod
    def of(cls, principal: _Principal, grid: Grid, variance: np.ndarray, order: np.ndarray) -> _Triangles:
        """Factorise the information matrix at each grid point (combination of hyperparameters).

        Hyperparameters are the sizes and correlation lengths of the deviations. variance: variance of the noise at each
        of c grid points, (c,). order: the order of the unknowns w, as indices of scores, g and h.
        """
        model, d, total = principal.model, principal.at.size, principal.model.root.shape[1]
        white = np.empty((variance.size, total, total + 1))
        white[:, :, :d], white[:, :, total] = model.root[:, :d], model.target
        white[:, :, d:total] = model.root[:, d:] @ grid.factors
        white = white[:, :, [*order, total]] / np.sqrt(variance)[:, None, None]
        about = np.concatenate([principal.at, np.zeros(total - d)])[order]
        if principal.keeps_digits(grid, float(np.min(variance))):
            return cls.of_products(np.swapaxes(white, 1, 2) @ white, about)
        # With hardly any noise the information matrix loses digits: minimise |white w − target|² + |w + about|² by QR.
        prior = np.broadcast_to(np.column_stack([np.eye(total), -about]), white.shape)
        upper = np.asarray(np.linalg.qr(np.concatenate([white, prior], axis=1), mode="r"))
        return cls(
            np.swapaxes(upper[:, :total, :total], 1, 2), upper[:, :total, total], upper[:, total, total] ** 2
        )

    @classmethod
    def of_products(cls, products: np.ndarray, about: np.ndarray) -> _Triangles:
        """Factorise the sums of products, (c, K + 1, K + 1), of the columns of K unknowns w and the target.

        They are in units of the noise variance, and are overwritten. The prior adds |w + about|² to the squares; about:
        (K,).
        """
        k = about.size
        products[:, np.arange(k), np.arange(k)] += 1.0
        products[:, k, :k] -= about
        squares = products[:, k, k] + about @ about
        products[:, k, k] = 2 * squares + 1  # The last pivot is then positive, whatever the rounding errors.
        lower = np.linalg.cholesky(products)
        return cls(lower[:, :k, :k], lower[:, k, :k], lower[:, k, k] ** 2 - squares - 1)

    def log_evidence(
        self, model: LinearModel, grid: Grid, variance: float | np.ndarray, samples: float
    ) -> np.ndarray:
        """Return the log of evidence times prior probability at each grid point, in nats, (c,).

        Parameters are those of `normals`.
        """
        log = grid.log_prior - 0.5 * (
            self.left + model.rest / variance + samples * np.log(2 * np.pi * variance)
        )
        return log - np.sum(np.log(np.abs(np.diagonal(self.lower, axis1=1, axis2=2))), axis=1)


def normals(model: LinearModel, grid: Grid, variance: float | np.ndarray, samples: float) -> Normals:
    """Compute the normal posterior of the standard normal scores and the deviations g and h at each grid point.

    Scores may be negative. A grid point is a combination of the deviations' sizes (prior sds) and correlation lengths.

    Parameters
    ----------
    model : LinearModel
        The linear model about a motion.
    grid : Grid
        Sizes (prior sds) and correlation lengths of the deviations.
    variance : float or ndarray, shape (c,)
        Variance of the noise, in the record's unit squared; an array has one for each grid point.
    samples : float
        Effective number of independent values in the record (see `linear_posterior`).
    """
    d, variance = model.positive.size, np.broadcast_to(variance, grid.log_prior.size)
    principal = _Principal.of(model, float(np.min(variance)))
    triangles = _Triangles.of(principal, grid, variance, np.arange(model.root.shape[1]))
    factors = np.swapaxes(np.linalg.inv(triangles.lower), 1, 2).copy()
    factors[:, :d] = principal.axes @ factors[:, :d]
    factors[:, d:] = grid.factors @ factors[:, d:]
    means = (factors @ triangles.half[:, :, None])[:, :, 0]
    means[:, :d] += principal.axes @ principal.at
    return Normals(triangles.log_evidence(model, grid, variance, samples), means, factors)


def score_normals(model: LinearModel, grid: Grid, variance: float, samples: float) -> Normals:
    """Compute the normal posterior of the scores alone at each grid point, with the deviations integrated out.

    Scores are parameters transformed to standard normal priors, and may be negative. A grid point is a combination of
    sizes (prior sds) and correlation lengths of the deviations g (log damping) and h (relative frequency). Parameters
    are those of `linear_posterior`.
    """
    d, total = model.positive.size, model.root.shape[1]
    principal = _Principal.of(model, variance)
    # With the scores behind the deviations, the last rows of the triangle are that of the scores alone.
    if principal.keeps_digits(grid, variance):
        triangles = _without_h(principal, grid, variance)
    else:
        variances, order = np.full(grid.log_prior.size, variance), np.roll(np.arange(total), -d)
        triangles = _Triangles.of(principal, grid, variances, order)
    factors = np.swapaxes(np.linalg.inv(triangles.lower[:, -d:, -d:]), 1, 2)
    means = principal.at + (factors @ triangles.half[:, -d:, None])[:, :, 0]
    log = triangles.log_evidence(model, grid, variance, samples)
    return Normals(log, means @ principal.axes.T, principal.axes @ factors)


def _without_h(principal: _Principal, grid: Grid, variance: float) -> _Triangles:
    """Factorise the information about g and the scores at each grid point, with h integrated out.

    h, the relative deviation of the frequency, is integrated out only once for each of its sizes (prior sds) and
    correlation lengths. g is the deviation of the log damping. variance: variance of the noise, in the record's unit
    squared.
    """
    model, d, n = principal.model, principal.at.size, grid.roots_g.shape[1]
    columns = np.column_stack([model.root[:, d : d + n], model.root[:, :d], model.target])
    of_h, places = grid.of_h
    white = model.root[:, d + n :] @ of_h
    information = np.swapaxes(white, 1, 2) @ white / variance + np.eye(white.shape[2])
    both = np.swapaxes(white, 1, 2) @ columns / variance
    products = columns.T @ columns / variance - np.swapaxes(both, 1, 2) @ np.linalg.solve(information, both)
    # Change to the independent coordinates of g for a size of 1 and each correlation length.
    change = np.tile(np.eye(n + d + 1), (len(grid.roots_g), 1, 1))
    change[:, :n, :n] = grid.roots_g
    products = np.swapaxes(change, 1, 2) @ products[:, None] @ change
    products = products[places, grid.length_g]
    products[:, :n] *= grid.size_g[:, None, None]
    products[:, :, :n] *= grid.size_g[:, None, None]
    triangles = _Triangles.of_products(products, np.concatenate([np.zeros(n), principal.at]))
    return replace(triangles, left=triangles.left + np.linalg.slogdet(information)[1][places])


def linear_posterior(model: LinearModel, grid: Grid, variance: float, samples: float) -> LinearPosterior:
    """Compute the posterior and the evidence of a linear model under white noise.

    Each score has the prior N(0, 1); scores marked in `model.shared` have N(0, σ²) instead, with a common scale σ,
    which is summed over the values `SHARED_SIGMAS`. Scores marked in `model.positive` have half-normal priors, cut off
    below zero.

    Parameters
    ----------
    model : LinearModel
        The linear model about a motion.
    grid : Grid
        Sizes (prior sds) and correlation lengths of the deviations.
    variance : float
        Variance of the noise, in the record's unit squared.
    samples : float
        Effective number N of independent values: n / κ for n values, if correlated residuals inflate the variance by κ.
        The log likelihood is −N/2 · log(2π variance) − (sum of squares) / (2 variance).
    """
    posteriors = score_normals(model, grid, variance, samples)
    posterior = with_priors(posteriors, model.positive, model.shared)
    places = np.flatnonzero(model.damping)
    likelihood = partial(damping_likelihood, posteriors, places, grid.log_prior) if places.size else None
    whole = partial(_whole, model, grid, variance, samples)
    return replace(posterior, whole=whole, damping_likelihood=likelihood)


def _whole(model: LinearModel, grid: Grid, variance: float, samples: float, combos: np.ndarray) -> Normals:
    """Return the normal posteriors of scores and deviations at the k grid points with the indices `combos`, (k,).

    A grid point is a combination of sizes and correlation lengths of the deviations. The other arguments are those of
    `normals`.
    """
    return normals(model, grid.only(combos), variance, samples)


def with_priors(posteriors: Normals, positive: np.ndarray, shared: np.ndarray) -> LinearPosterior:
    """Replace the N(0, 1) priors of scores by the actual priors; return the posterior over grid points and scales.

    A grid point is a combination of sizes and correlation lengths of the deviations from the laws. Positive scores get
    half-normal priors, and shared scores priors with each value of the common scale σ in `SHARED_SIGMAS`, all equally
    probable. The result has the unknowns of `posteriors` and no `damping_likelihood`.

    Parameters
    ----------
    posteriors : Normals
        Posteriors under N(0, 1) priors.
    positive, shared : ndarray of bool, shape (d,)
        Which scores must not be negative, and which have priors with the common scale.
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
        # Half-normal densities are 2^k times normal ones; the evidence is that times the probability of all scores ≥ 0.
        inside = log_probability(means, factors @ np.swapaxes(factors, 1, 2))
        log_each = log_each + (means.shape[1] * np.log(2.0) + inside)
    evidence = float(np.logaddexp.reduce(log_each))
    return LinearPosterior(log_each, evidence, combos, scales, positive, shared, posteriors.only)


@dataclass(frozen=True)
class _ScaledPriors:
    """Normal posteriors for every scale σ of the shared scores, whose prior is N(0, σ²) instead of N(0, 1).

    Let u = mean + F x with x ~ N(0, I); the shared scores are m + S x. The other prior adds δ |m + S x|² / 2 to −log p,
    δ = 1/σ² − 1. With S = U D Wᵀ this changes x only along the k columns of W.

    normals: the posteriors for σ = 1, at c grid points. inside: indices among the shared scores of those that must not
    be negative, (i,). log: log of evidence times prior probability, before the cut-off at zero, for each grid point and
    each of s scales, (c, s). aim: Uᵀ m, (c, k). sizes: D, (c, k). left: U, (c, k, k). right: W, (c, K, k). extra: δ,
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
        """Return the pairs of grid point and common prior scale σ that have nearly all posterior probability.

        They are given by their indices, (m,) each; a grid point is a combination of sizes and correlation lengths of
        the deviations. Left out are pairs that are `NEGLIGIBLE` nats below the best, and the least probable others,
        with a total probability of at most `LEFT_OUT`. The probabilities are from an upper bound of the evidence, for
        which only the least probable of the conditions "coefficient ≥ 0" is applied.
        """
        top = np.unravel_index(int(np.argmax(self.log)), self.log.shape)
        least = float(self._bound(*map(np.atleast_1d, top))[0]) - NEGLIGIBLE
        combos, scales = np.nonzero(self.log >= least)
        bound = self._bound(combos, scales)
        order = np.argsort(-bound)
        total = np.cumsum(np.exp(bound[order] - bound[order[0]]))
        count = int(np.searchsorted(total, (1 - LEFT_OUT) * total[-1])) + 1
        places = np.sort(order[:count])
        return combos[places], scales[places]

    def _bound(self, combos: np.ndarray, scales: np.ndarray) -> np.ndarray:
        """Return an upper bound of log(evidence × prior probability) for m pairs of grid point and prior scale, (m,).

        A grid point is a combination of sizes and correlation lengths of the deviations. Of the conditions that
        coefficients are ≥ 0, only the least probable one is applied. combos, scales: indices of the grid points and of
        the scales, (m,).
        """
        log = self.log[combos, scales]
        if not self.inside.size:
            return log
        sizes, left = self.sizes[combos], self.left[combos][:, self.inside]
        shrunk = 1.0 + self.extra[scales][:, None] * sizes**2
        mean = (left @ (self.aim[combos] / shrunk)[:, :, None])[:, :, 0]
        variance = (left**2 @ (sizes**2 / shrunk)[:, :, None])[:, :, 0]
        return log + scipy.special.log_ndtr(mean / np.sqrt(variance)).min(axis=1)

    def posteriors(
        self, combos: np.ndarray, scales: np.ndarray, rows: np.ndarray | slice = slice(None)
    ) -> tuple[np.ndarray, np.ndarray]:
        """Return the normal posteriors for m pairs of grid point and common prior scale, before the cut-off at zero.

        They are means, (m, K), and factors F of the covariances F Fᵀ, (m, K, K). A grid point is a combination of sizes
        and correlation lengths of the deviations. combos, scales: indices of the grid points and of the scales, (m,).
        rows: which of the K unknowns to return, by default all.
        """
        sizes, right, extra = self.sizes[combos], self.right[combos], self.extra[scales][:, None]
        factors = self.normals.factors[:, rows][combos]
        shrunk = 1.0 + extra * sizes**2
        along = factors @ right
        move = extra * sizes / shrunk * self.aim[combos]
        means = self.normals.means[:, rows][combos] - (along @ move[:, :, None])[:, :, 0]
        factors = factors + (along * (1 / np.sqrt(shrunk) - 1)[:, None, :]) @ np.swapaxes(right, 1, 2)
        return means, factors


def damping_likelihood(posteriors: Normals, places: np.ndarray, log_prior: np.ndarray) -> DampingLikelihood:
    """Compute the likelihood of the damping's parameters at each grid point.

    The parameters are expressed as standard normal scores, and all other unknowns are integrated out.

    Parameters
    ----------
    posteriors : Normals
        Posteriors under N(0, 1) priors.
    places : ndarray of int, shape (k,)
        Indices of the damping's scores.
    log_prior : ndarray, shape (c,)
        Log prior probabilities of the grid points (sizes and correlation lengths of the deviations).
    """
    left, sizes, _ = np.linalg.svd(posteriors.factors[:, places], full_matrices=False)
    # Information of the likelihood: that of the posterior minus that of the prior, in its principal directions.
    gained = np.maximum(1.0 / sizes**2 - 1.0, 0.0)
    aim = np.einsum("cij,ci->cj", left, posteriors.means[:, places])
    information = np.einsum("cij,cj,ckj->cik", left, gained, left)
    slope = np.einsum("cij,cj->ci", left, aim / sizes**2)
    log = posteriors.log - log_prior - np.sum(np.log(sizes), axis=1)
    log = log - 0.5 * np.sum((aim / sizes) ** 2, axis=1)
    return DampingLikelihood(log, slope, information)
