"""Recurrent network from a record to its damping (paper, section 3.7).

An LSTM or GRU is trained on simulated records of the same oscillator, at the record's own times: damping drawn evenly
in its logarithm over a wide range about the record's mean decay, noise about the record's own, start and restoring
parameters as known or else about what the record shows. Record and simulations are presented alike: the logarithm of
the amplitude, demodulated over each half-cycle, and its step from the one before. The network answers with
the logarithm of the coefficient. Its first answer sets a narrower range, some times as wide as its error on simulated
records that it has not seen, in which it is trained further; so it goes on until the range is no wider than a few per
cent. (The alternative, a network for the one-step dynamics, has no parameter to be read off directly.)
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
import torch
from pydantic import Field
from torch import Tensor

from bayesdamp.estimators._protocol import Estimator, Options
from bayesdamp.estimators.networks.demodulated import Stretches
from bayesdamp.estimators.networks.record import thinned
from bayesdamp.estimators.networks.training import REAL, generator, single_thread
from bayesdamp.estimators.shared import (
    checked_features,
    free_names,
    noise_level,
    oscillator,
    start_parameters,
)
from bayesdamp.physics.trajectories import Trajectories
from bayesdamp.records.oscillation.features import Features
from bayesdamp.types import Estimate, Problem, Refusal, Signal

MOST_SAMPLES = 2000
MOST_STRETCHES = 48
TOLERANCE = 1e-6
"""Largest error of a simulated record, as a share of the amplitude."""
WIDEST = float(np.log(5.0))
"""Half the first range of the logarithm of the coefficient."""
NARROWEST = float(np.log(1.1))
LEAST_DECAY = 0.01
"""Of the logarithm of the amplitude over the record, where the record itself shows less."""
MOST_ROUNDS = 6
FLOOR = 1e-3
"""Added to amplitudes, as a share of the record's largest, before the logarithm is taken."""


class RnnOptions(Options):
    """cell: of the recurrent layer. units: in it. records: simulated ones in each round; a tenth more are kept apart.

    epochs: passes over them in a round.
    """

    cell: Literal["lstm", "gru"] = "lstm"
    units: int = Field(default=24, ge=2, le=256)
    records: int = Field(default=512, ge=64, le=100_000)
    epochs: int = Field(default=30, ge=1, le=10_000)


class Rnn(Estimator[RnnOptions]):
    """One damping coefficient; its standard error is the network's error on simulated records.

    Free restoring parameters and a free start are those that the record's features show.
    """

    with_parameters = "its network is trained to give one number"
    options = RnnOptions

    def refuses(self, damping: tuple[str, ...]) -> str | None:
        """Sums of terms, and what the network was not trained for."""
        if len(damping) > 1:
            return "the network is trained to give one damping coefficient, not a sum of terms"
        return None

    def initial(
        self, signal: Signal, problem: Problem, options: RnnOptions, rng: np.random.Generator
    ) -> Estimate:
        """The coefficient that a recurrent network reads off the record, trained on simulated ones."""
        seen = checked_features(signal)
        drawn = _Drawn(signal, problem, seen, rng)
        with single_thread():
            network = _Network(options, drawn, generator(rng))
            centre, half, inside = drawn.centre, WIDEST, False
            answers, errors, losses = [], [], []
            for _ in range(MOST_ROUNDS):
                answer, error, loss = network.trained(centre, half)
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
        parameter = drawn.parameter
        value = float(np.exp(answers[-1]))
        values = {parameter: value, **{name: drawn.base[name] for name in free_names(problem)}}
        return Estimate(
            self.name,
            "initial",
            values,
            {parameter: value * errors[-1]},
            {"loss": np.concatenate(losses), parameter: np.exp(answers)},
            {
                "cell": options.cell,
                "range": [float(np.exp(centre - half)), float(np.exp(centre + half))],
                "relative_error": float(errors[-1]),
                "stretches": drawn.stretches.count,
            },
            evaluations=drawn.simulated,
        )


