"""Compute posterior and evidence of a linear Gaussian model, summed over a grid of hyperparameters of its deviations.

The unknowns are the parameters, transformed so that their priors are standard normal (scores), and the deviations from
the laws at knots in time: g (the damping force is multiplied by exp g) and h (the frequency is multiplied by 1 + h).
The hyperparameters are the prior sds (sizes) and the correlation lengths of g and h.
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
"""Prior probability that the law of the damping holds exactly during the record, and the same for the law of the
restoring force, independently. Otherwise the damping, or the frequency, deviates from its law."""
MEAN_G, MEAN_H = 0.03, 0.01
"""Means of the exponential priors of the sizes (prior standard deviations, dimensionless) of the deviations g and h,
for laws that are not exact. The damping force is multiplied by exp g, and the frequency by 1 + h."""
SIZES_G = np.geomspace(0.002, 0.25, 9)
SIZES_H = np.geomspace(0.0003, 0.03, 6)
"""`SIZES_G` and `SIZES_H`: values of the sizes (prior standard deviations, dimensionless) of the deviations g and h
that the grid of hyperparameters contains. The damping force is multiplied by exp g, and the frequency by 1 + h."""
LENGTHS = (0.1, 0.3, 1.0)
"""Values of the correlation lengths of the deviations g and h that the grid of hyperparameters contains, as fractions
of the record's duration. The damping force is multiplied by exp g, and the frequency by 1 + h."""
JITTER = 1e-6
"""Small number that is added to the diagonal, which is 1, of the prior correlation matrix of a deviation, so that its
Cholesky factor exists (conventional)."""
LEAST_KNOTS, MOST_KNOTS = 4, 16
"""Smallest and largest number of knots in time between which the deviation of the damping, or of the frequency, from
its law is interpolated."""


@dataclass(frozen=True)
class Grid:
    """Combinations of the hyperparameters of g and h (grid points), with their prior probabilities.

    g and h are deviations from the laws at n knots in time each: the damping force is multiplied by exp g, and the
    frequency by 1 + h. Their hyperparameters are sizes (prior standard deviations) and correlation lengths. For an
    envelope (`grid_of` without phases), h has no knots.

    Attributes
    ----------
    size_g, size_h : ndarray, shape (c,)
        Sizes (prior standard deviations, dimensionless) of g and h at each grid point.
    length_g, length_h : ndarray of int, shape (c,)
        Index of each grid point's correlation length in `roots_g` and in `roots_h`.
    log_prior : ndarray, shape (c,)
        Log prior probability of each grid point.
    roots_g, roots_h : ndarray, shape (l, n, n)
        Matrices R, where R Rᵀ is the covariance of g (or h) for a size of 1, one for each of the l correlation lengths.
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
        """Return for each of c grid points the matrix F, (c, 2n, 2n), where F Fᵀ is the prior covariance of (g, h).

        A grid point is one combination of sizes (prior sds) and correlation lengths of the deviations g and h, which
        have values at n knots in time each. The damping force is multiplied by exp g, and the frequency by 1 + h. If h
        has no knots, F is (c, n, n), for g alone.
        """
        n, total = self.roots_g.shape[1], self.roots_g.shape[1] + self.roots_h.shape[1]
        factors = np.zeros((self.log_prior.size, total, total))
        factors[:, :n, :n] = self.roots_g[self.length_g] * self.size_g[:, None, None]
        factors[:, n:, n:] = self.roots_h[self.length_h] * self.size_h[:, None, None]
        return factors

    @cached_property
    def of_h(self) -> tuple[np.ndarray, np.ndarray]:
        """Return factors F, (k, n, n), of the k different prior covariances F Fᵀ of h; and an index array, (c,).

        h is the relative deviation of the frequency from the restoring law, at n knots in time. The index array says
        which of the k factors belongs to each of the c grid points (combinations of hyperparameters).
        """
        both = np.column_stack([self.size_h, self.length_h])
        _, first, places = np.unique(both, axis=0, return_index=True, return_inverse=True)
        return self.roots_h[self.length_h[first]] * self.size_h[first, None, None], places.ravel()

    def only(self, places: np.ndarray) -> Grid:
        """Return the grid with only the grid points at the indices `places`, (k,).

        Indices may repeat. The prior probabilities of the grid points do not change.
        """
        names = ("size_g", "size_h", "length_g", "length_h", "log_prior")
        return replace(self, **{name: getattr(self, name)[places] for name in names})


def knots_of(duration: float, cycles: float) -> np.ndarray:
    """Return the equidistant times of the knots between which a deviation from a law is interpolated, in s.

    They extend from 0 to `duration`, both on the time axis of the solver. Their number is half the number of cycles in
    the record (rounded) plus 1, but at least 4 and at most 16. cycles: number of cycles in the record.
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
    """Return the grid of sizes (prior sds) and correlation lengths of the deviations g and h from the laws.

    The damping force is multiplied by exp g, and the frequency by 1 + h. A grid point is a size and a length of g
    together with those of h; each may be without deviation. The grid contains all combinations, with prior
    probabilities.

    Parameters
    ----------
    knots : int
        Number n of knots in time of each deviation. It is the size of the grid's covariance factors, (n, n).
    exact : bool
        If true, the laws are exact: the grid has only one point, at which g = h = 0.
    coarse : bool
        If true, the grid has only every other size, and only the shortest and the longest length.
    absorbed : tuple of bool
        Two flags: whether an inferred coefficient has the same effect as a constant g, and whether the inferred
        stiffness has the same effect as a constant h. If true, the mean of the deviation over the record is fixed at
        zero. Otherwise the posterior would extend along a curve (coefficient times exp g is constant), which a linear
        model does not follow.
    phases : bool
        Whether the values that are fitted depend on the phase of the oscillation. If false (an envelope), h has no
        effect and no knots: the grid is for g alone.
    """
    step = 2 if coarse else 1
    of_g = _with_none(SIZES_G[::step], MEAN_G, step) if not exact else np.zeros((3, 1))
    of_h = _with_none(SIZES_H[::step], MEAN_H, step) if not exact and phases else np.zeros((3, 1))
    size_g, length_g, log_g = np.repeat(of_g, of_h.shape[1], axis=1)
    size_h, length_h, log_h = np.tile(of_h, of_g.shape[1])
    root_g, root_h = _roots(knots, absorbed[0]), _roots(knots if phases else 0, absorbed[1])
    return Grid(size_g, size_h, length_g.astype(int), length_h.astype(int), log_g + log_h, root_g, root_h)


