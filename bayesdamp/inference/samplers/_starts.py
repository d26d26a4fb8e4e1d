"""Starts of chains and walkers: the spread of the seeds, over-dispersed."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from bayesdamp.inference.coordinates.whitening import Whitening
from bayesdamp.inference.fit.mode import Mode
from bayesdamp.inference.model.target import Target
from bayesdamp.inference.samplers._sampler import Settings
from bayesdamp.types import ChainStart, Seed

SPREAD = 1.5
"""Sds of the scatter around a seed: starts are wider than the posterior also where all seeds agree."""
REACH = 5.0
"""Nats for each parameter below the centre from which a chain still finds its way."""
SHARES = (1.0, 0.5, 0.25, 0.1, 0.03, 0.0)
"""Shares of the way from the centre to a seed at which a start is tried; the farthest within reach is taken."""


@dataclass(frozen=True)
class Start:
    """One chain's start: the seed it is taken from; how far from the centre that is and the start is, in sds."""

    seed: Seed
    seed_distance: float
    distance: float


def seeded_starts(
    target: Target, mode: Mode, at: Whitening, count: int, settings: Settings
) -> tuple[np.ndarray, np.ndarray, list[Start]]:
    """Starts in whitened coordinates, shape (count, d), their log posterior, (count,), and the seed each is from.

    Each is a seed's own start, scattered by more than the posterior's sd and, where it is out of reach, moved
    towards the centre until it is not. Seeds are taken in turn, those farthest from each other first, so that few
    chains cover their spread; one of the first two is a draw from the prior where there is one. Where laws may hold
    approximately they are draws of the linear model.
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
    # Scatter alone is the last resort but one, the centre itself the last.
    tries = np.concatenate(
        [
            np.stack([share * seeds[chosen] + scatter for share in SHARES]),
            0.3 * scatter[None],
            np.zeros((1, *scatter.shape)),
        ]
    )
    z = at.scores(tries)
    z = np.where(reflected, np.abs(z), z)
    height = mode.likelihood.log_posteriors(z.reshape(-1, z.shape[-1])).reshape(z.shape[:2])
    good = height > height[-1, 0] - REACH * z.shape[-1]
    good[-1] = True
    first = np.argmax(good, axis=0)
    each = np.arange(count)
    u = at.whitened(z[first, each])
    found = [
        Start(given[c], float(np.linalg.norm(seeds[c])), float(np.linalg.norm(x)))
        for c, x in zip(chosen, u, strict=True)
    ]
    return u, height[first, each], found


def _spread_out(seeds: np.ndarray, drawn: Sequence[bool]) -> list[int]:
    """Indices of the seeds (m, d): the first two are the farthest from the centre and one of the prior.

    drawn: whether the prior gave each.
    """
    size = np.linalg.norm(np.nan_to_num(seeds, nan=0.0, posinf=1e6, neginf=-1e6), axis=1)
    prior = [i for i, one in enumerate(drawn) if one]
    own = [i for i, one in enumerate(drawn) if not one]
    order: list[int] = []
    for i in sorted(own, key=lambda i: -size[i])[:1] + prior[:1]:
        order.append(i)
    rest = [i for i in range(len(drawn)) if i not in order]
    while rest:
        gaps = np.linalg.norm(seeds[rest][:, None] - seeds[order][None], axis=2).min(axis=1)
        nearest = int(np.argmax(np.nan_to_num(gaps, nan=-1.0)))
        order.append(rest.pop(nearest))
    return order


def agreement(starts: Sequence[Start], draws: np.ndarray) -> tuple[ChainStart, ...]:
    """What each chain made of its start. draws: of one chain a start, shape (chains, draws, d), in natural units."""
    sd = np.maximum(draws.std(axis=(0, 1)), 1e-300)
    shift = np.abs(draws.mean(axis=1) - draws.mean(axis=(0, 1))) / sd
    return tuple(
        ChainStart(s.seed, s.seed_distance, s.distance, float(v.max()))
        for s, v in zip(starts, shift, strict=True)
    )
