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

from dataclasses import dataclass
from typing import Literal, NamedTuple

import numpy as np
from pydantic import Field

from bayesdamp.estimators._protocol import Estimator, Options
from bayesdamp.estimators.networks import descend, phase_of
from bayesdamp.estimators.shared import (
    checked_features,
    free_names,
    noise_level,
    oscillator,
    start_parameters,
    thin_record,
)
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
PATIENCE = 4
"""Rounds without a smaller error on other records after which a training ends."""
COPIES = 4
"""Times that each simulated record is presented, each with other noise."""


class RnnOptions(Options):
    """Options of the recurrent network.

    cell: kind of the recurrent layer. units: in it. records: simulated in each round; a tenth more test the network.
    epochs: most training steps in a round, each with all of them.
    """

    cell: Literal["lstm", "gru"] = "lstm"
    units: int = Field(default=6, ge=2, le=256)
    records: int = Field(default=192, ge=64, le=100_000)
    epochs: int = Field(default=20, ge=1, le=10_000)


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
        """Train a network in narrower and narrower ranges of the coefficient, and read the record's off it."""
        simulator = Simulator(signal, problem, checked_features(signal), rng)
        network = RecurrentNetwork(options.cell, options.units)
        weights = network.draw(rng)
        centre, half, inside = simulator.centre, WIDEST, False
        answers, errors, losses = [], [], []
        for _ in range(MOST_ROUNDS):
            weights, loss, answer, error = _train_in_range(network, weights, simulator, options, centre, half)
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
            "cell": options.cell,
            "range": [float(np.exp(centre - half)), float(np.exp(centre + half))],
            "relative_error": float(errors[-1]),
            "stretches": simulator.stretches.count,
        }
        return Estimate(self.name, "initial", values, stderr, trace, details, evaluations=simulator.simulated)


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


class Step(NamedTuple):
    """A recurrent layer after a step of m sequences: its state, memory (of an LSTM) and gates, each (units, m)."""

    state: np.ndarray
    memory: np.ndarray
    gates: tuple[np.ndarray, ...]


