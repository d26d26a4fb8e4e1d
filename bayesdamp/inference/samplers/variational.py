"""Variational inference: the normal distribution, with full covariance, that is nearest to the posterior."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.special import log_ndtr, ndtri_exp

from bayesdamp.inference.coordinates.truncated_normal import TruncatedNormal, laplace
from bayesdamp.inference.mode import Mode
from bayesdamp.inference.model.target import Target
from bayesdamp.inference.samplers._approximation import approximate_posterior
from bayesdamp.inference.samplers._sampler import Sampler, Settings
from bayesdamp.types import Posterior, Refusal

FIRST_DECAY, SECOND_DECAY = 0.9, 0.999
"""Decay rates of the running means of the gradient and of its square in Adam (the values of its authors)."""
GRADIENT_DRAWS = 8
"""Number of draws from the fitted normal distribution from which each gradient of the evidence bound is estimated."""
STEPS_PER_BLOCK = 50
"""Number of steps of the optimiser Adam in a block; after each block convergence is checked."""
MOST_BLOCKS = 60
"""Greatest number of blocks of Adam steps; if the optimisation has not converged by then, sampling ends with a
Refusal."""
FIRST_RATE = 0.04
"""First learning rate of the optimiser Adam; it is halved when the parameters settle."""
SETTLED_CHANGE = 0.1
"""If, from one block to the next, the mean values of all parameters of the normal distribution change by less than
this, the learning rate is halved. The parameters are its mean, in standard deviations of Laplace's approximation, and
its Cholesky factor, whose diagonal is logarithmic."""
MOST_HALVINGS = 3
"""Number of times that Adam's learning rate is halved; at the next convergence the optimisation ends."""


@dataclass(frozen=True)
class MappedPoints:
    """Points v, in the coordinates of `UnboundedMap`, mapped to standard normal scores z, with derivatives of the map.

    Attributes
    ----------
    z : ndarray, shape (n, d)
        The scores.
    slopes : ndarray, shape (n, d, d)
        Derivatives of the scores (second axis) by v (third axis).
    log_volume : ndarray, shape (n,)
        Log determinant of the derivatives, by which the log density changes.
    volume_slopes : ndarray, shape (n, d)
        Derivatives of `log_volume` by v.
    """

    z: np.ndarray
    slopes: np.ndarray
    log_volume: np.ndarray
    volume_slopes: np.ndarray


