"""The no-U-turn sampler (BlackJAX's), whitened at the mode and compiled once for all records of a shape."""

from __future__ import annotations

import time
from dataclasses import replace
from functools import lru_cache
from typing import Any

import jax
import numpy as np
from blackjax.mcmc import nuts
from blackjax.mcmc.hmc import HMCState
from jax import Array
from jax import numpy as jnp

from bayesdamp.inference import diagnostics
from bayesdamp.inference.batches import log_prior
from bayesdamp.inference.bend import Bend, bend
from bayesdamp.inference.compiled import compiled
from bayesdamp.inference.density import log_posterior
from bayesdamp.inference.frame import Frame, frame
from bayesdamp.inference.gradient import value_and_gradient
from bayesdamp.inference.linearised import linearised_log_posterior
from bayesdamp.inference.mode import Mode
from bayesdamp.inference.samplers._reflect import reflecting_leapfrog
from bayesdamp.inference.samplers._sampler import Sampler, Settings
from bayesdamp.inference.samplers._starts import Start, agreement, seeded_starts
from bayesdamp.inference.target import Context, Layout, Target
from bayesdamp.programs import Program
from bayesdamp.types import OK, Posterior

DOUBLINGS = 7
"""A trajectory has at most 2⁷ steps."""


def chain_of(layout: Layout, warmup: int, draws: int, exact: bool):
    """One chain of a layout: (context, force, (centre, factor, bend), step, start, height, key) to draws and so on.

    force: the linearised trajectory, and what its curvature lacks at the centre, (d, d); height: log posterior at the
    start, which the chain does not compute so that the solver is in its program once.
    """
    walls = np.flatnonzero(layout.folded)

    def chain(
        context: Context,
        force: Any,
        place: tuple[Array, Array, Bend],
        size: Any,
        start: Array,
        height: Any,
        key: Array,
    ):
        (line, lacking), (centre, factor, bent) = force, place

        def scores(u: Array) -> Array:
            return bent.scores(centre + factor @ u)

        # Compiled inside: the sampler's program has them in many places, which then are traced once.
        @jax.jit
        def value(u: Array) -> Array:
            return log_posterior(layout, context, scores(u))

        def surrogate(u: Array) -> Array:
            away = factor @ u
            # A straight line stays one: straightened, the ridge is where it has it.
            there = bent.lift.lifted(bent.level(centre) + away)
            there = linearised_log_posterior(layout, context, line, there)
            return there - 0.5 * away @ lacking @ away

        def gradient(u: Array) -> Array:
            z, pull = jax.vjp(scores, u)
            return pull(value_and_gradient(layout, context, z)[1])[0]

        slope = jax.jit(gradient if exact else jax.grad(surrogate))
        kernel = nuts.build_kernel(reflecting_leapfrog(value, slope, factor[walls], centre[walls]))
        whole = jnp.ones(centre.size)

        def advance(state: HMCState, key: Array):
            state, info = kernel(key, state, value, size, whole, DOUBLINGS)
            steps, accepted = info.num_integration_steps, info.acceptance_rate
            return state, (state.position, state.logdensity, info.is_divergent, steps, accepted)

        # One scan, the warm-up's draws dropped after it: the transition is compiled once.
        state = HMCState(start, height, slope(start))
        kept = jax.lax.scan(advance, state, jax.random.split(key, warmup + draws))[1]
        return jax.tree.map(lambda x: x[warmup:], kept)

    return chain


@lru_cache(maxsize=32)
def _chains(layout: Layout, warmup: int, draws: int, exact: bool):
    """`chain_of` compiled for all chains of one record: starts and keys have one more axis."""
    chains = jax.vmap(chain_of(layout, warmup, draws, exact), in_axes=(None,) * 4 + (0, 0, 0))
    return Program(chains, "nuts", layout, warmup, draws, exact)


POOR = 0.5
"""Mean acceptance below which the force is no good."""
SHORTEST = 1 / 8
"""Least share of the usual step that is tried."""


def poor(found: Posterior) -> bool:
    """Whether the force was not good enough: refusals or divergences."""
    return float(np.mean(found.stats["acceptance_rate"])) < POOR or int(np.sum(found.stats["diverging"])) > 0


