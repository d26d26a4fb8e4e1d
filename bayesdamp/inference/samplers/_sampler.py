"""The base class of samplers, their settings, and the starts of chains, which are scattered more than the posterior."""

from __future__ import annotations

import time
from abc import ABC, abstractmethod
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from bayesdamp.inference.diagnostics import summarise, verdict
from bayesdamp.plugins import Plugin
from bayesdamp.types import OK, Posterior

if TYPE_CHECKING:
    from bayesdamp.inference.coordinates import Whitening
    from bayesdamp.inference.mode import Mode
    from bayesdamp.inference.model.target import Target

LINEAR_WARMUP = 50
"""Greatest number of warm-up draws of a chain if the model allows damping and frequency to deviate from their laws. Few
are enough, because chains then start with draws from the posterior of the linearised model, which is close to the
actual one (conventional)."""
START_SCATTER = 1.5
"""A chain starts at a seed (a point from which the mode was searched) plus normal scatter with this standard deviation,
in posterior standard deviations. It is above 1, so that the starts are scattered more widely than the posterior."""
START_NATS = 5.0
"""The log density at the start of a chain is at most this many nats per parameter below that at the centre of the
whitened coordinates, which is near the mode. Starts with a lower density are moved towards the centre
(conventional)."""
SEED_FRACTIONS = (1.0, 0.5, 0.25, 0.1, 0.03, 0.0)
"""Fractions of the way from the centre of the whitened coordinates, near the mode, to a seed (a point from which the
mode was searched). They are tried in this order. A chain starts at the first of these points, plus scatter, whose log
density is large enough."""


@dataclass(frozen=True)
class Settings:
    """Settings of a sampler: numbers of chains and draws, and the seed.

    Attributes
    ----------
    chains : int
        Number of chains (emcee: each of its two ensembles has at least four times as many walkers).
    warmup : int
        Number of first draws of each chain that are discarded (emcee: half of this number); at most
        `LINEAR_WARMUP` if the model allows for deviations from its laws.
    draws : int
        Number of draws of each chain after the warm-up; the smallest number if NUTS continues its chains (`grows`). For
        emcee it is the number of steps of each walker if `grows` is False; otherwise emcee ignores it.
    seed : int
        Seed of all random numbers.
    grows : bool
        True if NUTS and emcee continue, up to a limit, until the chains have converged and the effective number of
        draws is large enough; False for just `draws`. Other samplers may ignore it.
    """

    chains: int = 4
    warmup: int = 500
    draws: int = 1000
    seed: int = 0
    grows: bool = True

    def warmup_of(self, mode: Mode) -> int:
        """Return the number of warm-up draws of each chain (emcee uses half of it).

        It is `warmup`, but at most `LINEAR_WARMUP` if `mode.linear` is given, which is so if the model allows damping
        and frequency to deviate from their laws. Few draws are enough then, because chains start with draws from the
        posterior of the linearised model, and nothing is tuned.
        """
        return self.warmup if mode.linear is None else min(self.warmup, LINEAR_WARMUP)


class Sampler(Plugin, ABC):
    """A method that draws from the posterior of a target (one model with its record and priors), given its mode.

    name: name by which it is selected.
    """

    @abstractmethod
    def sample(self, target: Target, mode: Mode, settings: Settings) -> Posterior:
        """Return posterior draws of the parameters with their diagnostics.

        The outcome of the result is "ok", or says why the draws are unreliable. Raises Refusal if the method cannot be
        applied to this target.
        """

    def sample_and_summarise(self, target: Target, mode: Mode, settings: Settings) -> Posterior:
        """Return the result of `sample`, with summaries of the parameters and with the time that sampling took, in s.

        The arguments are those of `sample`. If the sampler gives draws but no summaries, they are computed for each
        parameter. An outcome "ok" is then replaced by `verdict(summaries)`, which is "ok" or a sentence on the first
        parameter whose chains have not converged or are too short. Raises Refusal like `sample`.
        """
        began = time.perf_counter()
        posterior = replace(self.sample(target, mode, settings), seconds=time.perf_counter() - began)
        if posterior.summaries or not posterior.draws.size:
            return posterior
        columns = zip(posterior.names, np.moveaxis(posterior.draws, -1, 0), strict=True)
        summaries = {n: summarise(x, posterior.ensembles) for n, x in columns}
        outcome = verdict(summaries) if posterior.outcome == OK else posterior.outcome
        return replace(posterior, summaries=summaries, outcome=outcome)


def seeded_starts(
    target: Target, mode: Mode, at: Whitening, count: int, settings: Settings
) -> tuple[np.ndarray, np.ndarray]:
    """Return starting points of chains or walkers, scattered more widely than the posterior.

    A start is a seed plus a normal scatter; the seeds are the points from which the mode was searched. If the log
    density of the start is too low (`START_NATS`), the seed is moved towards the centre of the whitened coordinates; if
    that does not help, the start is the centre itself or close to it. Seeds are used in an order in which each is the
    farthest from those before it, so that even a few chains cover their range; for more starts they are used again. If
    the model allows damping and frequency to deviate from their laws (`Mode.linear`), starts are draws from the
    posterior of the linearised model instead.

    Parameters
    ----------
    target : Target
        The model with its record and priors.
    mode : Mode
        Mode of the posterior, with the searches that found it, whose starts are the seeds.
    at : Whitening
        Whitened coordinates at the mode.
    count : int
        Number of starts.
    settings : Settings
        The settings, of which only the seed of the random numbers is used.

    Returns
    -------
    u : ndarray, shape (count, d)
        The starts in whitened coordinates.
    log_density : ndarray, shape (count,)
        Log posterior density at the starts, in nats, up to a constant: of the whitened coordinates, or of the standard
        normal scores if the starts are draws of the linearised model.
    """
    rng = np.random.default_rng(settings.seed)
    if mode.linear is not None:
        z = mode.linear.draws[rng.choice(len(mode.linear.draws), count, replace=False)]
        return at.whitened(z), mode.likelihood.log_posteriors(z)
    reflected = target.reflected
    origins = [c.origin for c in mode.searches] or [mode.z]
    seeds = at.whitened(np.where(reflected, np.abs(origins), origins))
    far = np.nan_to_num(np.linalg.norm(seeds, axis=1), nan=-1.0)
    order: list[int] = []
    for _ in origins:
        order.append(int(np.argmax(far)))
        gaps = np.linalg.norm(seeds - seeds[order[-1]], axis=1)
        far = np.where(np.isin(np.arange(far.size), order), -2.0, np.fmin(far, gaps))
    scatter = START_SCATTER * rng.standard_normal((count, seeds.shape[1]))
    chosen = [order[i % len(order)] for i in range(count)]
    # The last two tries are a small scatter about the centre, and the centre itself.
    scattered = [fraction * seeds[chosen] + scatter for fraction in SEED_FRACTIONS]
    tries = np.stack([*scattered, 0.3 * scatter, np.zeros_like(scatter)])
    z = at.scores(tries)
    z = np.where(reflected, np.abs(z), z)
    log_density = mode.likelihood.log_posteriors(z.reshape(-1, z.shape[-1])).reshape(z.shape[:2])
    log_density += at.shear.log_volume(at.shear.straight(z))
    good = log_density > log_density[-1, 0] - START_NATS * z.shape[-1]
    good[-1] = True
    first, each = np.argmax(good, axis=0), np.arange(count)
    return at.whitened(z[first, each]), log_density[first, each]
