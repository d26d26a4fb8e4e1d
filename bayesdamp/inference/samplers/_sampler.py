"""What a sampler is."""

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
    """How long to sample: chains, draws to warm up and to keep in each; the seed of all random numbers. grows: whether
    a sampler adds draws where these are too few."""

    chains: int = 4
    warmup: int = 500
    draws: int = 1000
    seed: int = 0
    grows: bool = True

    def warmup_of(self, mode: Mode) -> int:
        """Return the draws to warm up: few where chains start with draws of the linear model, as nothing is adapted."""
        return self.warmup if mode.linear is None else min(self.warmup, WARMUP)


class Sampler(ABC):
    """Draws from the posterior of a target, started and whitened at its mode.

    approximate: whether the draws are independent ones of a distribution that only resembles the posterior.
    """

    name: str
    approximate: bool = False

    @abstractmethod
    def sample(self, target: Target, mode: Mode, settings: Settings) -> Posterior:
        """Draws in natural units with their diagnostics; the outcome says where not to trust them.

        Raises Refusal where the method cannot work on this target.
        """

    def summarised(self, target: Target, mode: Mode, settings: Settings) -> Posterior:
        """Sample, and add the seconds that it took and, where the sampler has none, a summary of each parameter and the
        verdict of these."""
        began = time.perf_counter()
        found = self.sample(target, mode, settings)
        found = replace(found, seconds=time.perf_counter() - began)
        if found.summaries or not found.draws.size:
            return found
        columns = zip(found.names, np.moveaxis(found.draws, -1, 0), strict=True)
        summary = {n: diagnostics.summarise(x, found.ensembles, found.effective) for n, x in columns}
        judged = found.outcome == OK and found.effective is None
        return replace(
            found, summaries=summary, outcome=diagnostics.verdict(summary) if judged else found.outcome
        )
