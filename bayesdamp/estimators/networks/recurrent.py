"""A recurrent network that reads a damping coefficient off a record, and the simulated records that train it."""

from __future__ import annotations

from typing import Any

import numpy as np
import torch
from torch import Tensor

from bayesdamp.estimators.networks.record import phase_of, thin_record
from bayesdamp.estimators.networks.training import REAL, generator, single_thread
from bayesdamp.estimators.shared import free_names, noise_level, oscillator, start_parameters
from bayesdamp.physics.trajectories import Trajectories
from bayesdamp.records.oscillation.features import Features
from bayesdamp.types import Estimate, Problem, Refusal, Signal

WIDEST = float(np.log(5.0))
"""Half the first range of the logarithm of the coefficient."""
NARROWEST = float(np.log(1.1))
"""Half the last range."""
MOST_ROUNDS = 6
LEAST_SAMPLES = 5
LEAST_STRETCHES = 3
FEW = 6.0
"""If there are fewer half-cycles, they are cut into quarter cycles."""
MOST_SAMPLES = 2000
MOST_STRETCHES = 48
TOLERANCE = 1e-6
"""Largest error of a simulated record, as a share of the amplitude."""
LEAST_DECAY = 0.01
"""Decay of the logarithm of the amplitude over the record that is assumed if the record itself shows less."""
FLOOR = 1e-3
"""Added to amplitudes, as a share of the record's largest, before the logarithm is taken."""
BATCH = 64
"""Records in a training step."""


class Stretches:
    """Stretches of half a cycle of the record's phase φ.

    They have several half-cycles if there were more than `MOST_STRETCHES`, and a quarter cycle if there are few.
    In each, y = a cos φ + b sin φ about the record's midline, and about the stretch's own if it is half a cycle
    or more, by least squares. The same matrices serve for any record at these times.
    count: stretches that have enough samples. half_cycles: in a stretch. spread: of each, the factor of the covariance
    of (a, b), (2, 2), for white noise of standard deviation 1.
    """

    def __init__(self, signal: Signal, features: Features, t: np.ndarray) -> None:
        phase = phase_of(signal, features)(t)
        total = (phase[-1] - phase[0]) / np.pi
        self.half_cycles = float(max(1, np.ceil(total / MOST_STRETCHES))) if total >= FEW else 0.5
        self.rest = features.rest
        index = ((phase - phase[0]) / (np.pi * self.half_cycles)).astype(int)
        self.rows, self.solvers, self.spread = [], [], []
        for i in range(index[-1] + 1):
            rows = np.flatnonzero(index == i)
            if rows.size < LEAST_SAMPLES or np.ptp(phase[rows]) < 0.6 * np.pi * self.half_cycles:
                continue
            columns = np.stack([np.cos(phase[rows]), np.sin(phase[rows]), np.ones(rows.size)], axis=1)
            solver = np.linalg.pinv(columns[:, : 3 if self.half_cycles >= 1 else 2])[:2]
            self.rows.append(rows)
            self.solvers.append(solver)
            self.spread.append(np.linalg.cholesky(solver @ solver.T))
        self.count = len(self.rows)
        if self.count < LEAST_STRETCHES:
            raise Refusal(
                f"{self.count} stretches of the record have enough samples, and at least {LEAST_STRETCHES} are needed"
            )

    def quadratures(self, y: np.ndarray) -> np.ndarray:
        """Return (a, b) of each stretch of records y (m, n), (m, count, 2)."""
        y = y - self.rest
        return np.stack([y[:, rows] @ solver.T for rows, solver in zip(self.rows, self.solvers)], axis=1)


