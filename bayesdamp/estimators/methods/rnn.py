"""Estimate the damping of a record with a recurrent network.

The method is that of section 3.7 of the paper that `bayesdamp.estimators` cites.

An LSTM or GRU is trained on simulated records of the same oscillator at the record's own times. The logarithm of their
damping coefficient is uniform in a wide range about the value that the record's mean decay suggests; their noise is
similar to the record's; start and restoring parameters have their known values, or vary about those that the record
shows. The input of the network is, for each stretch (usually a half cycle), the logarithm of the amplitude and its
difference from the stretch before. Its output is the position of the coefficient's logarithm in the range, from −1
(lower end) to 1 (upper end). The coefficient that it gives for the record becomes the centre of a narrower range, whose
width is a multiple of the network's error on simulated test records. The network is trained further in this range, and
so on until the range is about ±10 %. (The alternative, a network for the motion from one sample to the next, does not
contain the coefficient as a number.)
"""

from typing import Literal

import numpy as np
from pydantic import Field

from bayesdamp.estimators.shared import (
    Estimator,
    Options,
    checked_features,
    free_names,
    noise_level,
    optional_package,
    oscillator,
    phase_of,
    rest_position,
    start_parameters,
    thin_record,
)
from bayesdamp.physics.oscillator import Trajectories
from bayesdamp.records.oscillation.features import Features
from bayesdamp.types import Estimate, Problem, Refusal, Signal

WIDEST = float(np.log(5.0))
"""Half width of the first range of ln(damping coefficient) in which records are simulated: a factor of 5 on either side
(conventional)."""
NARROWEST = float(np.log(1.1))
"""Half width of the narrowest range of ln(damping coefficient), ±10 %, with which the training ends (conventional)."""
MOST_ROUNDS = 6
"""Largest number of training rounds, each with a new range of the coefficient (conventional). The estimate is then that
of the last round, even if its range is wider than `NARROWEST`."""
LEAST_SAMPLES = 5
"""Least number of samples in a stretch (conventional); stretches with fewer are not used. A stretch is a part of the
record, usually of half a cycle; all cover the same range of phase."""
LEAST_STRETCHES = 3
"""Least number of stretches (parts of usually half a cycle) with enough samples; a record with fewer is refused
(conventional)."""
FEW = 6.0
"""A record with fewer half cycles than this is cut into parts (stretches) of a quarter cycle instead of half."""
MOST_SAMPLES = 2000
"""Largest number of samples of a record that are used; a longer record is thinned (conventional)."""
MOST_STRETCHES = 48
"""Largest number of stretches (parts, usually of half a cycle) into which a record is cut (conventional). In a longer
record a stretch has several half cycles."""
TOLERANCE = 1e-6
"""Largest numerical error of a simulated record, as a fraction of the amplitude."""
LEAST_DECAY = 0.01
"""Smallest fall of the logarithm of the amplitude over the record; it is assumed if the record itself shows less."""
FLOOR = 1e-3
"""Number added to amplitudes before the logarithm is taken, as a fraction of the record's largest amplitude. It makes
the logarithm of a vanishing amplitude finite."""
COPIES = 2
"""Number of times that each simulated record is used in a training round, each time with other noise."""


class RnnOptions(Options):
    """Options of the recurrent network.

    cell: kind of the recurrent layer, "lstm" or "gru". units: number of units in this layer. records: number of records
    that are simulated in each round for the training; a tenth more, but at least 64, test the network. epochs: largest
    number of training steps in a round; each step uses all training records.
    """

    cell: Literal["lstm", "gru"] = "lstm"
    units: int = Field(default=6, ge=2, le=256)
    records: int = Field(default=192, ge=64, le=100_000)
    epochs: int = Field(default=20, ge=1, le=10_000)


