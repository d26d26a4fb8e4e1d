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
from bayesdamp.estimators.shared import checked_features, free_names
from bayesdamp.types import Estimate, Problem, Refusal, Signal

WIDEST = float(np.log(5.0))
"""Half the first range of the logarithm of the coefficient."""
NARROWEST = float(np.log(1.1))
"""Half the last range."""
MOST_ROUNDS = 6


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
        from bayesdamp.estimators.networks.recurrent import RecurrentNetwork, Simulator
        from bayesdamp.estimators.networks.training import generator, single_thread

        features = checked_features(signal)
        simulator = Simulator(signal, problem, features, rng)
        with single_thread():
            network = RecurrentNetwork(simulator, generator(rng), **options.model_dump())
            centre, half, inside = simulator.centre, WIDEST, False
            answers, errors, losses = [], [], []
            for _ in range(MOST_ROUNDS):
                answer, error, loss = network.train(centre, half)
                losses.append(loss)
                answers.append(centre + half * answer)
                errors.append(half * error)
                inside = abs(answer) < 0.95
                centre += half * float(np.clip(answer, -1.0, 1.0))
                if inside and half <= NARROWEST:
                    break
                half = max(NARROWEST, min(half / 2, 5.0 * half * error)) if inside else half
        if not inside:
            raise Refusal("the record's damping lies outside of all that the network was trained on")
        parameter = simulator.parameter
        value = float(np.exp(answers[-1]))
        values = {parameter: value, **{name: simulator.base[name] for name in free_names(problem)}}
        stderr = {parameter: value * errors[-1]}
        trace = {"loss": np.concatenate(losses), parameter: np.exp(answers)}
        details = {
            "cell": options.cell,
            "range": [float(np.exp(centre - half)), float(np.exp(centre + half))],
            "relative_error": float(errors[-1]),
            "stretches": simulator.stretches.count,
        }
        count = simulator.simulated
        return Estimate(self.name, "initial", values, stderr, trace, details, evaluations=count)


PLUGIN = Rnn()
