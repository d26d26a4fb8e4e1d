"""Variational inference: the full-rank normal distribution closest to the posterior."""

from __future__ import annotations

import time
from functools import lru_cache, partial
from typing import Any

import jax
import numpy as np
import optax
from blackjax.vi import fullrank_vi
from jax import Array
from jax import numpy as jnp

from bayesdamp.inference.coordinates.truncated_normal import laplace
from bayesdamp.inference.coordinates.unbounded import Unbounded, scores
from bayesdamp.inference.fit.mode import Mode
from bayesdamp.inference.model.density import log_posterior
from bayesdamp.inference.model.gradient import value_and_gradient
from bayesdamp.inference.model.target import Context, Layout, Target
from bayesdamp.inference.samplers._approximation import approximate_posterior
from bayesdamp.inference.samplers._sampler import Sampler, Settings
from bayesdamp.types import Posterior, Refusal

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
    """The normal distribution with the highest evidence lower bound, by BlackJAX's full-rank reparameterised gradients
    that stick the landing (Roeder, Wu and Duvenaud, NeurIPS 30, 2017), with Adam.

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
        began = time.perf_counter()
        at = Unbounded.of(laplace(target, mode))
        mean, factor, steps, bound = _train(target, mode, at, settings.seed)
        n, d = settings.chains * settings.draws, mean.size
        normal = np.random.default_rng(settings.seed).standard_normal((n, d))
        v = mean + normal @ factor.T
        place = jnp.asarray(at.mean), jnp.asarray(at.factor)
        z, slope = jax.vmap(partial(scores, walls=at.walls), (0, None, None))(jnp.asarray(v), *place)
        whole = np.empty((n, d))
        whole[:, at.order] = np.asarray(z)
        log_density = -0.5 * np.sum(normal**2, axis=1) - np.asarray(slope)
        more = {"steps": steps, "elbo": bound}
        return approximate_posterior(
            self.name, target, mode, whole, log_density, settings, began=began, more=more
        )


@lru_cache(maxsize=32)
def _block(layout: Layout, walls: int):
    """Compiled for a layout: a block of steps, (context, order, mean, factor, state, key) to the next state and the
    means over the block of the normal's mean, its widths and the bound."""
    optimizer = optax.inject_hyperparams(optax.adam)(learning_rate=RATE)

    @jax.custom_vjp
    def height(context: Context, z: Array) -> Array:
        return log_posterior(layout, context, z)

    # Forward tangents, as everywhere: through a long scan they cost a third of the backward pass.
    def forward(context: Context, z: Array):
        return value_and_gradient(layout, context, z)

    def backward(gradient: Array, cotangent: Array):
        return None, cotangent * gradient

    height.defvjp(forward, backward)

    @jax.jit
    def block(context: Context, order: Array, mean: Array, factor: Array, state: Any, key: Array):
        def density(v: Array) -> Array:
            z, slope = scores(v, mean, factor, walls)
            return height(context, jnp.zeros_like(z).at[order].set(z)) + slope

        def advance(state: Any, key: Array):
            state, info = fullrank_vi.step(key, state, density, optimizer, DRAWS)
            return state, (state.mu, state.chol_params, -jnp.asarray(info.elbo))

        state, trace = jax.lax.scan(advance, state, jax.random.split(key, BLOCK))
        return state, *(jnp.mean(x, axis=0) for x in trace)

    return optimizer, block


def _train(target: Target, mode: Mode, at: Unbounded, seed: int) -> tuple[np.ndarray, np.ndarray, int, float]:
    """Mean (d,) and factor (d, d) of the normal in the unbounded coordinates, steps, and the bound in nats.

    Raises Refusal where it does not settle.
    """
    d = at.mean.size
    optimizer, block = _block(target.layout, at.walls)
    state = fullrank_vi.init(jnp.zeros(d), optimizer)
    place = tuple(map(jnp.asarray, (at.order, at.mean, at.factor)))
    before, halvings = None, 0
    for i, key in enumerate(jax.random.split(jax.random.PRNGKey(seed), BLOCKS)):
        state, mean, widths, bound = block(mode.context.compact, *place, state, key)
        now = np.concatenate([mean, widths])
        if not np.all(np.isfinite(now)):
            raise Refusal(
                "variational inference met motions that escape: it cannot weigh where there is no density"
            )
        if before is not None and np.max(np.abs(now - before)) < SETTLED:
            if halvings == HALVINGS:
                return np.asarray(mean), _factor(np.asarray(widths), d), (i + 1) * BLOCK, float(bound)
            halvings += 1
            state.opt_state.hyperparams["learning_rate"] = jnp.asarray(RATE * 0.5**halvings)
        before = now
    raise Refusal(f"variational inference did not converge in {BLOCKS * BLOCK} steps")


def _factor(widths: np.ndarray, d: int) -> np.ndarray:
    """BlackJAX's flat parameters as a Cholesky factor: logarithms of the diagonal, then what lies below it."""
    factor = np.diag(np.exp(widths[:d]))
    factor[np.tril_indices(d, -1)] = widths[d:]
    return factor


PLUGIN = Variational()