@dataclass(frozen=True)
class RecurrentNetwork:
    """A recurrent layer over sequences, and a linear one from its last state to the answer.

    cell: "lstm" (Hochreiter & Schmidhuber 1997, with the forget gate of Gers, Schmidhuber & Cummins 2000) or "gru" (Cho
    and others 2014). units: in the recurrent layer. inputs: numbers in each step of a sequence.
    """

    cell: str
    units: int
    inputs: int = 2

    @property
    def gates(self) -> int:
        """Rows of the recurrent layer's matrix, which it applies to (inputs, state, 1)."""
        return (4 if self.cell == "lstm" else 3) * self.units

    def draw(self, rng: np.random.Generator) -> np.ndarray:
        """Draw first weights (k,) evenly between ±1/√units: the matrix, then the linear layer."""
        count = self.gates * (self.inputs + self.units + 1) + self.units + 1
        return rng.uniform(-1.0, 1.0, count) / self.units**0.5

    def answers(self, weights: np.ndarray, sequences: np.ndarray) -> np.ndarray:
        """Return the answer (m,) to each sequence (m, steps, inputs)."""
        return self._forward(weights, sequences)[0]

    def slopes(self, weights: np.ndarray, sequences: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return the answers (m,), and their derivatives by the weights, (m, k), by backpropagation through time."""
        answers, fed, steps = self._forward(weights, sequences)
        matrix, out = self._split(weights)
        u, m = self.units, answers.size
        of_state = matrix[:, self.inputs : -1]
        by_out = np.concatenate([steps[-1].state, np.ones((1, m))])
        by_state = np.repeat(out[:-1, None], m, axis=1)
        by_memory = np.zeros_like(by_state)
        by_gates = np.empty((len(steps), self.gates, m))
        for t in reversed(range(len(steps))):
            by, step = by_gates[t], steps[t]
            if self.cell == "lstm":
                i, f, o, g = step.gates
                bent = np.tanh(step.memory)
                by_memory = by_memory + by_state * o * (1.0 - bent**2)
                before = steps[t - 1].memory if t else np.zeros((u, m))
                by[:u] = by_memory * g * i * (1.0 - i)
                by[u : 2 * u] = by_memory * before * f * (1.0 - f)
                by[2 * u : 3 * u] = by_state * bent * o * (1.0 - o)
                by[3 * u :] = by_memory * i * (1.0 - g**2)
                by_memory = by_memory * f
                by_state = of_state.T @ by
            else:
                z, r, n = step.gates
                before = fed[t, self.inputs : -1]
                by[2 * u :] = by_state * (1.0 - z) * (1.0 - n**2)
                by_reset = of_state[2 * u :].T @ by[2 * u :]
                by[:u] = by_state * (before - n) * z * (1.0 - z)
                by[u : 2 * u] = by_reset * before * r * (1.0 - r)
                by_state = by_state * z + by_reset * r + of_state[: 2 * u].T @ by[: 2 * u]
        by_gates, fed = by_gates.transpose(2, 1, 0), fed.transpose(2, 0, 1)
        by_matrix = by_gates @ fed
        if self.cell == "gru":  # the state that its last gate is fed is reset
            reset = np.stack([step.gates[1] for step in steps]).transpose(2, 0, 1)
            by_matrix[:, 2 * u :, self.inputs : -1] = by_gates[:, 2 * u :] @ (
                reset * fed[..., self.inputs : -1]
            )
        return answers, np.concatenate([by_matrix.reshape(m, -1), by_out.T], axis=1)

    def _split(self, weights: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        end = weights.size - self.units - 1
        return weights[:end].reshape(self.gates, -1), weights[end:]

    def _forward(
        self, weights: np.ndarray, sequences: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, list[Step]]:
        """Return the answers (m,), what each step is fed, (steps, inputs + units + 1, m), and the steps."""
        matrix, out = self._split(weights)
        u, (m, count, _) = self.units, sequences.shape
        fed = np.ones((count, self.inputs + u + 1, m))
        fed[:, : self.inputs] = sequences.transpose(1, 2, 0)
        state = memory = np.zeros((u, m))
        steps = []
        for column in fed:
            column[self.inputs : -1] = state
            if self.cell == "lstm":
                sums = matrix @ column
                i, f, o = _sigmoid(sums[: 3 * u]).reshape(3, u, m)
                g = np.tanh(sums[3 * u :])
                memory = f * memory + i * g
                state, gates = o * np.tanh(memory), (i, f, o, g)
            else:
                z, r = _sigmoid(matrix[: 2 * u] @ column).reshape(2, u, m)
                reset = column.copy()
                reset[self.inputs : -1] *= r
                n = np.tanh(matrix[2 * u :] @ reset)
                state, gates = (1.0 - z) * n + z * state, (z, r, n)
            steps.append(Step(state, memory, gates))
        return out[:-1] @ state + out[-1], fed, steps


def _sigmoid(x: np.ndarray) -> np.ndarray:
    return 0.5 + 0.5 * np.tanh(0.5 * x)


def _train_in_range(
    network: RecurrentNetwork,
    weights: np.ndarray,
    simulator: Simulator,
    options: RnnOptions,
    centre: float,
    half: float,
) -> tuple[np.ndarray, list[float], float, float]:
    """Train a network further, in the range centre ± half of the coefficient's logarithm.

    The training ends when the error on other simulated records has not fallen for `PATIENCE` rounds.

    Returns
    -------
    ndarray, list of float, float, float
        The weights with the smallest error on the other records; the loss of each round; the record's place in the
        range, −1 to 1; the root mean square error of the place of the other records.
    """
    every = options.records + max(64, options.records // 10)
    place = simulator.rng.uniform(-1.0, 1.0, every)
    pure = simulator.quadratures(centre + half * place)
    good = np.all(np.isfinite(pure), axis=(1, 2))
    if np.count_nonzero(good) < every // 2:
        raise Refusal("the simulated trajectories escape: there is nothing to train on")
    pure, place = np.repeat(pure[good], COPIES, axis=0), np.repeat(place[good], COPIES)
    sequences = _sequence(pure + simulator.noise(place.size))
    count = place.size * options.records // every
    mean, sd = sequences[:count].mean(axis=0), sequences[:count].std(axis=0) + 1e-9

    def scaled(sequences: np.ndarray) -> np.ndarray:
        return np.clip((sequences - mean) / sd, -5.0, 5.0)

    own, other = np.split(scaled(sequences), [count])
    targets, others = np.split(place, [count])
    unit = count**-0.5

    def linearise(x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        answers, slopes = network.slopes(x, own)
        return unit * (answers - targets), unit * slopes

    losses, errors, best = [], [], weights
    for point in descend(lambda x: unit * (network.answers(x, own) - targets), linearise, weights):
        losses.append(point.loss)
        errors.append(float(np.sqrt(np.mean((network.answers(point.x, other) - others) ** 2))))
        if errors[-1] == min(errors):
            best = point.x
        if min(errors) < min(errors[-PATIENCE:]) or len(losses) > options.epochs:
            break
    answer = network.answers(best, scaled(_sequence(simulator.record)))
    return best, losses, float(answer[0]), min(errors)


PLUGIN = Rnn()