@dataclass(frozen=True)
class UnboundedMap:
    """A map from unbounded coordinates v in R^d to scores, of which some are ≥ 0.

    Scores are parameters transformed to standard normal priors; those of coefficients that cannot be negative have a
    bound (wall) at zero. If v is standard normal, the scores have a given truncated normal distribution: exactly if it
    is close to at most one of its bounds, else nearly.

    Attributes
    ----------
    order : ndarray of int, shape (d,)
        Indices of the scores in the order of v: those with walls (bounds at zero) first.
    mean, factor : ndarray, shapes (d,) and (d, d)
        Mean and Cholesky factor of the covariance of the normal distribution before its truncation, in this order.
    walls : int
        Number of walls.

    References
    ----------
    A. Genz, Journal of Computational and Graphical Statistics 1, 1992.
    """

    order: np.ndarray
    mean: np.ndarray
    factor: np.ndarray
    walls: int

    @staticmethod
    def of(normal: TruncatedNormal) -> UnboundedMap:
        """Return the map under which a standard normal v has (nearly) this truncated normal distribution."""
        rest = np.setdiff1d(np.arange(normal.mean.size), normal.walls)
        # The wall that truncates most comes first: the others then truncate little.
        near = normal.walls[np.argsort((normal.mean / np.sqrt(np.diag(normal.covariance)))[normal.walls])]
        order = np.r_[near, rest].astype(int)
        factor = np.linalg.cholesky(normal.covariance[np.ix_(order, order)])
        return UnboundedMap(order, normal.mean[order], factor, normal.walls.size)

    def to_scores(self, v: np.ndarray) -> MappedPoints:
        """Map points v, (n, d), to standard normal scores, with derivatives of the map.

        For each score with a wall in turn, the standard normal v is replaced by the same quantile of a standard normal
        distribution that is truncated at the wall, given the scores before. Mean and Cholesky factor are then applied.
        """
        n, d = v.shape
        factor = self.factor
        x, by_v = v.copy(), np.tile(np.eye(d), (n, 1, 1))
        log_volume = np.full(n, np.sum(np.log(np.diag(factor))))
        volume_slopes = np.zeros((n, d))
        for j in range(self.walls):
            row = factor[j, :j] / factor[j, j]
            low = -self.mean[j] / factor[j, j] - x[:, :j] @ row
            by_low = -np.einsum("i,nik->nk", row, by_v[:, :j])
            tail = log_ndtr(-low) + log_ndtr(-v[:, j])
            x[:, j] = -ndtri_exp(tail)
            beyond, own = _hazard(low)[:, None], _hazard(v[:, j])[:, None]
            by_tail = -beyond * by_low - own * np.eye(d)[j]
            by_v[:, j] = -by_tail / _hazard(x[:, j])[:, None]
            log_volume += log_ndtr(-low) + 0.5 * (x[:, j] ** 2 - v[:, j] ** 2)
            volume_slopes += -beyond * by_low + x[:, j, None] * by_v[:, j] - v[:, j, None] * np.eye(d)[j]
        z, slopes = np.empty((n, d)), np.empty((n, d, d))
        z[:, self.order] = self.mean + x @ factor.T
        slopes[:, self.order] = factor @ by_v
        return MappedPoints(z, slopes, log_volume, volume_slopes)


def _hazard(x: np.ndarray) -> np.ndarray:
    """Return φ(x)/Φ(−x), the hazard function of the standard normal distribution, at each x."""
    return np.exp(-0.5 * x**2 - 0.5 * np.log(2 * np.pi) - log_ndtr(-x))


class Variational(Sampler):
    """Draws from the normal distribution with the largest evidence lower bound, in the coordinates v of `UnboundedMap`.

    The optimisation starts at Laplace's approximation, which is standard normal in these coordinates, and uses Adam
    with reparameterised gradients without the score term (Roeder, Wu and Duvenaud, NeurIPS 30, 2017). It has converged
    if the means of its parameters over two successive blocks of steps agree, at each of four learning rates.

    For a posterior that is not normal, the result is too narrow; its importance weights show by how much. It needs more
    than a thousand gradients and is not faster than NUTS.
    """

    name = "variational"
    approximate = True

    def sample(self, target: Target, mode: Mode, settings: Settings) -> Posterior:
        """Return draws from the normal distribution with the largest evidence lower bound, and their weights.

        The log importance weights are in the statistics of the result. Raises Refusal if the optimisation does not
        converge, or if Laplace's approximation, its start, does not exist.
        """
        at = UnboundedMap.of(laplace(target, mode))
        mean, factor, steps, bound = _train(mode, at, settings.seed)
        n, d = settings.chains * settings.draws, mean.size
        normal = np.random.default_rng(settings.seed).standard_normal((n, d))
        points = at.to_scores(mean + normal @ factor.T)
        log_density = -0.5 * np.sum(normal**2, axis=1) - points.log_volume
        more = {"steps": steps, "elbo": bound}
        return approximate_posterior(self.name, target, mode, points.z, log_density, settings, more=more)


