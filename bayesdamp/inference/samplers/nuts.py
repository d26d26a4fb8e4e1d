"""The no-U-turn sampler (BlackJAX's), whitened at the mode and compiled once for all records of a shape."""

from __future__ import annotations

import time
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Any

import jax
import numpy as np
from blackjax.mcmc import nuts
from blackjax.mcmc.hmc import HMCState
from jax import Array
from jax import numpy as jnp

from bayesdamp.inference.checks import diagnostics
from bayesdamp.inference.coordinates.shear import Shear, shear_of
from bayesdamp.inference.coordinates.whitening import Whitening, whitening_of
from bayesdamp.inference.fit.mode import Mode
from bayesdamp.inference.model.batches import log_prior
from bayesdamp.inference.model.compiled import compiled
from bayesdamp.inference.model.density import log_posterior
from bayesdamp.inference.model.gradient import value_and_gradient
from bayesdamp.inference.model.linearised import linearised_log_posterior
from bayesdamp.inference.model.target import Context, Layout, Target
from bayesdamp.inference.samplers._reflect import reflecting_leapfrog
from bayesdamp.inference.samplers._sampler import Sampler, Settings
from bayesdamp.inference.samplers._starts import Start, agreement, seeded_starts
from bayesdamp.machine.programs import Program
from bayesdamp.types import OK, Posterior

DOUBLINGS = 7
"""A trajectory has at most 2⁷ steps."""


def chain_of(layout: Layout, count: int, exact: bool):
    """One chain of a layout: (context, force, (centre, factor, shear), step, start, height, key) to draws and so on.

    force: the linearised trajectory, and what its curvature lacks at the centre, (d, d); height: log posterior at the
    start, which the chain does not compute so that the solver is in its program once.
    """
    walls = np.flatnonzero(layout.reflected)

    def chain(
        context: Context,
        force: Any,
        place: tuple[Array, Array, Shear],
        size: Any,
        start: Array,
        height: Any,
        key: Array,
    ):
        (line, lacking), (centre, factor, shear) = force, place

        def scores(u: Array) -> Array:
            return shear.scores(centre + factor @ u)

        # Compiled inside: the sampler's program has them in many places, which then are traced once.
        @jax.jit
        def value(u: Array) -> Array:
            return log_posterior(layout, context, scores(u))

        def surrogate(u: Array) -> Array:
            away = factor @ u
            # A straight line stays one: straightened, the ridge is where it has it.
            there = shear.noise.sheared(shear.level(centre) + away)
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

        # One scan, of which the caller drops the warm-up: the transition is compiled once.
        state = HMCState(start, height, slope(start))
        return jax.lax.scan(advance, state, jax.random.split(key, count))[1]

    return chain


@lru_cache(maxsize=32)
def _chains(layout: Layout, count: int, exact: bool):
    """`chain_of` compiled for all chains of one record: starts and keys have one more axis."""
    chains = jax.vmap(chain_of(layout, count, exact), in_axes=(None,) * 4 + (0, 0, 0))
    return Program(chains, "nuts", layout, count, exact)


STEP = 1.05
"""Step in whitened coordinates: a little more than π/3, so that four points of a circle span half a turn, behind which
a trajectory ends. A shorter step makes it twice as long for draws that are no better."""
POOR = 0.5
"""Mean acceptance below which the force is no good."""
DIVERGING = 0.002
"""And the share of divergences above which; a fifth of that from which the draws are not trusted."""
STEPS = (1.0, 0.5, 0.25, 0.125)
"""Shares of the usual step that the exact force is tried with."""
LONGEST = 3
"""Times the draws that were asked for, from which on none are added."""


def poor(found: Posterior) -> bool:
    """Whether steps or force were not good enough: refusals or divergences."""
    refused = float(np.mean(found.stats["acceptance_rate"])) < POOR
    return refused or float(np.mean(found.stats["diverging"])) > DIVERGING


