"""The base class of the samplers, and their settings."""

from __future__ import annotations

import time
from abc import ABC, abstractmethod
from dataclasses import dataclass, replace

import numpy as np

from bayesdamp.inference.checks import diagnostics
from bayesdamp.inference.fit.mode import Mode
from bayesdamp.inference.model.target import Target
from bayesdamp.types import OK, Posterior

WARMUP = 50
"""Draws that chains need to forget that they start in a linear model."""


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
        summaries = {n: diagnostics.summarise(x, ensembles, effective) for n, x in columns}
        judged = posterior.outcome == OK and effective is None
        outcome = diagnostics.verdict(summaries) if judged else posterior.outcome
        return replace(posterior, summaries=summaries, outcome=outcome)
