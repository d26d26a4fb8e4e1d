"""Recurrent network from a record to its damping (paper, section 3.7).

An LSTM or GRU is trained on simulated records of the same oscillator, at the record's own times: damping drawn evenly
in its logarithm over a wide range about the record's mean decay, noise about the record's own, start and restoring
parameters as known or else about what the record shows. Record and simulations are presented in the same way: the
logarithm of the amplitude, demodulated over each half-cycle, and its step from the one before. The network answers with
the logarithm of the coefficient. Its first answer sets a narrower range, some times as wide as its error on simulated
records that it was not trained on, in which it is trained further; this repeats until the range is no wider than a few
per cent. (The alternative, a network for the one-step dynamics, has no parameter to be read off directly.)
"""

from __future__ import annotations

from typing import Literal

import numpy as np
from pydantic import Field

from bayesdamp.estimators._protocol import Estimator, Options, optional_package
from bayesdamp.estimators.shared import checked_features
from bayesdamp.types import Estimate, Problem, Signal


class RnnOptions(Options):
    """Options of the recurrent network.

    cell: kind of the recurrent layer. units: in it. records: simulated in each round; a tenth more test the network.
    epochs: passes over them in a round.
    """

    cell: Literal["lstm", "gru"] = "lstm"
    units: int = Field(default=24, ge=2, le=256)
    records: int = Field(default=512, ge=64, le=100_000)
    epochs: int = Field(default=30, ge=1, le=10_000)


class Rnn(Estimator[RnnOptions]):
    """One damping coefficient; its standard error is the network's error on simulated records.

    Free restoring parameters and a free start are read off the record's features.
    """

    with_parameters = "its network is trained to give one number"
    options = RnnOptions

    def refuses(self, damping: tuple[str, ...]) -> str | None:
        """Refuse sums of terms, for which the network is not trained."""
        if len(damping) > 1:
            return "the network is trained to give one damping coefficient, not a sum of terms"
        return None

    def initial(
        self, signal: Signal, problem: Problem, options: RnnOptions, rng: np.random.Generator
    ) -> Estimate:
        """Train a recurrent network on simulated records, and let it read the coefficient off the record."""
        optional_package("torch")
        from bayesdamp.estimators.networks.recurrent import train

        return train(signal, problem, checked_features(signal), rng, **options.model_dump())


PLUGIN = Rnn()
