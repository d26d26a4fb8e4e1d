"""Variational inference: the full-rank normal distribution closest to the posterior."""

from __future__ import annotations

import numpy as np

from bayesdamp.inference.coordinates.truncated_normal import laplace
from bayesdamp.inference.coordinates.unbounded import Unbounded
from bayesdamp.inference.fit.mode import Mode
from bayesdamp.inference.model.target import Target
from bayesdamp.inference.samplers._approximation import approximate_posterior
from bayesdamp.inference.samplers._sampler import Sampler, Settings
from bayesdamp.types import Posterior, Refusal

FIRST, SECOND = 0.9, 0.999
"""Decay of Adam's moments (its authors')."""
DRAWS = 8
"""Draws behind a gradient."""
BLOCK = 50
BLOCKS = 60
RATE = 0.04
SETTLED = 0.1
"""Largest shift between the parameters' means over two blocks of steps (in the sds of the start; of a width, in its
logarithm) at which the step is halved, and training ends once it has been halved often enough."""
HALVINGS = 3


class Variational(Sampler):
    """The normal distribution with the highest evidence lower bound, by full-rank reparameterised gradients that
    stick the landing (Roeder, Wu and Duvenaud, NeurIPS 30, 2017), with Adam.

    In coordinates that have no wall where a coefficient is zero and in which Laplace's approximation is the standard
    normal, where it starts. Converged is where the means of all parameters over two successive blocks of steps agree,
    at four lengths of step; else it refuses. The bound is lowered more by a normal that is too wide than by one that
    is too narrow, so a posterior that is not normal comes out too narrow: its importance weights say how much. It needs
    a thousand gradients and more: where NUTS is whitened it is not faster.
    """

    name = "variational"
    approximate = True

    def sample(self, target: Target, mode: Mode, settings: Settings) -> Posterior:
        """Draws of the full-rank normal distribution that is closest to the posterior, weighed by importance."""
        at = Unbounded.of(laplace(target, mode))
        mean, factor, steps, bound = _train(mode, at, settings.seed)
        n, d = settings.chains * settings.draws, mean.size
        normal = np.random.default_rng(settings.seed).standard_normal((n, d))
        there = at.mapped(mean + normal @ factor.T)
        log_density = -0.5 * np.sum(normal**2, axis=1) - there.log_volume
        more = {"steps": steps, "elbo": bound}
        return approximate_posterior(self.name, target, mode, there.z, log_density, settings, more=more)


def _train(mode: Mode, at: Unbounded, seed: int) -> tuple[np.ndarray, np.ndarray, int, float]:
    """Return mean (d,) and factor (d, d) of the normal in the unbounded coordinates, steps, and the bound in nats.

    Raises Refusal where it does not settle.
    """
    d = at.mean.size
    rng = np.random.default_rng(seed)
    # The normal's mean, (d,), logarithms of its Cholesky factor's diagonal, (d,), and what is below that, with Adam's
    # moments of the gradient by these (D. P. Kingma and J. Ba, 2015).
    x, first, second = np.zeros((3, 2 * d + d * (d - 1) // 2))
    before, steps, halvings, rate = None, 0, 0, RATE
    for _ in range(BLOCKS):
        trace, bounds = [], []
        for _ in range(BLOCK):
            gradient, bound = _climbing(mode, at, x, rng)
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
                "variational inference met motions that escape: it cannot weigh where there is no density"
            )
        if before is not None and np.max(np.abs(now - before)) < SETTLED:
            if halvings == HALVINGS:
                return now[:d], _factor(now, d), steps, float(np.mean(bounds))
            halvings += 1
            rate = RATE * 0.5**halvings
        before = now
    raise Refusal(f"variational inference did not converge in {BLOCKS * BLOCK} steps")


def _climbing(mode: Mode, at: Unbounded, x: np.ndarray, rng: np.random.Generator) -> tuple[np.ndarray, float]:
    """Return an estimate of the bound's gradient by a normal's parameters, both (k,), and of the bound in nats."""
    d = at.mean.size
    factor = _factor(x, d)
    normal = rng.standard_normal((DRAWS, d))
    v = x[:d] + normal @ factor.T
    there = at.mapped(v)
    heights, slopes = zip(*(mode.likelihood.gradient(z) for z in there.z), strict=True)
    if not np.all(np.isfinite(heights)):
        return np.full(x.size, np.nan), np.nan
    pull = np.einsum("ni,nij->nj", np.array(slopes), there.slopes) + there.volume_slopes
    # The gradient of the normal's own density by its parameters has mean zero: without it there is less noise.
    pull = pull + np.linalg.solve(factor.T, normal.T).T
    by_factor = pull.T @ normal / DRAWS
    gradient = np.concatenate(
        [pull.mean(axis=0), np.diag(by_factor) * np.diag(factor), by_factor[np.tril_indices(d, -1)]]
    )
    own = -0.5 * np.sum(normal**2, axis=1) - 0.5 * d * np.log(2 * np.pi) - np.sum(np.log(np.diag(factor)))
    return gradient, float(np.mean(np.array(heights) + there.log_volume - own))


def _factor(x: np.ndarray, d: int) -> np.ndarray:
    """Return the Cholesky factor, (d, d), of a normal's parameters, (k,)."""
    factor = np.diag(np.exp(x[d : 2 * d]))
    factor[np.tril_indices(d, -1)] = x[2 * d :]
    return factor


PLUGIN = Variational()