class Simulator:
    """Simulated records like one record, as sequences of amplitudes.

    parameter: the coefficient. centre: its logarithm as the record's mean decay suggests. record: the record's own
    (a, b) in units of its amplitude, (1, count, 2). simulated: number of records simulated so far.
    """

    def __init__(
        self, signal: Signal, problem: Problem, features: Features, rng: np.random.Generator
    ) -> None:
        osc = oscillator(problem)
        (term,) = osc.terms
        self.rng, self.osc, self.parameter = rng, osc, term.parameter
        self.base = start_parameters(signal, problem, features)
        self.known, self.rest = problem.system.known, features.rest
        t, y = thin_record(signal, features, MOST_SAMPLES)
        self.size = float(np.abs(features.turning_amplitudes).max())
        self.sd = noise_level(signal) * np.sqrt(t.size / signal.t.size) / self.size
        self.stretches = Stretches(signal, features, t)
        self.record = self.stretches.quadratures(y[None]) / self.size
        decay = max(float(np.log(features.amplitude / features.final_amplitude)), LEAST_DECAY)
        middle = float(np.sqrt(features.amplitude * features.final_amplitude))
        ratio = decay / (features.frequency * float(signal.t[-1]))
        self.centre = float(np.log(ratio / term.ratio_per_unit(middle, features.frequency)))
        times = np.concatenate([[0.0], t]) if t[0] > 0 else t
        self.drop = times.size - t.size
        self.trajectories = Trajectories(osc, times, signal.quantity, self.base, TOLERANCE * self.size)
        self.simulated = 0

    def quadratures(self, log_coefficient: np.ndarray) -> np.ndarray:
        """Return (a, b) of simulated records without noise, (m, count, 2), for logarithms of the coefficient (m,)."""
        m, rng = log_coefficient.size, self.rng
        given = {name: np.full(m, float(self.base[name])) for name in self.osc.inputs if name in self.base}
        given[self.parameter] = np.exp(log_coefficient)
        # A frequency further off would lose step with the record's phase within a stretch.
        detuned = 0.1 / (np.pi * self.stretches.half_cycles)
        for name in self.osc.law.parameters:
            if name not in self.known:
                given[name] = given[name] * (1.0 + 2 * detuned * rng.uniform(-1.0, 1.0, m))
        louder = np.exp(0.2 * rng.uniform(-1.0, 1.0, m))
        for name, rest in (("theta0", self.rest), ("omega0", 0.0)):
            if name not in self.known:
                given[name] = rest + louder * (given[name] - rest)
        self.simulated += m
        return self.stretches.quadratures(self.trajectories.many(given)[:, self.drop :]) / self.size

    def noise(self, records: int) -> np.ndarray:
        """Draw noise in (a, b), (records, count, 2), of sizes within a factor of two of the record's."""
        size = self.sd * np.exp(np.log(2.0) * self.rng.uniform(-1.0, 1.0, records))
        white = self.rng.standard_normal((records, self.stretches.count, 2))
        return size[:, None, None] * np.einsum("kij,mkj->mki", np.array(self.stretches.spread), white)


def _sequence(quadratures: np.ndarray) -> np.ndarray:
    """Return the logarithm of the amplitude and its steps, (m, count, 2), from (a, b) (m, count, 2)."""
    size = np.log(np.hypot(quadratures[..., 0], quadratures[..., 1]) + FLOOR)
    return np.stack([size, np.diff(size, axis=1, prepend=size[:, :1])], axis=2)


