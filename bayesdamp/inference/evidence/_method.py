"""What a method for the evidence is."""

from __future__ import annotations

import time
from abc import ABC, abstractmethod
from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np

from bayesdamp.inference.fit.mode import Mode
from bayesdamp.inference.model.target import Target
from bayesdamp.types import OK, Evidence


@dataclass(frozen=True)
class Draws:
    """Posterior draws as scores, shape (chain, draw, d), reflected ones at or above zero.

    outcome: whether the sampler trusts them, `ok` or a sentence.
    """

    z: np.ndarray
    outcome: str = OK

    @staticmethod
    def of(target: Target, values: np.ndarray, outcome: str = OK) -> Draws:
        """Return the scores of draws in natural units, (chain, draw, d), in the order of the target's parameters."""
        scores = [np.asarray(p.score(values[..., i])) for i, p in enumerate(target.priors.values())]
        return Draws(np.stack(scores, axis=-1), outcome)


class EvidenceMethod(ABC):
    """log ∫ prior · likelihood of one target, in nats.

    needs_draws: whether it starts from draws of the posterior; approximate: whether it is only right for a normal
    posterior, and gives no error.
    """

    name: str
    needs_draws: ClassVar[bool] = False
    approximate: ClassVar[bool] = False

    @abstractmethod
    def evidence(
        self, model: str, target: Target, mode: Mode, seed: int, draws: Draws | None = None
    ) -> Evidence:
        """The log evidence with its standard error and the diagnostic by which it may be trusted.

        draws: of this posterior, where there are some; a method that needs draws takes its own where there are none.
        """

    def timed(
        self, model: str, target: Target, mode: Mode, seed: int, draws: Draws | None = None
    ) -> Evidence:
        """Return the same with the seconds that it took."""
        began = time.perf_counter()
        found = self.evidence(model, target, mode, seed, draws)
        return replace(found, seconds=time.perf_counter() - began)
