"""Prepare a record for fits: its samples, means over short windows, or amplitudes and phases, and its scales."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import lru_cache
from itertools import pairwise

import numpy as np

from bayesdamp.inference.deviation.averaged import Averaged, average_of
from bayesdamp.inference.noise import CORRELATED, GAUSSIAN, SampleNoise
from bayesdamp.physics.forces import by_kernel, rest_near
from bayesdamp.physics.kernel import Solver
from bayesdamp.physics.kernel.averaged import NUMBERS, AveragedSolver
from bayesdamp.physics.kernel.solve import Windows
from bayesdamp.physics.restoring import LAWS
from bayesdamp.records.oscillation.features import Features, features
from bayesdamp.types import Reference, Signal

A_CYCLE = 80
"""Least number of means in a cycle, if neighbouring samples are averaged. Motions are averaged over the same windows,
so this number sets the cost and not the answer."""
HOLE = 2.0
"""Gap between samples, in lengths of a window, from which on no window extends over it (conventional)."""
LEAST = 0.05
"""Fraction of the first amplitude at which the used part of a record ends. Laws that hold to a few per cent over a
decade of amplitudes do not hold over two, and below this the sensor's step and static friction dominate."""
FEWEST_CYCLES = 4.0
"""Least number of cycles of a record that are used, however small their amplitudes are."""
SOLVED = 1e-6
"""Error of a motion by the ODE solver, as a fraction of the amplitude."""
LEAST_SQUARES = (GAUSSIAN, CORRELATED)
"""Noise models under which amplitudes and phases are least-squares estimates; their noise is measured by their own
scatter."""
ORDERS = {"angle": 0, "velocity": 1, "acceleration": 2}
"""Order of the time derivative that a record contains."""


