"""The base class of samplers, their settings, and over-dispersed starts of their chains."""

from __future__ import annotations

import time
from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from bayesdamp.inference.diagnostics import summarise, verdict
from bayesdamp.types import OK, ChainStart, Posterior, Seed

if TYPE_CHECKING:
    from bayesdamp.inference.coordinates.whitening import Whitening
    from bayesdamp.inference.mode import Mode
    from bayesdamp.inference.model.target import Target

LINEAR_WARMUP = 50
"""Warm-up draws of chains that start with draws of a linear model (conventional)."""
START_SCATTER = 1.5
"""Standard deviation of starts about a seed, in posterior sds: starts are scattered more widely than the posterior."""
START_NATS = 5.0
"""The log density of a start is at most this many nats per parameter below that of the centre (conventional)."""
SEED_FRACTIONS = (1.0, 0.5, 0.25, 0.1, 0.03, 0.0)
"""Fractions of the way from the centre to a seed at which a start is tried; the first one within reach is used."""


@dataclass(frozen=True)
class Settings:
    """Number of chains and draws, and the seed.

    Attributes
    ----------
    chains : int
        Number of chains.
    warmup, draws : int
        Number of draws of each chain that are discarded (emcee: half as many), and that are returned.
    seed : int
        Seed of all random numbers.
    grows : bool
        Whether the sampler adds draws if these are too few.
    """

    chains: int = 4
    warmup: int = 500
    draws: int = 1000
    seed: int = 0
    grows: bool = True

    def warmup_of(self, mode: Mode) -> int:
        """Return the number of warm-up draws: few if chains start with draws of a linear model (nothing is adapted)."""
        return self.warmup if mode.linear is None else min(self.warmup, LINEAR_WARMUP)


class Sampler(ABC):
    """A method that draws from the posterior of a target, starting at its mode.

    `approximate` states whether the draws are independent draws of an approximation of the posterior.
    """

    name: str
    approximate: bool = False

    @abstractmethod
    def sample(self, target: Target, mode: Mode, settings: Settings) -> Posterior:
        """Return draws in natural units with their diagnostics. The outcome reports unreliable draws.

        Raises Refusal if the method cannot be applied to this target.
        """

    def sample_and_summarise(self, target: Target, mode: Mode, settings: Settings) -> Posterior:
        """Return the result of `sample` with its duration.

        If the sampler returns no summaries, add a summary of each parameter, and an outcome that follows from these.
        """
        began = time.perf_counter()
        posterior = self.sample(target, mode, settings)
        posterior = replace(posterior, seconds=time.perf_counter() - began)
        if posterior.summaries or not posterior.draws.size:
            return posterior
        columns = zip(posterior.names, np.moveaxis(posterior.draws, -1, 0), strict=True)
        ensembles, effective = posterior.ensembles, posterior.effective
        summaries = {n: summarise(x, ensembles, effective) for n, x in columns}
        judged = posterior.outcome == OK and effective is None
        outcome = verdict(summaries) if judged else posterior.outcome
        return replace(posterior, summaries=summaries, outcome=outcome)


@dataclass(frozen=True)
class Start:
    """The start of a chain: its seed, and the distances of seed and start from the centre, in posterior sds."""

    seed: Seed
    seed_distance: float
    distance: float


