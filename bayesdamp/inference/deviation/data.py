"""Prepare a record for fits: as samples, as means over short windows, or as amplitudes and phases of blocks."""

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
from bayesdamp.physics.restoring import LAWS
from bayesdamp.records.oscillation.features import Features, features
from bayesdamp.types import DERIVATIVES, Reference, Signal

A_CYCLE = 32
"""Smallest number of means in a cycle if neighbouring samples are averaged. Motions are averaged over the same windows,
so that averaging causes no bias, but it loses information. A sinusoid loses 0.3 %, because its mean over 1/32 of a
cycle is 0.16 % smaller. The jumps of an acceleration under dry friction lose more (measured: the interval of the
frequency became up to a third wider, those of damping ratios hardly)."""
HOLE = 2.0
"""A gap between samples is a hole if it is longer than this many lengths of an averaging window (1/`A_CYCLE` of a
cycle). Samples before and after a hole are not averaged together (conventional)."""
SLOW_CYCLES = 25.0
"""Motions of more than this many cycles take so long that they are computed in several threads. With fewer, the threads
would mostly wait for the interpreter's lock (measured)."""
LEAST = 0.05
"""The used part of a record ends where the amplitude has fallen to this fraction of the first one. Laws that hold to a
few per cent over a decade of amplitudes do not hold over two, and at smaller amplitudes the sensor's resolution and
static friction dominate."""
FEWEST_CYCLES = 4.0
"""At least this many cycles of a record are used, however small their amplitudes are."""
SOLVED = 1e-6
"""Error of a motion that the ODE solver computes, as a fraction of the amplitude. Its square is added to the variance
of the noise (`Data.least_variance`)."""
LEAST_SQUARES = (GAUSSIAN, CORRELATED)
"""Noise models under which the amplitudes and phases of blocks of cycles are estimated by least squares. Under all
other noise models, `average_of` computes the most probable amplitudes and phases."""


