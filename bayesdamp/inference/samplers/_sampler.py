"""The base class of the samplers, their settings, and where their chains start: over-dispersed about the seeds."""

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

WARMUP = 50
"""Draws that chains need to forget that they start in a linear model."""
SPREAD = 1.5
"""Sds of the scatter around a seed: starts are wider than the posterior even where all seeds agree."""
REACH = 5.0
"""Nats per parameter below the centre from which a chain still reaches the mode."""
SHARES = (1.0, 0.5, 0.25, 0.1, 0.03, 0.0)
"""Shares of the way from the centre to a seed at which a start is tried; the farthest one within reach is used."""


@dataclass(frozen=True)
class Settings:
    """How long to sample.

    Attributes
    ----------
    chains : int
        Number of chains.
    warmup, draws : int
        Draws of each chain that are discarded, and that are returned.
    seed : int
        Of all random numbers.
    grows : bool
        Whether a sampler adds draws where these are too few.
    """

    chains: int = 4
    warmup: int = 500
    draws: int = 1000
    seed: int = 0
    grows: bool = True

    def warmup_of(self, mode: Mode) -> int:
        """Return the warm-up: short where chains start with draws of the linear model, as nothing is adapted."""
        return self.warmup if mode.linear is None else min(self.warmup, WARMUP)


class Sampler(ABC):
    """Draws from the posterior of a target, started and whitened at its mode.

    `approximate` states whether the draws are independent ones of a distribution that only resembles the posterior.
    """

    name: str
    approximate: bool = False

    @abstractmethod
    def sample(self, target: Target, mode: Mode, settings: Settings) -> Posterior:
        """Return draws in natural units with their diagnostics; the outcome says where not to trust them.

        Raises Refusal where the method cannot work on this target.
        """

    def summarised(self, target: Target, mode: Mode, settings: Settings) -> Posterior:
        """Sample, and add the seconds that it took.

        Where the sampler gives no summaries, a summary of each parameter is added, and the outcome of these.
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
    """One chain's start: its seed, and the distances of the seed and of the start from the centre, in sds."""

    seed: Seed
    seed_distance: float
    distance: float


def seeded_starts(
    target: Target, mode: Mode, at: Whitening, count: int, settings: Settings
) -> tuple[np.ndarray, np.ndarray, list[Start]]:
    """Return starts of chains or walkers.

    Each is the start of a seed's climb, scattered by more than the posterior's sd. Where that is out of reach, it is
    moved towards the centre until it is within reach. Seeds that are farthest from each other come first, so that few
    chains cover their spread; one of the first two is a draw from the prior where there is one. Where laws may hold
    approximately, starts are draws of the linear model.

    Parameters
    ----------
    target : Target
        Whose posterior is sampled.
    mode : Mode
        Its mode, with the climbs that led to it.
    at : Whitening
        Its coordinates.
    count : int
        Number of starts.
    settings : Settings
        With the seed of the random numbers.

    Returns
    -------
    u : ndarray, shape (count, d)
        The starts in whitened coordinates.
    height : ndarray, shape (count,)
        Their log posterior.
    starts : list of Start
        Where each is from.
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
    order = _spread_out(seeds, [seed.drawn for seed in given])
    scatter = SPREAD * rng.standard_normal((count, seeds.shape[1]))
    chosen = [order[i % len(order)] for i in range(count)]
    # The last resort but one is the scatter alone, and the last one is the centre.
    tries = np.stack(
        [*(share * seeds[chosen] + scatter for share in SHARES), 0.3 * scatter, np.zeros_like(scatter)]
    )
    z = at.scores(tries)
    z = np.where(reflected, np.abs(z), z)
    height = mode.likelihood.log_posteriors(z.reshape(-1, z.shape[-1])).reshape(z.shape[:2])
    height += at.shear.log_volume(at.shear.straight(z))
    good = height > height[-1, 0] - REACH * z.shape[-1]
    good[-1] = True
    first, each = np.argmax(good, axis=0), np.arange(count)
    u = at.whitened(z[first, each])
    starts = [
        Start(given[c], float(np.linalg.norm(seeds[c])), float(np.linalg.norm(x)))
        for c, x in zip(chosen, u, strict=True)
    ]
    return u, height[first, each], starts


def _spread_out(seeds: np.ndarray, drawn: Sequence[bool]) -> list[int]:
    """Return the order of seeds, (m, d): first the farthest from the centre, then one from the prior, then the others.

    drawn: whether the prior gave each.
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


def agreement(starts: Sequence[Start], draws: np.ndarray) -> tuple[ChainStart, ...]:
    """Return each chain's start with the largest shift of its means from those of all chains, in sds.

    Parameters
    ----------
    starts : sequence of Start
        One for each chain.
    draws : ndarray, shape (chains, draws, d)
        In natural units.
    """
    sd = np.maximum(draws.std(axis=(0, 1)), 1e-300)
    shift = np.abs(draws.mean(axis=1) - draws.mean(axis=(0, 1))) / sd
    return tuple(
        ChainStart(s.seed, s.seed_distance, s.distance, float(v.max()))
        for s, v in zip(starts, shift, strict=True)
    )