@dataclass(frozen=True)
class Data:
    """The values of a record to which candidates are fitted: samples, means over windows, or amplitudes and phases.

    Attributes
    ----------
    t, y : ndarray, shape (n,)
        Times in s from the first sample, where motions start, and values. Of an averaged record they are amplitudes and
        phases of blocks, at times of the shorter oscillation that is solved in its place.
    quantity : str
        What was recorded: angle, velocity or acceleration.
    amplitude, final_amplitude : float
        First and last amplitude of the displacement, in rad or m.
    frequency : float
        Frequency of the oscillation, in rad/s.
    rest : float
        Midline of the displacement, in rad or m.
    cycles : float
        Number of cycles.
    noise : float
        Rough standard deviation of the noise of y, from the record's roughness.
    start : tuple of float
        Estimate of θ₀ and θ̇₀ at the first sample.
    thinned : int
        Number of samples that each value of y stands for.
    features : Features
        Features of the record's oscillation.
    averaged : Averaged, optional
        The blocks, where t and y are amplitudes and phases.
    windows : Windows, optional
        The windows over which y are means; None where y are samples or amplitudes and phases.
    record : Signal, optional
        The samples from which t and y were made, with times from 0 s.
    rows : ndarray of int, shape (n, m), optional
        Indices of the samples in each window.
    readings : ndarray, shape (n,), optional
        y as it was recorded, if y itself was changed by `working`; None if it was not.
    noise_model : SampleNoise
        Noise model of the samples behind amplitudes and phases. The noise model of samples is chosen later, from the
        residual of a motion.
    """

    t: np.ndarray
    y: np.ndarray
    quantity: str
    amplitude: float
    final_amplitude: float
    frequency: float
    rest: float
    cycles: float
    noise: float
    start: tuple[float, float]
    thinned: int
    features: Features
    averaged: Averaged | None = None
    windows: Windows | None = None
    record: Signal | None = None
    rows: np.ndarray | None = None
    readings: np.ndarray | None = None
    noise_model: SampleNoise = field(default_factory=SampleNoise)

    @property
    def recorded(self) -> np.ndarray:
        """Return y without the change by `working`, (n,)."""
        return self.y if self.readings is None else self.readings

    def working(self, change: np.ndarray) -> Data:
        """Return the data with y = `recorded` plus `change`, (m,), of the samples; `readings` is then `recorded`."""
        means = change if self.rows is None else change[self.rows].mean(axis=1)
        return replace(self, y=self.recorded + means, readings=self.recorded)

    @property
    def recorded_amplitude(self) -> float:
        """Return the first amplitude in the unit of y."""
        return self.amplitude * self.frequency ** ORDERS[self.quantity]

    @property
    def middle(self) -> Reference:
        """Return the geometric mean of the first and the last amplitude with the frequency, as a `Reference`."""
        return Reference(float(np.sqrt(self.amplitude * self.final_amplitude)), self.frequency)

    @property
    def times(self) -> np.ndarray:
        """Return the times of y in the record, in s from its first sample, (n,)."""
        return self.t if self.averaged is None else np.repeat(self.averaged.track.middles, NUMBERS)

    @property
    def end(self) -> float:
        """Return the time at which motions end, in s on the clock of `t`; a last window ends after the last `t`."""
        return float(self.t[-1] if self.windows is None else self.windows.times[-1, -1])

    @property
    def duration(self) -> float:
        """Return the duration of the record, in s."""
        return self.end * (1.0 if self.averaged is None else self.averaged.track.slowness)

    def first(self, count: int) -> Data:
        """Return the data cut to the first `count` values of y."""
        windows = None if self.windows is None else self.windows.first(count)
        rows, readings = (None if a is None else a[:count] for a in (self.rows, self.readings))
        return replace(
            self, t=self.t[:count], y=self.y[:count], windows=windows, rows=rows, readings=readings
        )

    def of_amplitude(self, values: np.ndarray) -> np.ndarray:
        """Return the amplitudes among values, (n,), of an averaged record, without weights; else all values."""
        return values if self.averaged is None else values[::NUMBERS] / self.averaged.track.weights[:, 0]

    def solver(
        self, terms: Sequence[str], restoring: str, epsilon: float, knots: np.ndarray
    ) -> Solver | AveragedSolver:
        """Return the solver that gives the motions of damping terms under a restoring law in the form of y.

        knots: times of the deviations' knots, on the clock of t.
        """
        arguments = (
            tuple(terms), restoring, self.t, self.quantity, self.amplitude, self.frequency, epsilon, knots,
        )  # fmt: skip
        if self.averaged is not None:
            return AveragedSolver(*arguments, track=self.averaged.track)
        return Solver(*arguments, self.windows)

    def equilibrium(self, restoring: str, law: np.ndarray) -> float | None:
        """Return the equilibrium in rad or m under parameters of a restoring law; None if none is near the midline."""
        return _equilibrium(restoring, tuple(law.tolist()), self.rest, 2 * self.amplitude)

    def rest_under(self, restoring: str, law: np.ndarray) -> float:
        """Return the equilibrium under parameters of a restoring law, or the midline if there is none near it."""
        equilibrium = self.equilibrium(restoring, law)
        return self.rest if equilibrium is None else equilibrium

    @property
    def least_variance(self) -> float:
        """Return the variance of the solver's own error, in the unit of y squared; it is added to that of the noise."""
        return (SOLVED * self.recorded_amplitude) ** 2


@lru_cache(maxsize=4096)
def _equilibrium(restoring: str, law: tuple[float, ...], near: float, reach: float) -> float | None:
    return rest_near(by_kernel(LAWS.get(restoring).kernel, np.array(law)), near, reach)