@dataclass(frozen=True)
class Data:
    """The values of a record to which candidates are fitted: samples, means over windows, or amplitudes and phases.

    Attributes
    ----------
    t, y : ndarray, shape (n,)
        Times in s, and values. The first sample, at which motions start, has time 0. For means over windows, t are mean
        times. The values have the unit of the displacement (rad, m or that of a sensor), per s for velocity or per s²
        for acceleration ("the record's unit"). For an averaged record, y are amplitudes, phases and midlines of blocks
        of cycles (see `Averaged`), and t are times of the compressed oscillation, which is solved in place of the
        record and has fewer cycles.
    quantity : str
        What was recorded: "angle" (any displacement, also in m), "velocity" or "acceleration".
    amplitude, final_amplitude : float
        First and last amplitude of the displacement in the used part of the record, in rad or m; the last counts as at
        least `LEAST` times the first.
    frequency : float
        Mean frequency of the oscillation, in rad/s.
    rest : float
        Midline of the displacement, in rad or m; 0 for a record of velocity or acceleration.
    cycles : float
        Number of cycles in the used part of the record.
    noise : float
        Rough standard deviation of the noise of y, in its unit: the median over windows of about a cycle.
    start : tuple of float
        Estimate of the displacement θ₀ (rad or m) and the velocity θ̇₀ (rad/s or m/s) at the first sample.
    thinned : int
        Factor by which the variance of a sample's noise is larger than that of a value of y: the number of samples in a
        window, 1 if y are samples, or about half the number in a block.
    features : Features
        Features of the oscillation, from the whole record.
    averaged : Averaged, optional
        The blocks of cycles, if the record is reduced to amplitudes and phases; else None.
    record : Signal, optional
        The samples of the used part, from which t and y were made, with times from 0 s; None for an averaged record.
    rows : ndarray of int, shape (n, m), optional
        Indices, in `record`, of the m samples in each window, if y are means over windows; else None.
    readings : ndarray, shape (n,), optional
        The values y before `working` changed them for noise that is not Gaussian; None if it has not.
    noise_model : SampleNoise
        Noise model under which amplitudes and phases were estimated. It has no meaning if y are samples or means: their
        noise model is chosen later, from the residual of a motion.
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
    record: Signal | None = None
    rows: np.ndarray | None = None
    readings: np.ndarray | None = None
    noise_model: SampleNoise = field(default_factory=SampleNoise)

    @property
    def recorded(self) -> np.ndarray:
        """Return y, (n,), without the change that `working` may have added: samples, means, or values of blocks."""
        return self.y if self.readings is None else self.readings

    def working(self, change: np.ndarray) -> Data:
        """Return a copy whose y is the recorded one plus a change, which is given for each sample of `record`, (N,).

        Where y are means over windows, the means of the change are added. This is for noise that is not Gaussian: with
        a suitable change, least squares give the most probable motion. `readings` of the copy contains the recorded
        values. It is not for an averaged record, which has no `record`.
        """
        means = change if self.rows is None else change[self.rows].mean(axis=1)
        return replace(self, y=self.recorded + means, readings=self.recorded)

    @property
    def recorded_amplitude(self) -> float:
        """Return the first amplitude of the recorded quantity (angle, velocity or acceleration), in the unit of y."""
        return self.amplitude * self.frequency ** DERIVATIVES[self.quantity]

    @property
    def middle(self) -> Reference:
        """Return the middle amplitude √(`amplitude` · `final_amplitude`), and `frequency`, as a `Reference`."""
        return Reference(float(np.sqrt(self.amplitude * self.final_amplitude)), self.frequency)

    @property
    def times(self) -> np.ndarray:
        """Return the times of y in the record, in s from its first sample, (n,).

        For means over windows they are mean times, for blocks the times of their middles, each repeated for three
        values.
        """
        return self.t if self.averaged is None else np.repeat(self.averaged.track.middles, NUMBERS)

    @property
    def end(self) -> float:
        """Return the time in s at which motions end, on the time axis of `t`.

        It is the last `t`, or the last sample of the last window if y are means over windows.
        """
        return float(self.t[-1] if self.samples is None else self.samples[-1, -1])

    @property
    def slow(self) -> bool:
        """Return whether it saves time to compute several motions in threads (`SLOW_CYCLES`)."""
        return self.cycles > SLOW_CYCLES

    @property
    def samples(self) -> np.ndarray | None:
        """Return the times in s of the samples in each window, (n, m), if y are means over windows; else None."""
        return None if self.rows is None or self.record is None else self.record.t[self.rows]

    @property
    def duration(self) -> float:
        """Return the duration of the used part of the record, in s.

        If `t` are times of a compressed oscillation, which is shorter, this is still the duration in the record.
        """
        return self.end * (1.0 if self.averaged is None else self.averaged.track.slowness)

    def of_amplitude(self, values: np.ndarray) -> np.ndarray:
        """Return only the amplitudes among values, (n,), if the record is reduced to b blocks, (b,); else all, (n,).

        The values have the form of y: amplitude, phase and midline of each block in turn. The amplitudes are divided by
        the weights that `Track.combine` gave them.
        """
        return values if self.averaged is None else values[::NUMBERS] / self.averaged.track.weights[:, 0]

    def solver(
        self, terms: Sequence[str], restoring: str, epsilon: float, knots: np.ndarray
    ) -> Solver | AveragedSolver:
        """Return a solver for damping terms under a restoring law.

        Like y, its motions are samples, means over windows of samples, or amplitude, phase and midline of blocks of
        cycles. epsilon: width of the velocity range in which dry friction changes its sign, in rad/s or m/s. knots:
        times in s, on the time axis of `t`, between which the deviations of damping (g) and frequency (h) from their
        laws are interpolated.
        """
        arguments = (
            tuple(terms), restoring, self.t, self.quantity, self.amplitude, self.frequency, epsilon, knots,
        )  # fmt: skip
        if self.averaged is not None:
            return AveragedSolver(*arguments, track=self.averaged.track)
        return Solver(*arguments, self.samples)

    def equilibrium(self, restoring: str, law: np.ndarray) -> float | None:
        """Return the stable equilibrium in rad or m nearest to the midline, for restoring parameters `law`, (r,).

        None if none is within two amplitudes (`amplitude`) of the midline. For a velocity or acceleration the position
        is not recorded: the midline is at 0, and the equilibrium may be up to π rad or m from it. restoring: name of
        the law. law: values in the order of `RestoringLaw.parameters`.
        """
        reach = max(2 * self.amplitude, 0.0 if self.quantity == "angle" else np.pi)
        return _equilibrium(restoring, tuple(law.tolist()), self.rest, reach)

    def rest_under(self, restoring: str, law: np.ndarray) -> float:
        """Return the equilibrium (rad or m) nearest to the midline, as `equilibrium` does; the midline if that is None.

        restoring: name of the restoring law. law: values of its parameters, (r,).
        """
        equilibrium = self.equilibrium(restoring, law)
        return self.rest if equilibrium is None else equilibrium

    @property
    def least_variance(self) -> float:
        """Return the variance of the solver's error, in the unit of y squared.

        It is added to the variance of the noise.
        """
        return (SOLVED * self.recorded_amplitude) ** 2


@lru_cache(maxsize=4096)
def _equilibrium(restoring: str, law: tuple[float, ...], near: float, reach: float) -> float | None:
    return rest_near(by_kernel(LAWS.get(restoring).kernel, np.array(law)), near, reach)


def prepare_data(signal: Signal, average: bool = True, noise_model: SampleNoise | None = None) -> Data:
    """Return the data to which candidates are fitted: samples, means of neighbouring samples, or amplitudes and phases.

    Unless the record is reduced to amplitudes and phases, neighbouring samples are averaged if there are at least 2 ×
    `A_CYCLE` in a cycle. Samples after the amplitude has fallen to `LEAST` of the first one are left out, but at least
    `FEWEST_CYCLES` cycles are used.

    Parameters
    ----------
    signal : Signal
        The record.
    average : bool
        Whether a record of very many cycles is reduced to amplitudes and phases, where `average_of` can do this.
    noise_model : SampleNoise, optional
        Noise model under which amplitudes and phases are estimated; by default Gaussian noise. Gaussian and correlated
        noise give least squares. The model is stored in `Data.noise_model`; it has no effect on samples or means.

    Raises
    ------
    Refusal
        If the record does not oscillate, or has fewer than ten samples.
    """
    shape = features(signal)
    every_t, every_y = np.asarray(signal.t, float), np.asarray(signal.y, float)
    every_t = every_t - every_t[0]
    t, y, rows = every_t, every_y, None
    thinned = max(1, int(shape.samples_per_cycle // A_CYCLE))
    if thinned > 1:
        # Windows start again after a gap in the samples; the last few samples before it are left out.
        ends = [0, *(np.flatnonzero(np.diff(t) > HOLE * shape.period / A_CYCLE) + 1).tolist(), t.size]
        firsts = np.concatenate([np.arange(a, b - thinned + 1, thinned) for a, b in pairwise(ends)])
        rows = firsts[:, None] + np.arange(thinned)
        t, y = t[rows].mean(axis=1), y[rows].mean(axis=1)
    # The used part ends when the amplitude has fallen to `LEAST`, but not before `FEWEST_CYCLES`.
    stop, sizes = t.size, shape.turning_amplitudes
    small = np.flatnonzero(sizes < LEAST * sizes[0])
    if small.size and small[0]:
        until = float(shape.turning_times[small[0] - 1] - signal.t[0])
        stop = int(np.searchsorted(t, max(until, FEWEST_CYCLES * shape.period))) + 1
    t, y = t[:stop], y[:stop]
    rows = None if rows is None else rows[:stop]
    last = int(np.searchsorted(every_t, t[-1])) + 1 if rows is None else int(rows[-1, -1]) + 1
    cycles = float(every_t[last - 1] / shape.period)
    start = _start(t, y, signal.quantity, shape)
    averaged, record = None, None
    if average:
        fitted = None if noise_model is None or noise_model.name in LEAST_SQUARES else noise_model.fitted
        averaged = average_of(every_t[:last], every_y[:last], shape, fitted)
    if averaged is not None:
        t, y, thinned, rows = averaged.t, averaged.y, averaged.samples, None
    else:
        record = replace(signal, t=every_t[:last], y=every_y[:last])
    noise = max(shape.roughness / np.sqrt(thinned), 1e-9 * float(np.ptp(y)))
    final_amplitude = max(shape.final_amplitude, LEAST * shape.amplitude)
    return Data(
        t, y, signal.quantity, shape.amplitude, final_amplitude, shape.frequency, shape.rest, cycles, noise, start,
        thinned, shape, averaged, record, rows, noise_model=noise_model or SampleNoise(),
    )  # fmt: skip


def _start(t: np.ndarray, y: np.ndarray, quantity: str, shape: Features) -> tuple[float, float]:
    """Estimate displacement θ₀ and velocity θ̇₀ at the first sample, by a sinusoid that is fitted to the first cycle.

    Return them in this order, in rad and rad/s (or m and m/s). The sinusoid's amplitude changes linearly with time, or
    is constant if few samples are in the cycle. quantity: what y contains, one of `DERIVATIVES`.
    """
    w = shape.frequency
    stop = max(int(np.searchsorted(t, 1.05 * shape.period)), min(6, t.size))
    x = w * t[:stop]
    columns = np.column_stack([np.ones_like(x), np.cos(x), np.sin(x), x * np.cos(x), x * np.sin(x)])
    c = np.linalg.lstsq(columns[:, : 5 if stop > 12 else 3], y[:stop], rcond=None)[0]
    value, slope = c[1], w * (c[2] + (c[3] if c.size > 3 else 0.0))
    match DERIVATIVES[quantity]:
        case 0:
            return float(c[0] + value), float(slope)
        case 1:
            return float(shape.rest - slope / w**2), float(value)
        case _:
            return float(shape.rest - value / w**2), float(-slope / w**2)