class Rnn(Estimator[RnnOptions]):
    """Estimate one damping coefficient with a recurrent network that is trained on simulated records.

    Its relative standard error is the network's rms error on simulated test records, in ln of the coefficient.
    Unknown restoring parameters and an unknown start are not estimated by the network, but from the record's features
    and the smoothed record.
    """

    options = RnnOptions

    def refuses(self, damping: tuple[str, ...]) -> str | None:
        """Return the reason why this method cannot estimate a sum of two or more terms; None for a single term.

        damping: names of the terms of the sum.
        """
        if len(damping) > 1:
            return "the network is trained to give one damping coefficient, not a sum of terms"
        return None

    def initial(
        self, signal: Signal, problem: Problem, options: RnnOptions, rng: np.random.Generator
    ) -> Estimate:
        """Train a network in narrower and narrower ranges of the damping coefficient; its output is the estimate.

        Unknown restoring and start parameters come from the record's features and the smoothed record, without standard
        errors. Raises Refusal if the coefficient that the network gives in the last round is near an end of the range
        in which it was trained, or outside. Refusal is raised too if PyTorch is not installed, or by
        `checked_features`, `motion`, `Stretches` and `Simulator.sequences`.
        """
        optional_package("torch")
        from bayesdamp.estimators.networks.recurrent import RecurrentNetwork

        simulator = Simulator(signal, problem, checked_features(signal), rng)
        network = RecurrentNetwork(options.cell, options.units)
        weights = network.draw(rng)
        centre, half, inside = simulator.centre, WIDEST, False
        estimate, sd = centre, half
        for _ in range(MOST_ROUNDS):
            own, others, record = simulator.sequences(centre, half, options.records)
            weights, error = network.train(weights, own, others, options.epochs)
            answer = float(network.read(weights, record)[0])
            estimate, sd = centre + half * answer, half * error
            inside = abs(answer) < 0.95
            centre += half * float(np.clip(answer, -1.0, 1.0))
            if inside and half <= NARROWEST:
                break
            half = max(NARROWEST, min(half / 2, 5.0 * half * error)) if inside else half
        if not inside:
            raise Refusal("the record's damping is outside the range on which the network was trained")
        parameter, value = simulator.parameter, float(np.exp(estimate))
        values = {parameter: value, **{name: simulator.base[name] for name in free_names(problem)}}
        stderr = {parameter: value * sd}
        return Estimate(self.name, "initial", values, stderr, evaluations=simulator.simulated)