def _train(mode: Mode, at: UnboundedMap, seed: int) -> tuple[np.ndarray, np.ndarray, int, float]:
    """Optimise the normal distribution in the unbounded coordinates of the map `at`.

    Returns its mean (d,), the Cholesky factor of its covariance (d, d), the number of Adam steps, and the evidence
    lower bound in nats. Raises Refusal if the optimisation does not converge or reaches unbounded motions.
    """
    d = at.mean.size
    rng = np.random.default_rng(seed)
    # x: the mean (d,), the logarithms of the diagonal of the Cholesky factor (d,), and its elements below the diagonal.
    # first, second: Adam's moments of the gradient by these (D. P. Kingma and J. Ba, 2015).
    x, first, second = np.zeros((3, 2 * d + d * (d - 1) // 2))
    before, steps, halvings, rate = None, 0, 0, FIRST_RATE
    for _ in range(MOST_BLOCKS):
        trace, bounds = [], []
        for _ in range(STEPS_PER_BLOCK):
            gradient, bound = _bound_gradient(mode, at, x, rng)
            steps += 1
            first = FIRST_DECAY * first + (1 - FIRST_DECAY) * gradient
            second = SECOND_DECAY * second + (1 - SECOND_DECAY) * gradient**2
            scale = np.sqrt(second / (1 - SECOND_DECAY**steps)) + 1e-8
            x = x + rate * (first / (1 - FIRST_DECAY**steps)) / scale
            trace.append(x)
            bounds.append(bound)
        now = np.mean(trace, axis=0)
        if not np.all(np.isfinite(now)):
            raise Refusal("variational inference reached parameters with unbounded motions; use nuts")
        if before is not None and np.max(np.abs(now - before)) < SETTLED_CHANGE:
            if halvings == MOST_HALVINGS:
                return now[:d], _factor(now, d), steps, float(np.mean(bounds))
            halvings += 1
            rate = FIRST_RATE * 0.5**halvings
        before = now
    raise Refusal(
        f"variational inference did not converge in {MOST_BLOCKS * STEPS_PER_BLOCK} steps; use nuts"
    )


def _bound_gradient(
    mode: Mode, at: UnboundedMap, x: np.ndarray, rng: np.random.Generator
) -> tuple[np.ndarray, float]:
    """Estimate the gradient, (k,), of the evidence lower bound by the parameters x, (k,), and the bound itself in nats.

    Both are nan if a motion is unbounded. x: parameters of the normal distribution: the mean, the logarithms of the
    diagonal of the Cholesky factor of the covariance, and the elements of this factor below the diagonal.
    """
    d = at.mean.size
    factor = _factor(x, d)
    normal = rng.standard_normal((GRADIENT_DRAWS, d))
    points = at.to_scores(x[:d] + normal @ factor.T)
    log_densities, slopes = zip(*(mode.likelihood.gradient(z) for z in points.z), strict=True)
    if not np.all(np.isfinite(log_densities)):
        return np.full(x.size, np.nan), np.nan
    by_points = np.einsum("ni,nij->nj", np.array(slopes), points.slopes) + points.volume_slopes
    # The gradient of the log density of the normal by its parameters (the score term) has mean zero and is left out.
    by_points = by_points + np.linalg.solve(factor.T, normal.T).T
    by_factor = by_points.T @ normal / GRADIENT_DRAWS
    gradient = np.concatenate(
        [by_points.mean(axis=0), np.diag(by_factor) * np.diag(factor), by_factor[np.tril_indices(d, -1)]]
    )
    log_normal = (
        -0.5 * np.sum(normal**2, axis=1) - 0.5 * d * np.log(2 * np.pi) - np.sum(np.log(np.diag(factor)))
    )
    return gradient, float(np.mean(np.array(log_densities) + points.log_volume - log_normal))


def _factor(x: np.ndarray, d: int) -> np.ndarray:
    """Return the Cholesky factor, (d, d), of the covariance of the normal distribution with parameters x, (k,).

    x: as in `_bound_gradient`.
    """
    factor = np.diag(np.exp(x[d : 2 * d]))
    factor[np.tril_indices(d, -1)] = x[2 * d :]
    return factor


PLUGIN = Variational()
