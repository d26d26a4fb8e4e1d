"""Compute with normal distributions in which some coordinates must not be negative.

`log_probability` gives the probability that all coordinates are ≥ 0. `draw` draws under the condition that some are.
`ReflectedT` is a heavy-tailed distribution that is reflected at zero.
"""

from functools import lru_cache
from itertools import product

import numpy as np
import scipy  # loads its modules when they are used

GAUSS_POINTS = {2: 12, 3: 12, 4: 8}
"""Number of Gauss–Legendre nodes for each integral over a coordinate in `log_probability`, by the number of
coordinates. The log evidence of a record, which contains such integrals, is then accurate to 0.003 nats, for four
coordinates to 0.005 (measured; the error is largest where two coordinates are almost perfectly correlated)."""
LEAST_OF_TWO = 1e-8
"""Probability below which rounding makes the closed form for two coordinates inaccurate (its relative error is here
about 1e-8); nested Gauss rules then replace it."""
LATTICE_POINTS = 256
"""Number of points of the lattice over which `log_probability` averages for more coordinates (conventional)."""
JITTER = 1e-9
"""Variances of three or more coordinates are increased by this fraction, so that rounding errors do not matter if some
are perfectly correlated."""
SURE_SDS = 7.0
"""If the mean of every coordinate is at least this many of its standard deviations above zero, the probability that all
coordinates are ≥ 0 is taken as 1 (the error is 1e-12 for each coordinate)."""
PRIMES = np.array([n for n in range(2, 300) if all(n % m for m in range(2, n))], float)
"""Primes whose square roots generate the lattice of `_log_probability_by_lattice`, one for each coordinate."""
T_DEGREES = 7.0
"""Degrees of freedom of the Student t distribution in `ReflectedT` (conventional)."""
_leggauss = lru_cache(np.polynomial.legendre.leggauss)


def log_probability(mean: np.ndarray, covariance: np.ndarray) -> np.ndarray:
    """Return log P(all coordinates ≥ 0), shape (c,), for normals with means (c, k) and covariances (c, k, k).

    It is 0 if k = 0, or if k > 2 and all means are at least `SURE_SDS` standard deviations above zero. For k = 2 it has
    a closed form (`_log_probability_of_two`). For k = 3 and 4 nested Gauss rules are used
    (`_log_probability_by_nodes`), for more (up to 62) a lattice (`_log_probability_by_lattice`).
    """
    count, k = mean.shape
    if k == 0:
        return np.zeros(count)
    if k == 2:
        return _log_probability_of_two(mean, covariance)
    sd = np.sqrt(np.maximum(np.diagonal(covariance, axis1=1, axis2=2), 1e-300))
    if k == 1:
        return scipy.special.log_ndtr(mean[:, 0] / sd[:, 0])
    logs = np.zeros(count)
    unsure = np.any(mean < SURE_SDS * sd, axis=1)
    covariance = covariance + JITTER * np.einsum("cii,ij->cij", covariance, np.eye(k))
    normals = _least_probable_first(mean[unsure], covariance[unsure])
    compute = _log_probability_by_nodes if k in GAUSS_POINTS else _log_probability_by_lattice
    logs[unsure] = compute(*normals, GAUSS_POINTS.get(k, LATTICE_POINTS))
    return logs