def _with_none(sizes: np.ndarray, mean: float, step: int) -> np.ndarray:
    """Return the grid of one deviation, g or h, as an array (3, n): sizes, indices of correlation lengths, log prior.

    The three rows contain, for each of n grid points, the size (prior sd), the index of the correlation length in
    `LENGTHS`, and the log prior probability. The first point is "no deviation", with probability `PROBABILITY_EXACT`.
    At the others, the size has an exponential prior with the given mean, and every `step`-th of `LENGTHS` is equally
    probable.
    """
    edges = np.concatenate([[0.0], np.sqrt(sizes[1:] * sizes[:-1]), [np.inf]])
    lengths = np.arange(len(LENGTHS))[::step]
    mass = np.diff(-np.exp(-edges / mean)) * (1 - PROBABILITY_EXACT) / lengths.size
    deviating = [
        np.repeat(sizes, lengths.size), np.tile(lengths, sizes.size), np.log(np.repeat(mass, lengths.size))
    ]  # fmt: skip
    return np.column_stack([[0.0, 0.0, np.log(PROBABILITY_EXACT)], deviating])


def _roots(knots: int, centred: bool) -> np.ndarray:
    """Return a factor F of the prior covariance F Fᵀ of a deviation with prior sd 1, for each of `LENGTHS`, (l, n, n).

    The deviation is g or h, at n knots in time. centred: whether its mean over the record is fixed at zero.
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

    It is the prior covariance of a deviation (g or h) from a law, for a prior sd of 1. s is the time as a fraction of
    the record, and length the correlation length in this unit. `JITTER` is added to the diagonal of the covariance.
    """
    s = np.linspace(0.0, 1.0, knots)
    return np.linalg.cholesky(np.exp(-np.abs(s[:, None] - s) / length) + JITTER * np.eye(knots))


NO_DEVIATIONS = grid_of(0, exact=True)
"""The grid of hyperparameters under exact laws. Its only point has no deviations of damping (g) and frequency (h), and
no knots in time."""


LARGEST_INFORMATION = 1e11
"""Largest information about a deviation at a knot, relative to the prior's, for which the fast method with sums of
products is used; Cholesky factors and differences of squares then keep at least five digits (measured). Above it, a
slower QR factorisation is used."""
LEAST_SQUARE = 1e-8
"""Least ratio of two squared singular values that an eigenvalue decomposition of a matrix of products gives to eight
digits."""
NEGLIGIBLE = 30.0
"""The evidence is a sum over grid points (sizes and correlation lengths of the deviations) and values of the common
prior scale of coefficients. A combination is left out if an upper bound of its log evidence is more than this many nats
below an estimate of the largest one."""
LEFT_OUT = 1e-3
"""The evidence is a sum over grid points (sizes and correlation lengths of the deviations) and values of the common
prior scale of coefficients. The least probable combinations, with at most this total posterior probability (computed
from upper bounds of their evidences), are left out. This lowers a log evidence by about a thousandth of a nat or
less."""


