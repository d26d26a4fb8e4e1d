"""The base class of the methods for the evidence, and the draws that they may start from."""

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

    `outcome` is `ok`, or the sampler's sentence on why not to trust them.
    """

    z: np.ndarray
    outcome: str = OK

    @staticmethod
    def of(target: Target, values: np.ndarray, outcome: str = OK) -> Draws:
        """Return the scores of draws in natural units, (chain, draw, d), in the order of the target's parameters."""
        scores = [np.asarray(p.score(values[..., i])) for i, p in enumerate(target.priors.values())]
        return Draws(np.stack(scores, axis=-1), outcome)


class EvidenceMethod(ABC):
    """A method that computes log ∫ prior · likelihood of one target, in nats.

    `needs_draws` states whether it starts from draws of the posterior, and `approximate` whether it is only right for a
    normal posterior and gives no error.
    """

    name: str
    needs_draws: ClassVar[bool] = False
    approximate: ClassVar[bool] = False

    @abstractmethod
    def evidence(
        self, model: str, target: Target, mode: Mode, seed: int, draws: Draws | None = None
    ) -> Evidence:
        """Return the log evidence with its standard error and a diagnostic of its quality.

        Parameters
        ----------
        model : str
            Name of the model.
        target : Target
            The model on its record.
        mode : Mode
            Its mode.
        seed : int
            Of the random numbers.
        draws : Draws, optional
            Of this posterior. A method that needs draws makes its own where there are none.
        """

    def timed(
        self, model: str, target: Target, mode: Mode, seed: int, draws: Draws | None = None
    ) -> Evidence:
        """Return the same with the seconds that it took."""
        began = time.perf_counter()
        evidence = self.evidence(model, target, mode, seed, draws)
        return replace(evidence, seconds=time.perf_counter() - began)