class Nuts(Sampler):
    """Hoffman and Gelman's NUTS (JMLR 15, 2014) in whitened coordinates that end where a damping is zero.

    Energies, which decide on acceptance, are exact. The force that moves a proposal may be any function of
    the position (leapfrog steps stay reversible and keep volume), so it is that of the linearised
    trajectory, which costs no tangents; where the draws are then not good enough they are taken again, with
    a curved ridge straightened, with the exact gradient, and with shorter steps. With the whole curvature known the
    step is too: 1/d^(1/4).
    """

    name = "nuts"

    def sample(self, target: Target, mode: Mode, settings: Settings) -> Posterior:
        began = time.perf_counter()
        at = frame(target, mode)
        found = self._attempt(target, mode, at, settings, not at.good, 1.0)
        found = self.finished(target, mode, at, settings, found)
        return replace(found, seconds=time.perf_counter() - began)

    def finished(
        self, target: Target, mode: Mode, at: Frame, settings: Settings, found: Posterior
    ) -> Posterior:
        """The first attempt's posterior where that is good enough, else the next that is."""
        if poor(found) or found.outcome != OK:
            ridge = bend(target, mode)
            if ridge is not None:
                at = frame(target, mode, ridge)
                found = self._attempt(target, mode, at, settings, not at.good, 1.0)
        exact, shorter = bool(found.diagnostics["exact_force"]), 1.0
        while poor(found) and shorter > SHORTEST:
            exact, shorter = True, shorter * (0.5 if exact else 1.0)
            found = self._attempt(target, mode, at, settings, exact, shorter)
        if found.outcome != OK and not poor(found):
            longer = replace(settings, draws=3 * settings.draws, seed=settings.seed + 1)
            found = self._attempt(target, mode, at, longer, exact, shorter)
        return found

    def _attempt(
        self, target: Target, mode: Mode, at: Frame, settings: Settings, exact: bool, shorter: float
    ) -> Posterior:
        run = _chains(target.layout, settings.warmup, settings.draws, exact)
        given, begun = inputs(target, mode, at, settings, shorter)
        return posterior_of(target, at, run(*given), begun, exact, float(given[3]))


def inputs(
    target: Target, mode: Mode, at: Frame, settings: Settings, shorter: float = 1.0
) -> tuple[tuple[Any, ...], list[Start]]:
    """What the chains of one record are given, in the order of `chain_of`, and where they start."""
    force = (compiled(target.layout).tight(mode.context, at.bent.scores(at.centre)), at.lacking)
    step = np.float64(shorter * at.centre.size**-0.25)
    start, height, begun = seeded_starts(target, mode, at, settings.chains, settings)
    keys = jax.random.split(jax.random.PRNGKey(settings.seed), settings.chains)
    return (mode.context.lean, force, (at.centre, at.factor, at.bent), step, start, height, keys), begun


def posterior_of(
    target: Target, at: Frame, found: tuple[Any, ...], begun: list[Start], exact: bool, step: float
) -> Posterior:
    """The posterior with its diagnostics from what the chains of one record left."""
    u, height, diverging, steps, accept = found
    z = at.scores(np.asarray(u))
    values = {n: v for n, v in target.values(z).items() if n in target.live}
    summaries = {n: diagnostics.summarise(v) for n, v in values.items()}
    divergences = int(np.sum(np.asarray(diverging)))
    outcome = diagnostics.verdict(summaries)
    if outcome == OK and divergences > 0.01 * diverging.size:
        outcome = f"{divergences} of {diverging.size} transitions diverged"
    draws = np.stack(list(values.values()), axis=-1)
    return Posterior(
        sampler=Nuts.name,
        names=target.live,
        draws=draws,
        log_likelihood=np.asarray(height) - log_prior(z),
        stats={
            "diverging": np.asarray(diverging),
            "n_steps": np.asarray(steps),
            "acceptance_rate": np.asarray(accept),
        },
        diagnostics={
            "summary": summaries,
            "divergences": divergences,
            "exact_force": exact,
            "step": step,
            "likelihoods": int(np.sum(np.asarray(steps))),
            "starts": agreement(begun, draws),
        },
        outcome=outcome,
    )


PLUGIN = Nuts()
