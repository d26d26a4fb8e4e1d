"""The no-U-turn sampler (NumPyro's), whitened at the mode and compiled once for all records of a shape."""

from __future__ import annotations

import time
from dataclasses import replace
from functools import lru_cache, partial

import jax
import numpy as np
from jax import Array
from jax import numpy as jnp
from numpyro.infer.hmc import hmc

from bayesdamp.inference import diagnostics
from bayesdamp.inference.mode import Mode
from bayesdamp.inference.samplers._sampler import Sampler, Settings, starts
from bayesdamp.inference.target import (
    Context,
    Layout,
    Target,
    linearise,
    linearised_log_posterior,
    log_posterior,
    log_prior,
    value_and_gradient,
)
from bayesdamp.types import OK, Posterior


@lru_cache(maxsize=32)
def _chains(layout: Layout, warmup: int, draws: int, exact: bool):
    """Compiled, all chains of one layout: (context, line, mode, factor, starts, keys) to draws and so on."""

    def potential_of(context: Context, line, z: Array, factor: Array):
        def surrogate(u: Array) -> Array:
            return linearised_log_posterior(layout, context, line, z + factor @ u)

        @jax.custom_vjp
        def potential(u: Array) -> Array:
            return -log_posterior(layout, context, z + factor @ u)

        def forward(u: Array):
            if exact:
                value, gradient = value_and_gradient(layout, context, z + factor @ u)
                return -value, -(factor.T @ gradient)
            return potential(u), -jax.grad(surrogate)(u)

        def backward(gradient: Array, cotangent: Array):
            return (cotangent * gradient,)

        potential.defvjp(forward, backward)
        return potential

    def chain(context: Context, line, z: Array, factor: Array, start: Array, key: Array):
        init, sample = hmc(potential_fn_gen=potential_of, algo="NUTS")
        arguments = (context, line, z, factor)
        state = init(start, warmup, adapt_mass_matrix=False, model_args=arguments, rng_key=key, step_size=0.7)

        def advance(state, _):
            state = sample(state, model_args=arguments)
            kept = (state.z, state.potential_energy, state.diverging, state.num_steps, state.accept_prob)
            return state, kept

        # One scan, the warm-up's draws dropped after it: the transition is compiled once.
        kept = jax.lax.scan(advance, state, None, length=warmup + draws)[1]
        return jax.tree.map(lambda x: x[warmup:], kept)

    lines = jax.jit(partial(linearise, layout))
    return lines, jax.jit(jax.vmap(chain, in_axes=(None, None, None, None, 0, 0)))


POOR = 0.6
"""Mean acceptance below which the linearised force is no good (the step size aims at 0.8)."""


class Nuts(Sampler):
    """Hoffman and Gelman's NUTS (JMLR 15, 2014) on scores whitened by the Gauss–Newton Hessian at the mode.

    Energies, which decide on acceptance, are exact. The force that moves a proposal may be any function of
    the position (leapfrog steps stay reversible and keep volume), so it is that of the linearised
    trajectory, which costs no tangents; where the draws are then not good enough they are taken again with
    the exact gradient.
    """

    name = "nuts"

    def sample(self, target: Target, mode: Mode, settings: Settings) -> Posterior:
        began = time.perf_counter()
        found = self._sample(target, mode, settings, exact=False)
        if float(np.mean(found.stats["acceptance_rate"])) < POOR or int(np.sum(found.stats["diverging"])) > 0:
            found = self._sample(target, mode, settings, exact=True)
        if found.outcome != OK and found.diagnostics["divergences"] == 0:
            longer = replace(settings, draws=3 * settings.draws, seed=settings.seed + 1)
            found = self._sample(target, mode, longer, exact=bool(found.diagnostics["exact_force"]))
        return replace(found, seconds=time.perf_counter() - began)

    def _sample(self, target: Target, mode: Mode, settings: Settings, *, exact: bool) -> Posterior:
        keys = jax.random.split(jax.random.PRNGKey(settings.seed), settings.chains)
        start = starts(mode, settings.chains, settings.seed, spread=1.5)
        lines, run = _chains(target.layout, settings.warmup, settings.draws, exact)
        at = jnp.asarray(mode.z)
        line = lines(mode.context, at)
        u, energy, diverging, steps, accept = run(
            mode.context, line, at, jnp.asarray(mode.factor), jnp.asarray(start), keys
        )
        z = mode.z + np.asarray(u) @ mode.factor.T
        values = target.values(z)
        summaries = {n: diagnostics.summarise(v) for n, v in values.items()}
        prior = np.asarray(jax.vmap(jax.vmap(log_prior))(jnp.asarray(z)))
        divergences = int(np.sum(np.asarray(diverging)))
        outcome = diagnostics.verdict(summaries)
        if outcome == OK and divergences > 0.01 * diverging.size:
            outcome = f"{divergences} of {diverging.size} transitions diverged"
        return Posterior(
            sampler=self.name,
            names=target.names,
            draws=np.stack(list(values.values()), axis=-1),
            log_likelihood=-np.asarray(energy) - prior,
            stats={
                "diverging": np.asarray(diverging),
                "n_steps": np.asarray(steps),
                "acceptance_rate": np.asarray(accept),
            },
            diagnostics={
                "summary": summaries,
                "divergences": divergences,
                "exact_force": exact,
                "likelihoods": int(np.sum(np.asarray(steps))),
            },
            outcome=outcome,
        )


PLUGIN = Nuts()