class _Drawn:
    """Simulated records about one record, and both as sequences of amplitudes."""

    def __init__(self, signal: Signal, problem: Problem, seen: Features, rng: np.random.Generator) -> None:
        osc = oscillator(problem)
        (term,) = osc.terms
        self.rng, self.osc, self.parameter = rng, osc, term.parameter
        self.base = start_parameters(signal, problem, seen)
        self.known, self.seen = problem.system.known, seen
        t, y = thinned(signal, seen, MOST_SAMPLES)
        self.size = float(np.abs(seen.turning_amplitudes).max())
        self.sd = noise_level(signal) * np.sqrt(t.size / signal.t.size) / self.size
        self.stretches = Stretches(signal, seen, t, MOST_STRETCHES)
        self.record = self.stretches.quadratures(y[None]) / self.size
        decay = max(float(np.log(seen.amplitude / seen.final_amplitude)), LEAST_DECAY)
        middle = float(np.sqrt(seen.amplitude * seen.final_amplitude))
        ratio = decay / (seen.frequency * float(signal.t[-1]))
        self.centre = float(np.log(ratio / term.ratio_per_unit(middle, seen.frequency)))
        times = np.concatenate([[0.0], t]) if t[0] > 0 else t
        self.drop = times.size - t.size
        self.trajectories = Trajectories(osc, times, signal.quantity, self.base, TOLERANCE * self.size)
        self.simulated = 0

    def quadratures(self, log_coefficient: np.ndarray) -> np.ndarray:
        """(a, b) of simulated records without noise, (m, count, 2), for logarithms of the coefficient (m,)."""
        m, rng, seen = log_coefficient.size, self.rng, self.seen
        given = {name: np.full(m, float(self.base[name])) for name in self.osc.inputs if name in self.base}
        given[self.parameter] = np.exp(log_coefficient)
        free = [name for name in self.osc.law.parameters if name not in self.known]
        # A frequency further off would lose step with the record's phase within a stretch.
        detuned = 0.1 / (np.pi * self.stretches.half_cycles)
        for name in free:
            given[name] = given[name] * (1.0 + 2 * detuned * rng.uniform(-1.0, 1.0, m))
        louder = np.exp(0.2 * rng.uniform(-1.0, 1.0, m))
        for name, rest in (("theta0", seen.rest), ("omega0", 0.0)):
            if name not in self.known:
                given[name] = rest + louder * (given[name] - rest)
        self.simulated += m
        return self.stretches.quadratures(self.trajectories.many(given)[:, self.drop :]) / self.size

    def noise(self, records: int) -> np.ndarray:
        """Noise in (a, b), (records, count, 2), of sizes within a factor of two of the record's."""
        size = self.sd * np.exp(np.log(2.0) * self.rng.uniform(-1.0, 1.0, records))
        return size[:, None, None] * self.stretches.noise(records, self.rng)


def sequence(quadratures: np.ndarray) -> np.ndarray:
    """Logarithm of the amplitude and its steps, (m, count, 2), from (a, b) (m, count, 2)."""
    size = np.log(np.hypot(quadratures[..., 0], quadratures[..., 1]) + FLOOR)
    return np.stack([size, np.diff(size, axis=1, prepend=size[:, :1])], axis=2)


@dataclass
class _Scale:
    """Sequences in units of their spread over the simulated records, stretch by stretch."""

    mean: np.ndarray
    sd: np.ndarray

    def __call__(self, quadratures: np.ndarray) -> Tensor:
        return torch.from_numpy(np.clip((sequence(quadratures) - self.mean) / self.sd, -5.0, 5.0))


class _Network:
    """A recurrent layer and a linear one, trained further in every range."""

    def __init__(self, options: RnnOptions, drawn: _Drawn, random: torch.Generator) -> None:
        self.options, self.drawn, self.random = options, drawn, random
        layer = torch.nn.LSTM if options.cell == "lstm" else torch.nn.GRU
        # The layers draw their own first weights from the process's random numbers: put these back.
        with torch.random.fork_rng(devices=[]):
            self.recurrent = layer(2, options.units, batch_first=True, dtype=REAL)
            self.out = torch.nn.Linear(options.units, 1, dtype=REAL)
        bound = options.units**-0.5
        self.parameters = [*self.recurrent.parameters(), *self.out.parameters()]
        with torch.no_grad():
            for p in self.parameters:
                p.uniform_(-bound, bound, generator=random)

    def answer(self, shown: Tensor) -> Tensor:
        """Where in the range each record lies, −1 to 1, (m,)."""
        return self.out(self.recurrent(shown)[0][:, -1])[:, 0]

    def trained(self, centre: float, half: float) -> tuple[float, float, np.ndarray]:
        """(answer, error, losses): the record's place in the range centre ± half, once trained there."""
        drawn, options = self.drawn, self.options
        every = options.records + max(64, options.records // 10)
        place = drawn.rng.uniform(-1.0, 1.0, every)
        pure = drawn.quadratures(centre + half * place)
        good = np.all(np.isfinite(pure), axis=(1, 2))
        if np.count_nonzero(good) < every // 2:
            raise Refusal("the simulated trajectories escape: there is nothing to train on")
        pure, place = pure[good], place[good]
        train = place.size * options.records // every
        seen = sequence(pure[:train] + drawn.noise(train))
        scale = _Scale(seen.mean(axis=0), seen.std(axis=0) + 1e-9)
        wanted = torch.from_numpy(place)

        size = min(64, train)
        steps = options.epochs * (train // size)
        optimiser = torch.optim.Adam(self.parameters, lr=1e-2)
        rate = torch.optim.lr_scheduler.OneCycleLR(optimiser, max_lr=1e-2, total_steps=steps, pct_start=0.1)
        losses = []
        for _ in range(options.epochs):
            shown = scale(pure[:train] + drawn.noise(train))
            order = torch.randperm(train, generator=self.random)
            total = 0.0
            for rows in order[: train // size * size].split(size):
                optimiser.zero_grad()
                loss = (self.answer(shown[rows]) - wanted[rows]).square().mean()
                loss.backward()
                optimiser.step()
                rate.step()
                total += float(loss.detach())
            losses.append(total / (train // size))
        with torch.no_grad():
            kept = self.answer(scale(pure[train:] + drawn.noise(place.size - train)))
            error = float((kept - wanted[train:]).square().mean().sqrt())
            answer = float(self.answer(scale(drawn.record))[0])
        return answer, error, np.array(losses)


PLUGIN = Rnn()
