"""Variational inference: the full-rank normal distribution closest to the posterior, in coordinates without walls."""

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

FIRST, SECOND = 0.9, 0.999
"""Decay of Adam's moments (its authors' values)."""
DRAWS = 8
"""Draws for a gradient."""
BLOCK = 50
BLOCKS = 60
RATE = 0.04
SETTLED = 0.1
"""Largest shift between the parameters' means over two blocks of steps (in the sds of the start; of a width, in its
logarithm) at which the step is halved. Training ends once it has been halved often enough."""
HALVINGS = 3


@dataclass(frozen=True)
class Mapped:
    """Scores of points v, with the volume change of the map and its derivatives.

    Attributes
    ----------
    z : ndarray, shape (n, d)
        The scores.
    slopes : ndarray, shape (n, d, d)
        Their derivatives by v.
    log_volume : ndarray, shape (n,)
        Log determinant of the derivatives.
    volume_slopes : ndarray, shape (n, d)
        Derivative of `log_volume` by v.
    """

    z: np.ndarray
    slopes: np.ndarray
    log_volume: np.ndarray
    volume_slopes: np.ndarray


@dataclass(frozen=True)
class Unbounded:
    """A triangular map from v in R^d to the scores (Genz, Journal of Computational and Graphical Statistics 1, 1992).

    It is built from a truncated normal, which a standard normal v becomes; exactly so with at most one wall near.

    Attributes
    ----------
    order : ndarray of int, shape (d,)
        The scores with those at walls first.
    mean, factor : ndarray, shapes (d,) and (d, d)
        Of the normal in this order.
    walls : int
        Number of walls.
    """

    order: np.ndarray
    mean: np.ndarray
    factor: np.ndarray
    walls: int

    @staticmethod
    def of(normal: TruncatedNormal) -> Unbounded:
        """Return the coordinates in which this normal is round."""
        rest = np.setdiff1d(np.arange(normal.mean.size), normal.walls)
        # The wall that truncates most comes first: what it leaves hardly meets the others.
        near = normal.walls[np.argsort((normal.mean / np.sqrt(np.diag(normal.covariance)))[normal.walls])]
        order = np.r_[near, rest].astype(int)
        factor = np.linalg.cholesky(normal.covariance[np.ix_(order, order)])
        return Unbounded(order, normal.mean[order], factor, normal.walls.size)

    def mapped(self, v: np.ndarray) -> Mapped:
        """Map points v, (n, d), to scores.

        At each wall in turn, the normal quantile of v is taken in the part of the conditional normal that lies inside.
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
        return Mapped(z, slopes, log_volume, volume_slopes)


def _hazard(x: np.ndarray) -> np.ndarray:
    """Return φ(x)/Φ(−x) of the standard normal distribution."""
    return np.exp(-0.5 * x**2 - 0.5 * np.log(2 * np.pi) - log_ndtr(-x))


class Variational(Sampler):
    """The normal distribution with the highest evidence lower bound.

    It is found with Adam by full-rank reparameterised gradients that stick the landing (Roeder, Wu and Duvenaud,
    NeurIPS 30, 2017), in coordinates without a wall where a coefficient is zero. There Laplace's approximation is the
    standard normal, where it starts. It has converged where the means of all parameters over two successive blocks of
    steps agree, at four lengths of step; otherwise it refuses.

    A normal that is too wide lowers the bound more than one that is too narrow, so the answer on a posterior that is
    not normal is too narrow: its importance weights show by how much. It needs a thousand gradients and more, and is
    not faster than whitened NUTS.
    """

    name = "variational"
    approximate = True

    def sample(self, target: Target, mode: Mode, settings: Settings) -> Posterior:
        """Return draws of the full-rank normal distribution closest to the posterior, with importance weights."""
        at = Unbounded.of(laplace(target, mode))
        mean, factor, steps, bound = _train(mode, at, settings.seed)
        n, d = settings.chains * settings.draws, mean.size
        normal = np.random.default_rng(settings.seed).standard_normal((n, d))
        points = at.mapped(mean + normal @ factor.T)
        log_density = -0.5 * np.sum(normal**2, axis=1) - points.log_volume
        more = {"steps": steps, "elbo": bound}
        return approximate_posterior(self.name, target, mode, points.z, log_density, settings, more=more)


def _train(mode: Mode, at: Unbounded, seed: int) -> tuple[np.ndarray, np.ndarray, int, float]:
    """Return mean (d,) and factor (d, d) of the normal in the unbounded coordinates, steps, and the bound in nats.

    Raises Refusal where it does not converge.
    """
    d = at.mean.size
    rng = np.random.default_rng(seed)
    # The normal's mean, (d,), the logarithms of its Cholesky factor's diagonal, (d,), and the elements below that, with
    # Adam's moments of the gradient by these (D. P. Kingma and J. Ba, 2015).
    x, first, second = np.zeros((3, 2 * d + d * (d - 1) // 2))
    before, steps, halvings, rate = None, 0, 0, RATE
    for _ in range(BLOCKS):
        trace, bounds = [], []
        for _ in range(BLOCK):
            gradient, bound = _bound_gradient(mode, at, x, rng)
            steps += 1
            first = FIRST * first + (1 - FIRST) * gradient
            second = SECOND * second + (1 - SECOND) * gradient**2
            scale = np.sqrt(second / (1 - SECOND**steps)) + 1e-8
            x = x + rate * (first / (1 - FIRST**steps)) / scale
            trace.append(x)
            bounds.append(bound)
        now = np.mean(trace, axis=0)
        if not np.all(np.isfinite(now)):
            raise Refusal(
                "variational inference met motions that escape: it needs a finite density everywhere it samples"
            )
        if before is not None and np.max(np.abs(now - before)) < SETTLED:
            if halvings == HALVINGS:
                return now[:d], _factor(now, d), steps, float(np.mean(bounds))
            halvings += 1
            rate = RATE * 0.5**halvings
        before = now
    raise Refusal(f"variational inference did not converge in {BLOCKS * BLOCK} steps")


def _bound_gradient(
    mode: Mode, at: Unbounded, x: np.ndarray, rng: np.random.Generator
) -> tuple[np.ndarray, float]:
    """Return estimates of the bound's gradient by a normal's parameters, both (k,), and of the bound in nats."""
    d = at.mean.size
    factor = _factor(x, d)
    normal = rng.standard_normal((DRAWS, d))
    points = at.mapped(x[:d] + normal @ factor.T)
    heights, slopes = zip(*(mode.likelihood.gradient(z) for z in points.z), strict=True)
    if not np.all(np.isfinite(heights)):
        return np.full(x.size, np.nan), np.nan
    pull = np.einsum("ni,nij->nj", np.array(slopes), points.slopes) + points.volume_slopes
    # The gradient of the normal's own density by its parameters has mean zero: without it there is less noise.
    pull = pull + np.linalg.solve(factor.T, normal.T).T
    by_factor = pull.T @ normal / DRAWS
    gradient = np.concatenate(
        [pull.mean(axis=0), np.diag(by_factor) * np.diag(factor), by_factor[np.tril_indices(d, -1)]]
    )
    own = -0.5 * np.sum(normal**2, axis=1) - 0.5 * d * np.log(2 * np.pi) - np.sum(np.log(np.diag(factor)))
    return gradient, float(np.mean(np.array(heights) + points.log_volume - own))


def _factor(x: np.ndarray, d: int) -> np.ndarray:
    """Return the Cholesky factor, (d, d), of a normal's parameters, (k,)."""
    factor = np.diag(np.exp(x[d : 2 * d]))
    factor[np.tril_indices(d, -1)] = x[2 * d :]
    return factor


PLUGIN = Variational()