@dataclass(frozen=True)
class Run:
    """The chains of one record: what they were given, in the order of `chain_of`, and what they left.

    left: positions, heights, divergences, steps and acceptance, (chain, warm-up and draw, ...).
    """

    at: Whitening
    exact: bool
    warmup: int
    begun: list[Start]
    given: tuple[Any, ...]
    left: tuple[np.ndarray, ...]

    @property
    def draws(self) -> int:
        """How many of each chain are kept, without the warm-up."""
        return self.left[0].shape[1] - self.warmup

    def posterior(self, target: Target) -> Posterior:
        """The draws after the warm-up, with their diagnostics."""
        u, height, diverging, steps, accept = (x[:, self.warmup :] for x in self.left)
        z = self.at.scores(u)
        values = {n: v for n, v in target.values(z).items() if n in target.live}
        summaries = {n: diagnostics.summarise(v) for n, v in values.items()}
        divergences = int(np.sum(diverging))
        outcome = diagnostics.verdict(summaries)
        if outcome == OK and divergences > 0.01 * diverging.size:
            outcome = f"{divergences} of {diverging.size} transitions diverged"
        draws = np.stack(list(values.values()), axis=-1)
        return Posterior(
            sampler=Nuts.name,
            names=target.live,
            draws=draws,
            log_likelihood=height - log_prior(target, z),
            stats={"diverging": diverging, "n_steps": steps, "acceptance_rate": accept},
            diagnostics={"exact_force": self.exact, "step": float(self.given[3])},
            outcome=outcome,
            summary=summaries,
            starts=agreement(self.begun, draws),
            divergences=divergences,
            evaluations=int(np.sum(steps)),
        )

    def longer(self, layout: Layout, count: int, seed: int) -> Run:
        """With count more draws of each chain, from where it ended."""
        u, height = self.left[:2]
        key = jax.random.fold_in(jax.random.PRNGKey(seed), u.shape[1])
        keys = jax.random.split(key, u.shape[0])
        more = _chains(layout, count, self.exact)(*self.given[:4], u[:, -1], height[:, -1], keys)
        whole = tuple(np.concatenate(both, axis=1) for both in zip(self.left, more, strict=True))
        return replace(self, left=whole)


class Nuts(Sampler):
    """Hoffman and Gelman's NUTS (JMLR 15, 2014) in whitened coordinates that end where a damping is zero.

    Energies, which decide on acceptance, are exact. The force that moves a proposal may be any function of
    the position (leapfrog steps stay reversible and keep volume), so it is that of the linearised
    trajectory, which costs no tangents. With the whole curvature known the step is too. Draws that are
    too few are added to; where that does not help, or proposals are refused, they are taken again with a curved
    ridge straightened, with shorter steps, and with the exact gradient.
    """

    name = "nuts"

    def sample(self, target: Target, mode: Mode, settings: Settings) -> Posterior:
        """Chains from the mode's neighbourhood, longer or again with other steps where they are not good enough."""
        began = time.perf_counter()
        at = whitening_of(target, mode)
        run = self.attempt(target, mode, at, settings, not at.good)
        found = self.finished(target, mode, settings, run)
        return replace(found, seconds=time.perf_counter() - began)

    def finished(self, target: Target, mode: Mode, settings: Settings, run: Run) -> Posterior:
        """The posterior of the first attempt where that is good enough, else of the next that is."""
        run, found = self._enough(target, settings, run)
        if found.outcome != OK or poor(found):
            ridge = shear_of(target, mode)
            if ridge is not None:
                at = whitening_of(target, mode, ridge)
                run, found = self._enough(
                    target, settings, self.attempt(target, mode, at, settings, not at.good)
                )
        # Shorter steps help the cheap force too where the posterior has edges; only then is the force itself doubted.
        others = [(True, share) for share in STEPS]
        for exact, shorter in others[1:] if run.exact else [(False, 0.5), *others]:
            if not poor(found):
                break
            again = self.attempt(target, mode, run.at, settings, exact, shorter)
            run, found = self._enough(target, settings, again)
        return found

    def attempt(
        self,
        target: Target,
        mode: Mode,
        at: Whitening,
        settings: Settings,
        exact: bool = False,
        shorter: float = 1.0,
    ) -> Run:
        """As many draws as are asked for; shorter: share of the usual step."""
        given, begun = inputs(target, mode, at, settings, shorter)
        left = _chains(target.layout, settings.warmup + settings.draws, exact)(*given)
        return Run(at, exact, settings.warmup, begun, given, jax.tree.map(np.asarray, left))

    def _enough(self, target: Target, settings: Settings, run: Run) -> tuple[Run, Posterior]:
        """The run with draws added while they are too few and might suffice, and its posterior."""
        found, count = run.posterior(target), settings.warmup + settings.draws
        most = LONGEST * settings.draws if settings.grows else settings.draws
        while found.outcome != OK and not poor(found) and run.draws < most:
            run = run.longer(target.layout, count, settings.seed)
            found = run.posterior(target)
        return run, found


def inputs(
    target: Target, mode: Mode, at: Whitening, settings: Settings, shorter: float = 1.0
) -> tuple[tuple[Any, ...], list[Start]]:
    """What the chains of one record are given, in the order of `chain_of`, and where they start."""
    force = (compiled(target.layout).tight(mode.context, at.shear.scores(at.centre)), at.lacking)
    step = np.float64(shorter * STEP)
    start, height, begun = seeded_starts(target, mode, at, settings.chains, settings)
    keys = jax.random.split(jax.random.PRNGKey(settings.seed), settings.chains)
    return (mode.context.compact, force, (at.centre, at.factor, at.shear), step, start, height, keys), begun


PLUGIN = Nuts()