@dataclass(frozen=True)
class LinearModel:
    """The sum of squared residuals of a linearised candidate as a quadratic form: |root u − target|² + rest.

    u contains the d parameters, transformed so that their priors are standard normal (scores), then the deviations from
    the laws at knots in time: g (the damping force is multiplied by exp g) and h (the frequency is multiplied by 1 +
    h).

    Attributes
    ----------
    root : ndarray, shape (K, K)
        Upper triangular matrix, from a QR factorisation of the Jacobian of the motion.
    target : ndarray, shape (K,)
        Right-hand side, in the record's unit.
    rest : float
        Smallest sum of squared residuals, in the record's unit squared; u has this sum where root u = target.
    count : int
        Number of values of the record, n.
    positive : ndarray of bool, shape (d,)
        Marks the scores that must not be negative.
    shared : ndarray of bool, shape (d,)
        Marks the scores of coefficients whose half-normal priors have a common, unknown scale.
    damping : ndarray of bool, shape (d,)
        Marks the scores of parameters of damping terms.
    """

    root: np.ndarray
    target: np.ndarray
    rest: float
    count: int
    positive: np.ndarray
    shared: np.ndarray
    damping: np.ndarray

    def squares(self, u: np.ndarray) -> np.ndarray:
        """Return the sum of squared residuals, (n,), in the record's unit squared, for n vectors u, (n, K)."""
        return np.sum((u @ self.root.T - self.target) ** 2, axis=1) + self.rest

    def transform(self, u: np.ndarray, matrix: np.ndarray) -> LinearModel:
        """Return the model in new coordinates w, (K,): the present unknowns are u₀ + matrix (w − u₀).

        u₀ is the argument `u`, (K,), a point that does not change. matrix: (K, K). The three masks stay the same.
        """
        target = self.target - self.root @ (u - matrix @ u)
        model = condense(self.root @ matrix, target, self.positive, self.shared, self.damping)
        return replace(model, rest=self.rest + model.rest, count=self.count)