def _least_probable_first(mean: np.ndarray, covariance: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return means (c, k) and covariances (c, k, k) of normals, with the coordinate first that is least often ≥ 0."""
    sd = np.sqrt(np.maximum(np.diagonal(covariance, axis1=1, axis2=2), 1e-300))
    order, rows = np.argsort(mean / sd, axis=1), np.arange(len(mean))[:, None]
    return mean[rows, order], covariance[rows[:, :, None], order[:, :, None], order[:, None, :]]


def _log_probability_of_two(mean: np.ndarray, covariance: np.ndarray) -> np.ndarray:
    """Return log P(both coordinates ≥ 0), (…,), of pairs of normals, by Owen's T function.

    The formula is that of D. B. Owen (1956, doi:10.1214/aoms/1177728074). A Gauss rule replaces it where the
    probability is below `LEAST_OF_TWO`. mean: (…, 2). covariance: (…, 2, 2), broadcast to the shape of `mean`.
    """
    sd = np.sqrt(np.maximum(np.diagonal(covariance, axis1=-2, axis2=-1), 1e-300))
    correlation = (covariance[..., 0, 1] / sd.prod(axis=-1))[..., None]
    spread = np.sqrt(np.maximum(1.0 - correlation**2, 1e-300))
    at = np.where(mean == 0.0, 1e-300, mean / sd)
    slopes = (at[..., ::-1] - correlation * at) / (at * spread)
    parts = 0.5 * scipy.special.ndtr(at) - scipy.special.owens_t(at, slopes)
    probability = parts[..., 0] + parts[..., 1] - 0.5 * ((at[..., 0] < 0.0) != (at[..., 1] < 0.0))
    logs = np.log(np.maximum(probability, LEAST_OF_TWO))
    rare = ~(probability >= LEAST_OF_TWO)  # also those that are not a number
    if rare.any():
        covariance = np.broadcast_to(covariance, (*mean.shape, 2))[rare]
        logs[rare] = _log_probability_by_nodes(
            *_least_probable_first(mean[rare], covariance), GAUSS_POINTS[2]
        )
    return logs


def _log_probability_by_nodes(mean: np.ndarray, covariance: np.ndarray, points: int) -> np.ndarray:
    """Return log P(all k ≥ 2 coordinates ≥ 0), (c,), of c normal distributions, by nested Gauss–Legendre rules.

    The first coordinate is integrated over quantiles of its truncated distribution, at `points` nodes; at each node the
    probability of the others is computed (G. J. Gibson, C. A. Glasbey and D. A. Elston, in Advances in Numerical
    Methods and Applications, World Scientific 1994, 120). mean: (c, k). covariance: (c, k, k).
    """
    nodes, weights = _leggauss(points)
    sd = np.sqrt(np.maximum(covariance[:, 0, 0], 1e-300))
    first = scipy.special.log_ndtr(mean[:, 0] / sd)
    at = _quantiles(mean[:, :1], sd[:, None], first[:, None], 0.5 * (nodes + 1))
    # Mean and covariance of the other coordinates, given each value of the first.
    slope = covariance[:, 1:, 0] / covariance[:, :1, 0]
    rest = covariance[:, 1:, 1:] - slope[:, :, None] * covariance[:, None, 0, 1:]
    means = mean[:, None, 1:] + (at - mean[:, :1])[:, :, None] * slope[:, None, :]
    count, _, others = means.shape
    if others == 1:
        inner = scipy.special.log_ndtr(means[:, :, 0] / np.sqrt(np.maximum(rest[:, 0], 1e-300)))
    elif others == 2:
        inner = _log_probability_of_two(means, rest[:, None])
    else:
        each = means.reshape(-1, others), np.repeat(rest, points, axis=0)
        inner = _log_probability_by_nodes(*each, points).reshape(count, points)
    top = inner.max(axis=1, keepdims=True)
    return first + top[:, 0] + np.log(np.exp(inner - top) @ (0.5 * weights))


def _log_probability_by_lattice(mean: np.ndarray, covariance: np.ndarray, points: int) -> np.ndarray:
    """Return log P(all k coordinates ≥ 0), (c,), of c normal distributions, by a lattice rule.

    It is used for many coordinates, for which nested Gauss rules would need too many nodes. mean: (c, k). covariance:
    (c, k, k). The probability is the mean, over a lattice of `points` quantile levels (R. D. Richtmyer 1951),
    of the product of the coordinates' conditional probabilities (Geweke, Hajivassiliou and Keane).
    """
    count, k = mean.shape
    scale = np.sqrt(np.maximum(np.diagonal(covariance, axis1=1, axis2=2), 1e-300))
    part = covariance / (scale[:, :, None] * scale[:, None, :])
    lower, centres = np.linalg.cholesky(part), mean / scale
    levels = np.mod(0.5 + np.arange(1, points + 1)[:, None] * np.sqrt(PRIMES[:k]), 1.0)
    z, log = np.zeros((count, points, k)), np.zeros((count, points))
    for i in range(k):
        centre = centres[:, i, None] + np.einsum("cpj,cj->cp", z[:, :, :i], lower[:, i, :i])
        sd = lower[:, i, i, None]
        inside = scipy.special.log_ndtr(centre / sd)
        log += inside
        if i < k - 1:
            z[:, :, i] = (_quantiles(centre, sd, inside, levels[:, i]) - centre) / sd
    top = log.max(axis=1, keepdims=True)
    return top[:, 0] + np.log(np.mean(np.exp(log - top), axis=1))


def _quantiles(mean: np.ndarray, sd: np.ndarray, inside: np.ndarray, levels: np.ndarray) -> np.ndarray:
    """Return quantiles of normal distributions that are truncated to values ≥ 0.

    mean, sd: means and standard deviations before the truncation. inside: log probabilities of values ≥ 0, before the
    truncation. levels: probabilities in (0, 1) at which the quantiles are computed. The four arrays are broadcast, and
    the result has the common shape.
    """
    return np.maximum(mean - sd * scipy.special.ndtri_exp(np.log1p(-levels) + inside), 0.0)


def draw(
    rng: np.random.Generator,
    mean: np.ndarray,
    factor: np.ndarray,
    places: np.ndarray,
    count: int | np.ndarray,
) -> np.ndarray:
    """Draw from normal distributions under the condition that the coordinates `places` are ≥ 0.

    The constrained coordinates are drawn one after the other from truncated normals, the least likely first (Geweke,
    Hajivassiliou and Keane), and resampled by their importance weights; the others follow by conditioning. The result
    is approximate: there are only four proposals for each requested draw, so a proposal may occur several times.

    Parameters
    ----------
    rng
        Random generator.
    mean
        Mean of each normal, (c, d); for a single normal also (d,).
    factor
        Matrices F, (c, d, d), with the covariances F Fᵀ; for a single normal also (d, d).
    places
        Indices of the coordinates that must not be negative, (k,); if there are none, the draws are unconditional.
    count
        Number of draws from each normal, (c,); for a single normal also an integer.

    Returns
    -------
    np.ndarray
        The draws, (sum of count, d), ordered by normal.
    """
    mean, counts = np.atleast_2d(mean), np.atleast_1d(count)
    factor = factor.reshape(-1, *factor.shape[-2:])
    owner = np.repeat(np.arange(counts.size), counts)
    parts = np.split(rng.standard_normal((owner.size, factor.shape[2])), np.cumsum(counts)[:-1])
    free = mean[owner] + np.concatenate([z @ f.T for z, f in zip(parts, factor, strict=True)])
    if places.size == 0:
        return free
    rows = np.arange(counts.size)[:, None]
    spread = np.einsum("cij,cij->ci", factor, factor)[:, places]
    places = places[np.argsort(mean[:, places] / np.sqrt(spread + 1e-300), axis=1)]  # (c, k)
    # `part` is the covariance of the constrained coordinates, `gain` the regression of all coordinates on them.
    own = factor[rows, places]
    part = own @ np.swapaxes(own, 1, 2)
    part = part + (1e-14 * np.diagonal(part, axis1=1, axis2=2) + 1e-300)[:, :, None] * np.eye(places.shape[1])
    constrained = _truncated_draws(rng, mean[rows, places], np.linalg.cholesky(part), counts)
    gain = np.swapaxes(np.linalg.solve(part, own @ np.swapaxes(factor, 1, 2)), 1, 2)
    at = places[owner]
    off = constrained - np.take_along_axis(free, at, axis=1)
    parts = np.split(off, np.cumsum(counts)[:-1])
    draws = free + np.concatenate([o @ g.T for o, g in zip(parts, gain, strict=True)])
    np.put_along_axis(draws, at, np.maximum(constrained, 0.0), axis=1)
    return draws


def _truncated_draws(
    rng: np.random.Generator, mean: np.ndarray, lower: np.ndarray, counts: np.ndarray
) -> np.ndarray:
    """Return draws, (sum of counts, k), from c normal distributions under the condition that all k coordinates are ≥ 0.

    Four proposals are made for each requested draw, and the draws are resampled from them by importance weights. They
    are ordered by distribution.

    mean: means before the truncation, (c, k). lower: lower Cholesky factors of the covariances, (c, k, k). counts:
    number of draws from each distribution, (c,).
    """
    # `tries` has the index of the distribution for each proposal.
    tries = np.repeat(np.arange(counts.size), 4 * counts)
    z, log_weight = np.zeros((tries.size, mean.shape[1])), np.zeros(tries.size)
    for i in range(mean.shape[1]):
        centre = mean[tries, i] + np.einsum("ni,ni->n", z[:, :i], lower[tries, i, :i])
        sd = lower[tries, i, i]
        inside = scipy.special.log_ndtr(centre / sd)
        log_weight += inside
        z[:, i] = (_quantiles(centre, sd, inside, rng.random(tries.size)) - centre) / sd
    highest = np.full(counts.size, -np.inf)
    np.maximum.at(highest, tries, log_weight)
    weight = np.exp(log_weight - highest[tries])
    weight /= np.bincount(tries, weight)[tries]
    owner = np.repeat(np.arange(counts.size), counts)
    # The weights of each normal sum to 1, so normal number i occupies [i, i + 1) of the cumulative sum.
    chosen = np.searchsorted(np.cumsum(weight), owner + rng.random(owner.size))
    chosen = np.clip(chosen, 4 * (np.cumsum(counts) - counts)[owner], 4 * np.cumsum(counts)[owner] - 1)
    return mean[owner] + np.einsum("nij,nj->ni", lower[owner], z[chosen])


class ReflectedT:
    """A multivariate Student t distribution in which some coordinates are replaced by their absolute values.

    It has `T_DEGREES` degrees of freedom. Samplers and evidence methods use it as a proposal distribution.

    Parameters
    ----------
    centre : ndarray, shape (d,)
        Centre of the distribution before coordinates are replaced.
    factor : ndarray, shape (d, d)
        Lower Cholesky factor of the scale matrix.
    reflected : ndarray of bool, shape (d,)
        Which coordinates are replaced by their absolute values.
    """

    def __init__(self, centre: np.ndarray, factor: np.ndarray, reflected: np.ndarray) -> None:
        self.centre, self.factor, self.reflected = centre, factor, reflected
        d = factor.shape[0]
        self._constant = (
            scipy.special.gammaln(0.5 * (T_DEGREES + d))
            - scipy.special.gammaln(0.5 * T_DEGREES)
            - 0.5 * d * np.log(T_DEGREES * np.pi)
            - np.sum(np.log(np.diag(factor)))
        )
        index = np.flatnonzero(reflected)
        self._signs = np.ones((2**index.size, d))
        self._signs[:, index] = list(product((1.0, -1.0), repeat=index.size))

    def draw(self, rng: np.random.Generator | np.random.RandomState, n: int) -> np.ndarray:
        """Return n independent draws, (n, d); the coordinates in `reflected` are ≥ 0."""
        normal = rng.standard_normal((n, self.factor.shape[0]))
        scale = np.sqrt(T_DEGREES / rng.chisquare(T_DEGREES, n))[:, None]
        z = self.centre + (normal * scale) @ self.factor.T
        return np.where(self.reflected, np.abs(z), z)

    def log_density(self, y: np.ndarray) -> np.ndarray:
        """Return the log density, (n,), at points y, (n, d), whose reflected coordinates are ≥ 0.

        It is the log of the sum of the t densities at y and at all points with other signs of the reflected
        coordinates.
        """
        d = self.factor.shape[0]
        images = (y[None] * self._signs[:, None] - self.centre).reshape(-1, d)
        white = np.linalg.solve(self.factor, images.T)
        kernel = -0.5 * (T_DEGREES + d) * np.log1p(np.sum(white**2, axis=0) / T_DEGREES)
        return self._constant + scipy.special.logsumexp(kernel.reshape(len(self._signs), -1), axis=0)


def fit_reflected_t(y: np.ndarray, reflected: np.ndarray) -> ReflectedT:
    """Fit a `ReflectedT` to draws y, (n, d), by their moments.

    Before the reflection, its t distribution has the mean and the covariance of the draws. reflected: which coordinates
    are reflected, (d,) of bool. Raises LinAlgError if the covariance is not positive definite.
    """
    covariance = np.atleast_2d(np.cov(y.T, ddof=1)) * (T_DEGREES - 2) / T_DEGREES
    return ReflectedT(y.mean(axis=0), np.linalg.cholesky(covariance), reflected)