class RecurrentNetwork:
    """A recurrent layer and a linear one, trained further in every range of the coefficient."""

    def __init__(
        self, simulator: Simulator, random: torch.Generator, cell: str, units: int, records: int, epochs: int
    ) -> None:
        self.simulator, self.random, self.records, self.epochs = simulator, random, records, epochs
        layer = torch.nn.LSTM if cell == "lstm" else torch.nn.GRU
        # The layers draw their own first weights from the process's random numbers: restore these.
        with torch.random.fork_rng(devices=[]):
            self.recurrent = layer(2, units, batch_first=True, dtype=REAL)
            self.out = torch.nn.Linear(units, 1, dtype=REAL)
        bound = units**-0.5
        self.parameters = [*self.recurrent.parameters(), *self.out.parameters()]
        with torch.no_grad():
            for p in self.parameters:
                p.uniform_(-bound, bound, generator=random)

    def _answer(self, sequences: Tensor) -> Tensor:
        """Return where in the range each record lies, −1 to 1, (m,)."""
        return self.out(self.recurrent(sequences)[0][:, -1])[:, 0]

    def train(self, centre: float, half: float) -> tuple[float, float, np.ndarray]:
        """Train in the range centre ± half of the coefficient's logarithm.

        Returns
        -------
        float, float, ndarray
            The record's place in the range, −1 to 1; its root mean square error on simulated records that were not
            trained on; the loss of each epoch.
        """
        simulator = self.simulator
        every = self.records + max(64, self.records // 10)
        place = simulator.rng.uniform(-1.0, 1.0, every)
        pure = simulator.quadratures(centre + half * place)
        good = np.all(np.isfinite(pure), axis=(1, 2))
        if np.count_nonzero(good) < every // 2:
            raise Refusal("the simulated trajectories escape: there is nothing to train on")
        pure, place = pure[good], place[good]
        train = place.size * self.records // every
        first = _sequence(pure[:train] + simulator.noise(train))
        mean, sd = first.mean(axis=0), first.std(axis=0) + 1e-9
        targets = torch.from_numpy(place)

        def scaled(quadratures: np.ndarray) -> Tensor:
            return torch.from_numpy(np.clip((_sequence(quadratures) - mean) / sd, -5.0, 5.0))

        size = min(BATCH, train)
        steps = self.epochs * (train // size)
        optimiser = torch.optim.Adam(self.parameters, lr=1e-2)
        rate = torch.optim.lr_scheduler.OneCycleLR(optimiser, max_lr=1e-2, total_steps=steps, pct_start=0.1)
        losses = []
        for _ in range(self.epochs):
            sequences = scaled(pure[:train] + simulator.noise(train))
            order = torch.randperm(train, generator=self.random)
            total = 0.0
            for rows in order[: train // size * size].split(size):
                optimiser.zero_grad()
                loss = (self._answer(sequences[rows]) - targets[rows]).square().mean()
                loss.backward()
                optimiser.step()
                rate.step()
                total += float(loss.detach())
            losses.append(total / (train // size))
        with torch.no_grad():
            unseen = self._answer(scaled(pure[train:] + simulator.noise(place.size - train)))
            error = float((unseen - targets[train:]).square().mean().sqrt())
            answer = float(self._answer(scaled(simulator.record))[0])
        return answer, error, np.array(losses)


@single_thread()
def train(
    signal: Signal,
    problem: Problem,
    features: Features,
    rng: np.random.Generator,
    *,
    cell: str,
    **settings: Any,
) -> Estimate:
    """Train a recurrent network in narrower and narrower ranges of the coefficient, and read the record's off it.

    Parameters
    ----------
    signal, problem, features
        The record, what is known of its system, and what the record shows.
    rng
        Random numbers of the simulated records and of the training.
    cell, settings
        As `RecurrentNetwork` takes them.

    Raises
    ------
    Refusal
        If the record's damping lies outside of all ranges.
    """
    simulator = Simulator(signal, problem, features, rng)
    network = RecurrentNetwork(simulator, generator(rng), cell, **settings)
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
    parameter, value = simulator.parameter, float(np.exp(answers[-1]))
    values = {parameter: value, **{name: simulator.base[name] for name in free_names(problem)}}
    stderr = {parameter: value * errors[-1]}
    trace = {"loss": np.concatenate(losses), parameter: np.exp(answers)}
    details = {
        "cell": cell,
        "range": [float(np.exp(centre - half)), float(np.exp(centre + half))],
        "relative_error": float(errors[-1]),
        "stretches": simulator.stretches.count,
    }
    count = simulator.simulated
    return Estimate("rnn", "initial", values, stderr, trace, details, evaluations=count)