@dataclass(frozen=True)
class DampingLikelihood:
    """The likelihood of the damping's parameters at each grid point, with a record's other unknowns integrated out.

    x are the k parameters, transformed so that their priors are standard normal (scores), or linear functions of these
    (see `transform`), such as the parameters in their units. The log likelihood in nats at each of c grid points is
    `log` + `slope`ᵀ x − xᵀ `information` x / 2, with arrays of shape (c,), (c, k) and (c, k, k). It contains neither
    the prior of x nor that of the grid point, because it is for joint fits of several records. A grid point is one
    combination of sizes (prior sds) and correlation lengths of the deviations from the laws.
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

    Each component belongs to one grid point (sizes and correlation lengths of the deviations from the laws) and to one
    value of the common prior scale of coefficients. The K unknowns are the d parameters, transformed so that their
    priors are standard normal (scores), followed by the deviations g and h at n knots in time each (K = d + 2n) or,
    from `with_priors`, perhaps alone (K = d).

    Attributes
    ----------
    log_each : ndarray, shape (m,)
        Log evidence of each component times its prior probability, in nats.
    log_evidence : float
        Log evidence of the model, in nats.
    combos : ndarray of int, shape (m,)
        Index of each component's grid point.
    scales : ndarray of int, shape (m,), optional
        Index of each component's common prior scale in `SHARED_SIGMAS`; None if no scores have a common scale.
    positive, shared : ndarray of bool, shape (d,)
        Mark the scores that must not be negative, and the scores whose priors have the common scale.
    whole : callable
        Function that maps indices of grid points to the `Normals` there, under priors N(0, 1) and without the cut-off.
    damping_likelihood : callable, optional
        Function without arguments that returns the likelihood of the damping's scores at each grid point; None if there
        are no such scores, or if the posterior is from `with_priors` or `only`.
    """

    log_each: np.ndarray
    log_evidence: float
    combos: np.ndarray
    scales: np.ndarray | None
    positive: np.ndarray
    shared: np.ndarray
    whole: Callable[[np.ndarray], Normals]
    damping_likelihood: Callable[[], DampingLikelihood] | None = None

    def posteriors(
        self, places: np.ndarray, unknowns: np.ndarray | slice = slice(None)
    ) -> tuple[np.ndarray, np.ndarray]:
        """Return means (k, K) and covariance factors (k, K, K) of k components before the cut-off at zero.

        A factor F belongs to the covariance F Fᵀ. The cut-off removes negative scores of coefficients; it is not
        included here. places: indices of the components in the mixture, (k,). unknowns: which of the K unknowns have a
        mean and a row of the factor, by default all.
        """
        combos, rows = np.unique(self.combos[places], return_inverse=True)
        normals = self.whole(combos)
        if self.scales is None:
            return normals.means[rows][:, unknowns], normals.factors[rows][:, unknowns]
        scaled = _ScaledPriors.of(normals, self.positive, self.shared)
        return scaled.posteriors(rows, self.scales[places], unknowns)

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
        """Return the posterior with only the components of the mixture marked in `which`, booleans (m,).

        Its log evidence is the log of the sum of their evidences, and its `damping_likelihood` is None.
        """
        log = self.log_each[which]
        return replace(
            self,
            log_each=log,
            log_evidence=float(np.logaddexp.reduce(log)),
            combos=self.combos[which],
            scales=None if self.scales is None else self.scales[which],
            damping_likelihood=None,
        )

    @property
    def top_mean(self) -> np.ndarray:
        """Return the mean of the most probable component of the mixture, (K,), before the cut-off at zero."""
        return self.posteriors(np.array([int(np.argmax(self.log_each))]))[0][0]

    @property
    def weights(self) -> np.ndarray:
        """Return the posterior probability of each component of the mixture, (m,); their sum is 1."""
        return np.exp(self.log_each - self.log_evidence)

    def sds(self, combinations: np.ndarray) -> np.ndarray:
        """Return the sd of each of n linear combinations of the unknowns u within the components of the mixture, (n,).

        u contains the parameters, transformed so that their priors are standard normal (scores), then the deviations g
        and h from the laws at knots in time (the damping force is multiplied by exp g, the frequency by 1 + h).
        combinations: coefficients of the n combinations, (n, K). The variance is averaged over the components; their
        different means do not contribute. It is the variance before coefficients are cut off at 0.
        """
        used = np.any(combinations != 0.0, axis=0)
        factors = self.posteriors(np.arange(self.combos.size), used)[1]
        return np.sqrt(self.weights @ np.sum((combinations[:, used] @ factors) ** 2, axis=2))

    def draws(self, count: int, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
        """Draw the unknowns u, (count, K); return them and the index of each draw's component in the mixture, (count,).

        u contains the parameters, transformed so that their priors are standard normal (scores), then the deviations
        from the laws at knots in time: g (the damping force is multiplied by exp g) and h (the frequency is multiplied
        by 1 + h). Scores marked in `positive` are ≥ 0. The draws are ordered by component; some may be equal.
        """
        numbers = rng.multinomial(count, self.weights / self.weights.sum())
        places = np.flatnonzero(numbers)
        u = draw(rng, *self.posteriors(places), np.flatnonzero(self.positive), numbers[places])
        return u, np.repeat(places, numbers[places])

    def crank_nicolson_step(
        self, u: np.ndarray, places: np.ndarray, step: float, rng: np.random.Generator
    ) -> np.ndarray:
        """Return draws u, (n, K), after a Crank–Nicolson step, which does not change the distribution in a component.

        The step moves a draw to mean + √(1 − s²) (u − mean) + s times a random vector with the covariance of the draw's
        component. s is the argument `step`, from 0 to 1; 1 gives an independent draw. places: index of each draw's
        component in the mixture, (n,). The step ignores the cut-off at zero, so scores of coefficients may become
        negative.
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
        Mark which of the first d unknowns (parameters, transformed so that their priors are standard normal) must not
        be negative, which have priors with a common scale, and which belong to damping terms. By default none has a
        common scale, and none belongs to damping terms.
    """
    n, k = columns.shape
    both = np.zeros((max(n, k + 1), k + 1))  # if there are fewer than K + 1 equations, add equations 0 = 0
    both[:n, :k], both[:n, k] = columns, r
    whole = np.asarray(np.linalg.qr(both, mode="r"))
    none = np.zeros(positive.size, bool)
    shared, damping = (none if mask is None else mask for mask in (shared, damping))
    return LinearModel(whole[:k, :k], whole[:k, k], float(whole[k, k] ** 2), n, positive, shared, damping)


@dataclass(frozen=True)
class Normals:
    """Normal posteriors at c grid points, where all transformed parameters have N(0, 1) priors and may be negative.

    A grid point is one combination of the sizes (prior sds) and correlation lengths of the deviations g and h from the
    laws (the damping force is multiplied by exp g, the frequency by 1 + h).

    log: log of evidence times prior probability of the grid point, in nats, (c,). means: means of the K unknowns, (c,
    K). factors: matrices F in the covariances F Fᵀ, (c, K, L). The unknowns are the parameters, transformed so that
    their priors are N(0, 1) (scores), either alone or followed by g and h at knots in time.
    """

    log: np.ndarray
    means: np.ndarray
    factors: np.ndarray

    def only(self, places: np.ndarray) -> Normals:
        """Return the posteriors at some of the grid points (combinations of hyperparameters).

        places: indices of these grid points, or a mask (c,).
        """
        return Normals(self.log[places], self.means[places], self.factors[places])

    def given(self, known: np.ndarray, values: np.ndarray) -> Normals:
        """Return the posteriors of the other unknowns, given that some scores are known.

        Scores are parameters transformed so that their priors are N(0, 1). The evidence in the result is that of a
        model with these fixed values, without their priors; with coefficients of 0 it is that of a smaller damping sum.
        known: marks the known scores, booleans (K,). values: their values, (K,); elements for other unknowns have no
        effect.
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
    """A linear model in which principal coordinates v replace the parameters, relative to a fit without deviations.

    The parameters, transformed so that their priors are standard normal (scores), are axes (at + v). The matrix `axes`,
    (d, d), is orthogonal, and `at`, (d,), is the posterior mean without the deviations g and h from the laws. `model`
    has the unknowns v, g and h. Without deviations its information about v is diagonal, and its target is small.
    Therefore sums of products of its columns keep their digits, even if a record determines some scores far better than
    others.
    """

    model: LinearModel
    axes: np.ndarray
    at: np.ndarray

    @classmethod
    def of(cls, model: LinearModel, variance: float) -> _Principal:
        """Return a model in principal coordinates (see the class) instead of its parameters.

        variance: variance of the noise, in the record's unit squared.
        """
        d = model.positive.size
        left, sizes, axes = np.linalg.svd(model.root[:, :d], full_matrices=False)
        at = sizes * (left.T @ model.target) / (sizes**2 + variance)
        root = np.concatenate([left * sizes, model.root[:, d:]], axis=1)
        target = model.target - left @ (sizes * at)
        return cls(replace(model, root=root, target=target), axes.T, at)

    def keeps_digits(self, grid: Grid, variance: float) -> bool:
        """Return whether sums of products keep enough digits at all grid points, so that no QR factorisation is needed.

        This is so if the information about each deviation g and h is less than `LARGEST_INFORMATION`. variance: least
        variance of the noise, in the record's unit squared.
        """
        root, n = self.model.root[:, self.at.size :], grid.roots_g.shape[1]
        of_g = np.sum((root[:, :n] @ grid.roots_g) ** 2, axis=1).max(initial=0.0) * grid.size_g.max() ** 2
        of_h = np.sum((root[:, n:] @ grid.roots_h) ** 2, axis=1).max(initial=0.0) * grid.size_h.max() ** 2
        return bool(max(of_g, of_h) < LARGEST_INFORMATION * variance)


@dataclass(frozen=True)
class _Triangles:
    """Cholesky factors of the posterior's information matrix (inverse covariance) at c combinations of hyperparameters.

    The K coordinates w are principal coordinates of the parameters (`_Principal`) and coordinates of g and h with the
    prior N(0, I), in some order. In them the log posterior is −wᵀ L Lᵀ w / 2 + bᵀ w + constant.

    lower: L, (c, K, K). half: L⁻¹ b, (c, K). left: the smallest value of |root u − target|² / noise variance +
    |scores|² + |w of g and h|², (c,), without the constant `LinearModel.rest`. If h is integrated out, `left` also
    contains the log determinant of the information about h.
    """

    lower: np.ndarray
    half: np.ndarray
    left: np.ndarray

    @classmethod
    def of(cls, principal: _Principal, grid: Grid, variance: np.ndarray, order: np.ndarray) -> _Triangles:
        """Factorise the information matrix at each grid point (combination of hyperparameters).

        Hyperparameters are the sizes (prior sds) and correlation lengths of the deviations from the laws. variance:
        variance of the noise at each of c grid points, (c,). order: the order of the coordinates w, as indices of the
        unknowns (scores, then g, then h).
        """
        model, d, total = principal.model, principal.at.size, principal.model.root.shape[1]
        white = np.empty((variance.size, total, total + 1))
        white[:, :, :d], white[:, :, total] = model.root[:, :d], model.target
        white[:, :, d:total] = model.root[:, d:] @ grid.factors
        white = white[:, :, [*order, total]] / np.sqrt(variance)[:, None, None]
        about = np.concatenate([principal.at, np.zeros(total - d)])[order]
        if principal.keeps_digits(grid, float(np.min(variance))):
            return cls.of_products(np.swapaxes(white, 1, 2) @ white, about)
        # With hardly any noise, sums of products lose digits: minimise |white w − target|² + |w + about|² by QR.
        prior = np.broadcast_to(np.column_stack([np.eye(total), -about]), white.shape)
        upper = np.asarray(np.linalg.qr(np.concatenate([white, prior], axis=1), mode="r"))
        lower = np.swapaxes(upper[:, :total, :total], 1, 2)
        return cls(lower, upper[:, :total, total], upper[:, total, total] ** 2)

    @classmethod
    def of_products(cls, products: np.ndarray, about: np.ndarray) -> _Triangles:
        """Compute the Cholesky factors from products, (c, K + 1, K + 1), of the columns of K unknowns and the target.

        c: number of combinations of hyperparameters. The unknowns are the coordinates w of the class (parameters, g,
        h). Each product is a sum over the rows, divided by the variance of the noise. The array is overwritten. The
        prior adds |w + about|² to the squares. about: (K,).
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
        """Return the log of evidence times prior probability at each of the c points of `grid`, in nats, (c,).

        A grid point is one combination of sizes (prior sds) and correlation lengths of the deviations. `grid` contains
        its prior probability, which is not a density. The arguments are those of `normals`.
        """
        squares = self.left + model.rest / variance
        log = grid.log_prior - 0.5 * (squares + samples * np.log(2 * np.pi * variance))
        return log - np.sum(np.log(np.abs(np.diagonal(self.lower, axis1=1, axis2=2))), axis=1)


def normals(model: LinearModel, grid: Grid, variance: float | np.ndarray, samples: float) -> Normals:
    """Compute the normal posterior of the parameters and of the deviations g and h from the laws at each grid point.

    g is the deviation of the log damping, and h is the relative deviation of the frequency, both at knots in time. A
    grid point is one combination of sizes (prior sds) and correlation lengths of g and h. The parameters are
    transformed so that their priors are standard normal (scores). Scores of damping coefficients may be
    negative here, because the posterior would not be normal with a bound.

    Parameters
    ----------
    model : LinearModel
        The sum of squared residuals, linearised about a motion.
    grid : Grid
        Sizes (prior sds) and correlation lengths of the deviations.
    variance : float or ndarray, shape (c,)
        Variance of the noise, in the record's unit squared; an array contains one for each grid point.
    samples : float
        Effective number of independent values in the record (see `linear_posterior`).

    Returns
    -------
    Normals
        For each of the c grid points: the log of evidence times prior probability, and the mean and the covariance of
        the scores, g and h.
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
    """Compute the normal posterior of the parameters at each grid point, with the deviations g and h integrated out.

    g is the deviation of the log damping, and h is the relative deviation of the frequency, both at knots in time. A
    grid point is one combination of sizes (prior sds) and correlation lengths of g and h. The parameters are
    transformed so that their priors are standard normal (scores). Scores of damping coefficients may be negative here,
    because the posterior would not be normal with a bound. The arguments are those of `linear_posterior`. The result
    contains, for each of the c grid points, the log of evidence times prior probability, and the mean and the
    covariance of the scores.
    """
    principal, triangles = _factorised(model, grid, variance)
    d = principal.at.size
    factors = np.swapaxes(np.linalg.inv(triangles.lower[:, -d:, -d:]), 1, 2)
    means = principal.at + (factors @ triangles.half[:, -d:, None])[:, :, 0]
    log = triangles.log_evidence(model, grid, variance, samples)
    return Normals(log, means @ principal.axes.T, principal.axes @ factors)


def log_evidences(model: LinearModel, grid: Grid, variance: float, samples: float) -> np.ndarray:
    """Return the log of evidence times prior probability at each of the c points of `grid`, in nats, (c,).

    A grid point is one combination of sizes (prior sds) and correlation lengths of the deviations, which are integrated
    out with the parameters. Damping coefficients may be negative here. The result is the field `log` of
    `score_normals`, which has the same arguments. The search for the mode uses it to choose the most probable grid
    point.
    """
    return _factorised(model, grid, variance)[1].log_evidence(model, grid, variance, samples)


def _factorised(model: LinearModel, grid: Grid, variance: float) -> tuple[_Principal, _Triangles]:
    """Return the model in principal coordinates of its parameters, and factors of the information at each grid point.

    The factors are Cholesky factors. Their last rows belong to the parameters; the rows before belong to the deviations
    g and h, or to g alone if h is already integrated out (`_without_h`). The arguments are those of `score_normals`.
    """
    principal = _Principal.of(model, variance)
    if principal.keeps_digits(grid, variance):
        return principal, _without_h(principal, grid, variance)
    variances = np.full(grid.log_prior.size, variance)
    order = np.roll(np.arange(model.root.shape[1]), -principal.at.size)
    return principal, _Triangles.of(principal, grid, variances, order)


def _without_h(principal: _Principal, grid: Grid, variance: float) -> _Triangles:
    """Factorise the information about g and the parameters at each grid point, with h integrated out.

    g is the deviation of the log damping, and h is the relative deviation of the frequency, both at knots in time. A
    grid point is one combination of their sizes (prior sds) and correlation lengths. This is fast, because h is
    integrated out only once for each combination of its own size and length. variance: variance of the noise, in the
    record's unit squared.
    """
    model, d, n = principal.model, principal.at.size, grid.roots_g.shape[1]
    columns = np.column_stack([model.root[:, d : d + n], model.root[:, :d], model.target])
    of_h, places = grid.of_h
    white = model.root[:, d + n :] @ of_h
    information = np.swapaxes(white, 1, 2) @ white / variance + np.eye(white.shape[2])
    both = np.swapaxes(white, 1, 2) @ columns / variance
    products = columns.T @ columns / variance - np.swapaxes(both, 1, 2) @ np.linalg.solve(information, both)
    # Change from g to coordinates with independent N(0, 1) priors, first for a size of 1 and each correlation length.
    change = np.tile(np.eye(n + d + 1), (len(grid.roots_g), 1, 1))
    change[:, :n, :n] = grid.roots_g
    products = np.swapaxes(change, 1, 2) @ products[:, None] @ change
    products = products[places, grid.length_g]
    # Only the lower triangles are used.
    products[:, :n, :n] *= grid.size_g[:, None, None] ** 2
    products[:, n:, :n] *= grid.size_g[:, None, None]
    triangles = _Triangles.of_products(products, np.concatenate([np.zeros(n), principal.at]))
    return replace(triangles, left=triangles.left + np.linalg.slogdet(information)[1][places])


def linear_posterior(model: LinearModel, grid: Grid, variance: float, samples: float) -> LinearPosterior:
    """Compute the posterior and the evidence of a linear model under white noise.

    The parameters are transformed so that their priors are standard normal (scores). Scores marked in `model.shared`
    have the prior N(0, σ²) instead, with a common scale σ; the evidence is summed over the values `SHARED_SIGMAS` of σ.
    Priors of scores marked in `model.positive` are half-normal: cut off below zero.

    Parameters
    ----------
    model : LinearModel
        The sum of squared residuals, linearised about a motion.
    grid : Grid
        Sizes (prior sds) and correlation lengths of the deviations, over which the evidence is summed too.
    variance : float
        Variance of the noise, in the record's unit squared.
    samples : float
        Effective number N of independent values: n / κ for n values, where κ ≥ 1 is the factor by which correlated
        residuals increase the variance. The log likelihood is −N/2 · log(2π variance) − (sum of squares) / (2
        variance).
    """
    posteriors = score_normals(model, grid, variance, samples)
    posterior = with_priors(posteriors, model.positive, model.shared)
    places = np.flatnonzero(model.damping)
    likelihood = partial(damping_likelihood, posteriors, places, grid.log_prior) if places.size else None
    whole = partial(_whole, model, grid, variance, samples)
    return replace(posterior, whole=whole, damping_likelihood=likelihood)


def _whole(model: LinearModel, grid: Grid, variance: float, samples: float, combos: np.ndarray) -> Normals:
    """Return the normal posteriors of parameters and deviations at the k grid points with the indices `combos`, (k,).

    A grid point is one combination of sizes (prior sds) and correlation lengths of the deviations from the laws. The
    other arguments are those of `normals`.
    """
    return normals(model, grid.only(combos), variance, samples)


def with_priors(posteriors: Normals, positive: np.ndarray, shared: np.ndarray) -> LinearPosterior:
    """Replace the N(0, 1) priors of scores by their actual priors; return the posterior as a mixture.

    A score is a parameter, transformed so that its prior is standard normal. Scores marked in `positive` get
    half-normal priors. Scores marked in `shared` get priors with a common scale σ, whose values `SHARED_SIGMAS` are
    equally probable. The mixture has a component for each grid point (sizes and correlation lengths of the deviations
    from the laws) or, with shared scores, for each pair of grid point and σ that is not negligible. The result has the
    unknowns of `posteriors`, and its `damping_likelihood` is None.

    Parameters
    ----------
    posteriors : Normals
        Posteriors under N(0, 1) priors.
    positive, shared : ndarray of bool, shape (d,)
        Mark the scores that must not be negative, and the scores whose priors have the common scale.
    """
    places = np.flatnonzero(positive)
    scales, combos, log_each = None, np.arange(posteriors.log.size), posteriors.log
    means, factors = posteriors.means[:, places], posteriors.factors[:, places]
    if shared.any():
        scaled = _ScaledPriors.of(posteriors, positive, shared)
        combos, scales = scaled.probable()
        log_each = scaled.log[combos, scales]
        means, factors = scaled.posteriors(combos, scales, places)
    # The densities of k half-normal priors are 2^k times normal ones. Multiply by the probability that all are ≥ 0.
    inside = log_probability(means, factors @ np.swapaxes(factors, 1, 2))
    log_each = log_each + (places.size * np.log(2.0) + inside)
    evidence = float(np.logaddexp.reduce(log_each))
    return LinearPosterior(log_each, evidence, combos, scales, positive, shared, posteriors.only)


@dataclass(frozen=True)
class _ScaledPriors:
    """Normal posteriors for every scale σ of the shared scores, whose prior is N(0, σ²) instead of N(0, 1).

    Shared scores are coefficients, transformed so that their priors are standard normal for σ = 1; σ is the common
    scale of their priors. Let u = mean + F x, with x ~ N(0, I), be the unknowns for σ = 1; the shared scores are then m
    + S x. The other prior adds δ |m + S x|² / 2 to −log p, with δ = 1/σ² − 1. With the singular value decomposition S =
    U D Wᵀ, this changes x only along the k columns of W.

    normals: the posteriors for σ = 1, at c grid points (sizes and correlation lengths of the deviations). inside:
    indices, among the shared scores, of those that must not be negative, (i,). log: log of evidence times prior
    probability, before the cut-off at zero, for each grid point and each of s scales, (c, s). aim: Uᵀ m, (c, k). sizes:
    D, (c, k). left: U, (c, k, k). right: W, (c, K, k). extra: δ, (s,).
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
        left, sizes, right = _singular_values(posteriors.factors[:, shared])
        aim = np.einsum("cij,ci->cj", left, posteriors.means[:, shared])
        extra = 1.0 / SHARED_SIGMAS**2 - 1.0
        shrunk = 1.0 + extra * sizes.T[:, :, None] ** 2
        penalty = np.sum(np.log(shrunk) + extra * aim.T[:, :, None] ** 2 / shrunk, axis=0)
        log = posteriors.log[:, None] - 0.5 * penalty
        log = log - shared.size * np.log(SHARED_SIGMAS) - np.log(SHARED_SIGMAS.size)
        return cls(posteriors, inside, log, aim, sizes, left, np.swapaxes(right, 1, 2), extra)

    def probable(self) -> tuple[np.ndarray, np.ndarray]:
        """Return the pairs of grid point and common prior scale σ with nearly all posterior probability.

        Two arrays contain the indices of the grid points and of the scales, (m,) each. A grid point is one combination
        of sizes (prior sds) and correlation lengths of the deviations from the laws. Two kinds of pairs are left out:
        those whose evidence without the conditions "coefficient ≥ 0" is more than `NEGLIGIBLE` nats below the best, and
        of the others the least probable ones, with a total probability of at most `LEFT_OUT`. These probabilities are
        computed from an upper bound of the evidence (`_bound`), which contains only the least probable condition.
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
        """Return an upper bound of log(evidence × prior), up to a constant, for m pairs of grid point and scale, (m,).

        A grid point is one combination of sizes (prior sds) and correlation lengths of the deviations from the laws.
        The exact value would need the probability that all coefficients are ≥ 0. The bound contains only the
        probability for the one coefficient for which it is smallest. combos, scales: indices of the grid points and of
        the scales, (m,).
        """
        log = self.log[combos, scales]
        if not self.inside.size:
            return log
        sizes, left = self.sizes[combos], self.left[:, self.inside][combos]
        shrunk = 1.0 + self.extra[scales][:, None] * sizes**2
        mean = np.einsum("mij,mj->mi", left, self.aim[combos] / shrunk)
        variance = np.einsum("mij,mj->mi", left**2, sizes**2 / shrunk)
        return log + scipy.special.log_ndtr(mean / np.sqrt(variance)).min(axis=1)

    def posteriors(
        self, combos: np.ndarray, scales: np.ndarray, rows: np.ndarray | slice = slice(None)
    ) -> tuple[np.ndarray, np.ndarray]:
        """Return the normal posteriors for m pairs of grid point and common prior scale, before the cut-off at zero.

        The results are means, (m, K), and factors F of the covariances F Fᵀ, (m, K, K). A grid point is one combination
        of sizes (prior sds) and correlation lengths of the deviations from the laws. combos, scales: indices of the
        grid points and of the scales, (m,). rows: which of the K unknowns to return, by default all.
        """
        sizes, right, extra = self.sizes[combos], self.right[combos], self.extra[scales][:, None]
        factors = self.normals.factors[:, rows][combos]
        shrunk = 1.0 + extra * sizes**2
        along = factors @ right
        move = extra * sizes / shrunk * self.aim[combos]
        means = self.normals.means[:, rows][combos] - (along @ move[:, :, None])[:, :, 0]
        factors = factors + (along * (1 / np.sqrt(shrunk) - 1)[:, None, :]) @ np.swapaxes(right, 1, 2)
        return means, factors


def _singular_values(matrices: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the singular value decompositions U D Wᵀ of c wide matrices: U, (c, k, k), D, (c, k), and Wᵀ, (c, k, K).

    The eigenvectors of the k × k matrices U D² Uᵀ are computed, which is several times faster than LAPACK's
    decomposition of the wide matrices. The latter is used if the squares D² would have fewer than eight digits.
    """
    squares, left = np.linalg.eigh(matrices @ np.swapaxes(matrices, 1, 2))
    if np.any(squares[:, 0] <= LEAST_SQUARE * squares[:, -1]):
        return np.linalg.svd(matrices, full_matrices=False)
    sizes = np.sqrt(squares)
    return left, sizes, np.swapaxes(left, 1, 2) @ matrices / sizes[:, :, None]


def damping_likelihood(posteriors: Normals, places: np.ndarray, log_prior: np.ndarray) -> DampingLikelihood:
    """Compute the likelihood of the damping's parameters at each grid point, with all other unknowns integrated out.

    The parameters are transformed so that their priors are standard normal (scores).

    Parameters
    ----------
    posteriors : Normals
        Posteriors under N(0, 1) priors at each grid point (sizes and correlation lengths of the deviations from the
        laws).
    places : ndarray of int, shape (k,)
        Indices of the damping's scores among the unknowns.
    log_prior : ndarray, shape (c,)
        Log prior probability of each grid point.
    """
    left, sizes, _ = _singular_values(posteriors.factors[:, places])
    # Information of the likelihood in its principal directions: that of the posterior minus that of the prior.
    gained = np.maximum(1.0 / sizes**2 - 1.0, 0.0)
    aim = np.einsum("cij,ci->cj", left, posteriors.means[:, places])
    information = np.einsum("cij,cj,ckj->cik", left, gained, left)
    slope = np.einsum("cij,cj->ci", left, aim / sizes**2)
    log = posteriors.log - log_prior - np.sum(np.log(sizes), axis=1)
    log = log - 0.5 * np.sum((aim / sizes) ** 2, axis=1)
    return DampingLikelihood(log, slope, information)
