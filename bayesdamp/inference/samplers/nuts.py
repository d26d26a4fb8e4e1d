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
    compiled,
    linearise,
    linearised_log_posterior,
    log_posterior,
    log_prior,
    value_and_gradient,
)
from bayesdamp.types import OK, Posterior


@lru_cache(maxsize=32)
def _chains(layout: Layout, warmup: int, draws: int, exact: bool):
    """Compiled, all chains of one layout: (context, force, mode, factor, starts, keys) to draws and so on.

    force: the linearised trajectory, and what its curvature lacks at the mode, (d, d).
    """

    def potential_of(context: Context, force, z: Array, factor: Array):
        line, lacking = force

        def surrogate(u: Array) -> Array:
            away = factor @ u
            return linearised_log_posterior(layout, context, line, z + away) - 0.5 * away @ lacking @ away

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

    layout_size = len(layout.names)

    def chain(context: Context, force, z: Array, factor: Array, start: Array, key: Array):
        init, sample = hmc(potential_fn_gen=potential_of, algo="NUTS")
        arguments = (context, force, z, factor)
        # With the whole curvature known the step is too: 1/d^(1/4) of the whitened unit. An adaptation would answer
        # refusals that come from the approximate force with ever shorter steps, which do not mend them.
        state = init(
            start,
            warmup,
            step_size=layout_size**-0.25,
            adapt_step_size=exact,
            adapt_mass_matrix=False,
            max_tree_depth=(5, 7),  # type: ignore[arg-type]
            model_args=arguments,
            rng_key=key,
        )

        def advance(state, _):
            state = sample(state, model_args=arguments)
            kept = (state.z, state.potential_energy, state.diverging, state.num_steps, state.accept_prob)
            return state, kept

        # One scan, the warm-up's draws dropped after it: the transition is compiled once.
        kept = jax.lax.scan(advance, state, None, length=warmup + draws)[1]
        return jax.tree.map(lambda x: x[warmup:], kept)

    lines = jax.jit(partial(linearise, layout))
    return lines, jax.jit(jax.vmap(chain, in_axes=(None, None, None, None, 0, 0)))


CHUNK = 250
POOR = 0.5
"""Mean acceptance below which the force is no good."""


def whole_curvature(target: Target, mode: Mode, h: float = 0.3) -> tuple[np.ndarray, Mode]:
    """What the linearised trajectory's curvature lacks at the mode, (d, d), and the mode whitened by the whole.

    By second differences of the log posterior over h whitened units, all in one batch.
    """
    layout, d = target.layout, mode.z.size
    pairs = [(i, j) for i in range(d) for j in range(i, d)]
    corners = np.array(
        [[a * np.eye(d)[i] + b * np.eye(d)[j] for a in (1, -1) for b in (1, -1)] for i, j in pairs]
    )
    points = mode.z + h * corners.reshape(-1, d) @ mode.factor.T
    padded = np.concatenate([points, np.repeat(mode.z[None], -len(points) % CHUNK, axis=0)])
    line = jax.jit(partial(linearise, layout))(mode.context, jnp.asarray(mode.z))
    linear = jax.jit(jax.vmap(partial(linearised_log_posterior, layout, mode.context, line)))

    def hessian(chunks: list[np.ndarray]) -> np.ndarray:
        f = np.concatenate(chunks)[: len(points)].reshape(-1, 4)
        found = np.zeros((d, d))
        for (i, j), v in zip(pairs, -(f[:, 0] - f[:, 1] - f[:, 2] + f[:, 3]) / (4 * h * h), strict=True):
            found[i, j] = found[j, i] = v
        return found

    parts = [jnp.asarray(c) for c in np.split(padded, len(padded) // CHUNK)]
    whole = hessian([np.asarray(compiled(layout).batch(mode.context, c)) for c in parts])
    inverse = np.linalg.inv(mode.factor)
    if not np.all(np.isfinite(whole)):
        return np.zeros((d, d)), mode
    lacking = inverse.T @ (whole - hessian([np.asarray(linear(c)) for c in parts])) @ inverse
    values, vectors = np.linalg.eigh(whole)
    factor = mode.factor @ (vectors / np.sqrt(np.clip(values, 0.1, None)))
    return lacking, replace(mode, factor=factor)


def touches_zero(target: Target, mode: Mode) -> bool:
    """Whether a folded score is within four sds of zero, where the posterior has a kink and no curvature."""
    return bool(np.any(np.asarray(target.layout.folded) & (np.abs(mode.z) < 4 * mode.sd())))


def _poor(found: Posterior) -> bool:
    """Whether the force was not good enough: refusals or divergences."""
    return float(np.mean(found.stats["acceptance_rate"])) < POOR or int(np.sum(found.stats["diverging"])) > 0


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
        none = np.zeros((mode.z.size, mode.z.size))
        lacking, whitened = (none, mode) if touches_zero(target, mode) else whole_curvature(target, mode)
        exact = whitened is mode
        found = self._sample(target, whitened, settings, lacking, exact=exact)
        if not exact and _poor(found):
            lacking, whitened, exact = none, mode, True
            found = self._sample(target, mode, settings, lacking, exact=True)
        if found.outcome != OK and found.diagnostics["divergences"] == 0:
            longer = replace(settings, draws=3 * settings.draws, seed=settings.seed + 1)
            found = self._sample(target, whitened, longer, lacking, exact=exact)
        return replace(found, seconds=time.perf_counter() - began)

    def _sample(
        self, target: Target, mode: Mode, settings: Settings, lacking: np.ndarray, *, exact: bool
    ) -> Posterior:
        keys = jax.random.split(jax.random.PRNGKey(settings.seed), settings.chains)
        start = starts(mode, settings.chains, settings.seed, spread=1.5)
        lines, run = _chains(target.layout, settings.warmup, settings.draws, exact)
        at = jnp.asarray(mode.z)
        force = (lines(mode.context, at), jnp.asarray(lacking))
        u, energy, diverging, steps, accept = run(
            mode.context, force, at, jnp.asarray(mode.factor), jnp.asarray(start), keys
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