class Stretches:
    """Cut a record into stretches, which are parts over equal ranges of its phase φ, and fit a sinusoid to each.

    A stretch is usually half a cycle. It has several half cycles if there were more than `MOST_STRETCHES` stretches
    otherwise, and a quarter cycle if the record has fewer than `FEW` half cycles. The sinusoid y = a cos φ + b sin φ is
    fitted by least squares about the record's midline, and together with a constant if the stretch is at least half a
    cycle. The same matrices fit any record at the same times t (n,) in s. count: number of stretches that are used;
    these have at least `LEAST_SAMPLES` samples, over at least 0.6 of their range of phase. half_cycles: number of half
    cycles in a stretch. spread: for each used stretch the Cholesky factor (2, 2) of the covariance of (a, b) for white
    noise of standard deviation 1. Raises Refusal if `count` is below `LEAST_STRETCHES`.
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
                f"{self.count} parts of the record (of {self.half_cycles:g} half cycles each) have at least "
                f"{LEAST_SAMPLES} samples over most of their length; at least {LEAST_STRETCHES} such parts are needed"
            )

    def quadratures(self, y: np.ndarray) -> np.ndarray:
        """Return the coefficients (a, b) of cos φ and sin φ in each stretch of m records, (m, count, 2).

        y: the samples of the records, (m, n). φ: phase of the given record. a and b are in the unit of y.
        """
        y = y - self.rest
        return np.stack([y[:, rows] @ solver.T for rows, solver in zip(self.rows, self.solvers)], axis=1)


class Simulator:
    """Simulate records like a given one, to train the recurrent network; describe each by a sinusoid for each stretch.

    A stretch is a part of usually half a cycle (`Stretches`); there the record is a cos φ + b sin φ, with its phase φ.
    parameter: name of the damping coefficient. centre: logarithm of the coefficient that the record's mean decay
    suggests. record: (a, b) of the given record in all `count` stretches, in units of its amplitude, (1, count, 2).
    simulated: number of records simulated so far.
    """

    def __init__(
        self, signal: Signal, problem: Problem, features: Features, rng: np.random.Generator
    ) -> None:
        osc = oscillator(problem)
        (term,) = osc.terms
        self.rng, self.osc, self.parameter = rng, osc, term.parameter
        self.base = start_parameters(signal, problem, features)
        self.known, self.rest = problem.system.known, rest_position(signal, problem, features)
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
        """Simulate m records without noise; return (a, b) of each of their `count` stretches, (m, count, 2).

        In a stretch (`Stretches`; usually half a cycle) the record is a cos φ + b sin φ, with the phase φ of the given
        record; a and b are in units of the given record's amplitude. They are NaN for an unbounded motion.
        log_coefficient: logarithms of the damping coefficient, (m,). Unknown start values, and unknown restoring
        parameters except angles, vary at random.
        """
        m, rng = log_coefficient.size, self.rng
        given = {name: np.full(m, float(self.base[name])) for name in self.osc.inputs if name in self.base}
        given[self.parameter] = np.exp(log_coefficient)
        # A frequency further off would lose step with the record's phase within a stretch.
        detuned = 0.1 / (np.pi * self.stretches.half_cycles)
        for name in self.osc.law.parameters:
            if name not in self.known and not name.endswith("_angle"):  # an angle only shifts the force
                given[name] = given[name] * (1.0 + 2 * detuned * rng.uniform(-1.0, 1.0, m))
        louder = np.exp(0.2 * rng.uniform(-1.0, 1.0, m))
        for name, rest in (("theta0", self.rest), ("omega0", 0.0)):
            if name not in self.known:
                given[name] = rest + louder * (given[name] - rest)
        self.simulated += m
        return self.stretches.quadratures(self.trajectories.many(given)[:, self.drop :]) / self.size

    def sequences(
        self, centre: float, half: float, records: int
    ) -> tuple[tuple[np.ndarray, np.ndarray], tuple[np.ndarray, np.ndarray], np.ndarray]:
        """Simulate records to train and test the network, with the logarithm of the coefficient in centre ± half.

        About `records` are for training, and a tenth more (at least 64) for tests. Records whose trajectory is
        unbounded are left out. Each of the others is used `COPIES` times, with different noise. Raises Refusal if most
        trajectories are unbounded.

        Returns
        -------
        (ndarray, ndarray), (ndarray, ndarray), ndarray
            First the training set: sequences (m, count, 2), and for each the position of its coefficient's logarithm in
            the range, −1 to 1, (m,). Then the test set, in the same form. Last the given record's sequence, (1, count,
            2). A sequence has, for each stretch of the record, the log amplitude and its difference from the stretch
            before. Sequences are scaled to mean 0 and standard deviation 1 over the training set, and clipped at ±5.
        """
        every = records + max(64, records // 10)
        place = self.rng.uniform(-1.0, 1.0, every)
        pure = self.quadratures(centre + half * place)
        good = np.all(np.isfinite(pure), axis=(1, 2))
        if np.count_nonzero(good) < every // 2:
            raise Refusal(
                "most of the simulated trajectories are unbounded, so there are too few to train the network"
            )
        # All copies of a record are in the same set: a test must not use records that the network knows.
        last = COPIES * (np.count_nonzero(good) * records // every)
        place = np.repeat(place[good], COPIES)
        noisy = _sequence(np.repeat(pure[good], COPIES, axis=0) + self.noise(place.size))
        mean, sd = noisy[:last].mean(axis=0), noisy[:last].std(axis=0) + 1e-9
        scaled = np.clip((noisy - mean) / sd, -5.0, 5.0)
        record = np.clip((_sequence(self.record) - mean) / sd, -5.0, 5.0)
        return (scaled[:last], place[:last]), (scaled[last:], place[last:]), record

    def noise(self, records: int) -> np.ndarray:
        """Draw the noise in the coefficients (a, b) of all stretches of simulated records, (records, count, 2).

        A stretch is a part of usually half a cycle, in which the record is a cos φ + b sin φ. The noise is in units of
        the given record's amplitude. The standard deviation of each record's noise is within a factor of two of that of
        the given record.
        """
        size = self.sd * np.exp(np.log(2.0) * self.rng.uniform(-1.0, 1.0, records))
        white = self.rng.standard_normal((records, self.stretches.count, 2))
        return size[:, None, None] * np.einsum("kij,mkj->mki", np.array(self.stretches.spread), white)


def _sequence(quadratures: np.ndarray) -> np.ndarray:
    """Return the log amplitude of each stretch and its difference from the stretch before, (m, count, 2).

    A stretch is usually half a cycle (`Stretches`); in it the record is a cos φ + b sin φ. quadratures: (a, b) of the
    `count` stretches of each of m records, (m, count, 2), in units of the given record's amplitude. `FLOOR` is added to
    the amplitude √(a² + b²) before the logarithm. The difference of the first stretch is 0.
    """
    size = np.log(np.hypot(quadratures[..., 0], quadratures[..., 1]) + FLOOR)
    return np.stack([size, np.diff(size, axis=1, prepend=size[:, :1])], axis=2)


PLUGIN = Rnn()