def prepare_data(signal: Signal, average: bool = True, noise_model: SampleNoise | None = None) -> Data:
    """Return the data to which candidates are fitted: means of neighbouring samples, or amplitudes and phases.

    The part after the amplitude has fallen to `LEAST` of the first one is left out.

    Parameters
    ----------
    signal : Signal
        The record.
    average : bool
        Whether a record of very many cycles may be reduced to amplitudes and phases.
    noise_model : SampleNoise, optional
        Noise model under which amplitudes and phases are estimated; by default Gaussian noise (least squares).

    Raises
    ------
    Refusal
        Where the record does not oscillate.
    """
    shape = features(signal)
    every_t, every_y = np.asarray(signal.t, float), np.asarray(signal.y, float)
    every_t = every_t - every_t[0]
    t, y, windows, rows = every_t, every_y, None, None
    thinned = max(1, int(shape.samples_per_cycle // A_CYCLE))
    if thinned > 1:
        # Windows start again after a gap in the samples; the last few samples before it are left out.
        holes = np.flatnonzero(np.diff(t) > HOLE * shape.period / A_CYCLE) + 1
        ends = [0, *holes.tolist(), t.size]
        firsts = np.concatenate([np.arange(a, b - thinned + 1, thinned) for a, b in pairwise(ends)])
        rows = firsts[:, None] + np.arange(thinned)
        windows = Windows.of(t[rows])
        t, y = t[rows].mean(axis=1), y[rows].mean(axis=1)
    # The used part ends when the amplitude has fallen to `LEAST`, but not before `FEWEST_CYCLES`.
    stop, sizes = t.size, shape.turning_amplitudes
    small = np.flatnonzero(sizes < LEAST * sizes[0])
    if small.size and small[0]:
        until = float(shape.turning_times[small[0] - 1] - signal.t[0])
        stop = int(np.searchsorted(t, max(until, FEWEST_CYCLES * shape.period))) + 1
    t, y = t[:stop], y[:stop]
    if windows is not None and rows is not None:
        windows, rows = windows.first(stop), rows[:stop]
    cycles = float((t[-1] if windows is None else windows.times[-1, -1]) / shape.period)
    start = _start(t, y, signal.quantity, shape)
    last = int(np.searchsorted(every_t, t[-1])) + 1
    averaged, record = None, None
    if average:
        fitted = None if noise_model is None or noise_model.name in LEAST_SQUARES else noise_model.fitted
        averaged = average_of(every_t[:last], every_y[:last], shape, fitted)
    if averaged is not None:
        t, y, thinned, windows, rows = averaged.t, averaged.y, averaged.samples, None, None
    else:
        last = t.size if rows is None else int(rows[-1, -1]) + 1
        record = replace(signal, t=every_t[:last], y=every_y[:last])
    noise = max(shape.roughness / np.sqrt(thinned), 1e-9 * float(np.ptp(y)))
    final_amplitude = max(shape.final_amplitude, LEAST * shape.amplitude)
    return Data(
        t, y, signal.quantity, shape.amplitude, final_amplitude, shape.frequency, shape.rest, cycles, noise, start,
        thinned, shape, averaged, windows, record, rows, noise_model=noise_model or SampleNoise(),
    )  # fmt: skip


def _start(t: np.ndarray, y: np.ndarray, quantity: str, shape: Features) -> tuple[float, float]:
    """Estimate θ₀ and θ̇₀, with a sinusoid of growing or falling amplitude that is fitted to the first cycle.

    quantity: what y contains. If few samples are in the cycle, the amplitude is constant.
    """
    w = shape.frequency
    stop = max(int(np.searchsorted(t, 1.05 * shape.period)), min(6, t.size))
    x = w * t[:stop]
    columns = np.column_stack([np.ones_like(x), np.cos(x), np.sin(x), x * np.cos(x), x * np.sin(x)])
    c = np.linalg.lstsq(columns[:, : 5 if stop > 12 else 3], y[:stop], rcond=None)[0]
    value, slope = c[1], w * (c[2] + (c[3] if c.size > 3 else 0.0))
    match ORDERS[quantity]:
        case 0:
            return float(c[0] + value), float(slope)
        case 1:
            return float(shape.rest - slope / w**2), float(value)
        case _:
            return float(shape.rest - value / w**2), float(-slope / w**2)