def seeded_starts(
    target: Target, mode: Mode, at: Whitening, count: int, settings: Settings
) -> tuple[np.ndarray, np.ndarray, list[Start]]:
    """Return starts of chains or walkers, over-dispersed about the seeds of the search for the mode.

    A start is a seed plus scatter. If its log density is too low (`START_NATS`), it is moved towards the centre. Seeds
    that are far from each other come first, so that few chains cover their range; one of the first two is a draw from
    the prior, if there is one. With deviations from the laws, starts are draws of the linear model.

    Parameters
    ----------
    target : Target
        The posterior that is sampled.
    mode : Mode
        Mode of the posterior, with the searches that found it.
    at : Whitening
        Whitened coordinates at the mode.
    count : int
        Number of starts.
    settings : Settings
        The settings, with the seed of the random numbers.

    Returns
    -------
    u : ndarray, shape (count, d)
        The starts in whitened coordinates.
    log_density : ndarray, shape (count,)
        Log posterior density of the starts, in whitened coordinates unless they are draws of the linear model.
    starts : list of Start
        Seed and distances of each start.
    """
    rng = np.random.default_rng(settings.seed)
    if mode.linear is not None:
        z = mode.linear.draws[rng.choice(len(mode.linear.draws), count, replace=False)]
        u = at.whitened(z)
        away = np.linalg.norm(u, axis=1).tolist()
        return u, mode.likelihood.log_posteriors(z), [Start(Seed("linear model"), x, x) for x in away]
    reflected = target.reflected
    given = [c.seed for c in mode.searches] or [Seed("mode")]
    origins = [c.origin for c in mode.searches] or [mode.z]
    seeds = at.whitened(np.where(reflected, np.abs(origins), origins))
    order = _order_seeds(seeds, [seed.drawn for seed in given])
    scatter = START_SCATTER * rng.standard_normal((count, seeds.shape[1]))
    chosen = [order[i % len(order)] for i in range(count)]
    # Further tries are a small scatter about the centre, and the centre itself.
    tries = np.stack(
        [
            *(fraction * seeds[chosen] + scatter for fraction in SEED_FRACTIONS),
            0.3 * scatter,
            np.zeros_like(scatter),
        ]
    )
    z = at.scores(tries)
    z = np.where(reflected, np.abs(z), z)
    log_density = mode.likelihood.log_posteriors(z.reshape(-1, z.shape[-1])).reshape(z.shape[:2])
    log_density += at.shear.log_volume(at.shear.straight(z))
    good = log_density > log_density[-1, 0] - START_NATS * z.shape[-1]
    good[-1] = True
    first, each = np.argmax(good, axis=0), np.arange(count)
    u = at.whitened(z[first, each])
    starts = [
        Start(given[c], float(np.linalg.norm(seeds[c])), float(np.linalg.norm(x)))
        for c, x in zip(chosen, u, strict=True)
    ]
    return u, log_density[first, each], starts


def _order_seeds(seeds: np.ndarray, drawn: Sequence[bool]) -> list[int]:
    """Return the order in which seeds, (m, d), are used: far apart first.

    The seed farthest from the centre comes first, then a draw from the prior, then in each step the seed that is
    farthest from all before it. drawn: whether each seed is a draw from the prior.
    """
    size = np.linalg.norm(np.nan_to_num(seeds, nan=0.0, posinf=1e6, neginf=-1e6), axis=1)
    prior = [i for i, from_prior in enumerate(drawn) if from_prior]
    own = [i for i, from_prior in enumerate(drawn) if not from_prior]
    order = sorted(own, key=lambda i: -size[i])[:1] + prior[:1]
    rest = [i for i in range(len(drawn)) if i not in order]
    while rest:
        gaps = np.linalg.norm(seeds[rest][:, None] - seeds[order][None], axis=2).min(axis=1)
        farthest = int(np.argmax(np.nan_to_num(gaps, nan=-1.0)))
        order.append(rest.pop(farthest))
    return order


def compare_chains(starts: Sequence[Start], draws: np.ndarray) -> tuple[ChainStart, ...]:
    """Return for each chain its start, and the largest difference of its means from those of all chains, in sds.

    Parameters
    ----------
    starts : sequence of Start
        Start of each chain.
    draws : ndarray, shape (chains, draws, d)
        Draws in natural units.
    """
    sd = np.maximum(draws.std(axis=(0, 1)), 1e-300)
    shift = np.abs(draws.mean(axis=1) - draws.mean(axis=(0, 1))) / sd
    return tuple(
        ChainStart(s.seed, s.seed_distance, s.distance, float(v.max()))
        for s, v in zip(starts, shift, strict=True)
    )
