"""The record that the quick answer uses: its samples or means over short windows of them, its scales, its start."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from bayesdamp.inference.deviation.averaged import Averaged, averaged
from bayesdamp.inference.deviation.orbit import rest_of
from bayesdamp.physics.kernel import Solver
from bayesdamp.physics.kernel.averaged import NUMBERS, AveragedSolver
from bayesdamp.physics.kernel.windows import Windows
from bayesdamp.records.oscillation.features import Features, features
from bayesdamp.types import Signal

A_CYCLE = 80
"""Means a cycle that are left, at least, where neighbouring samples are averaged. The same means are taken of the
motion, so that this number sets the cost and not the answer."""
HOLE = 2.0
"""Time without samples, in windows, that no mean reaches across (conventional)."""
LEAST = 0.05
"""Share of the first amplitude below which a record says nothing of the damping above it: laws that hold to a few per
cent over a decade do not hold over two, and what is left there is mostly the sensor's step and friction at rest."""
FEWEST_CYCLES = 4.0
SOLVED = 1e-6
"""Share of the amplitude to which motions are solved."""
ORDERS = {"angle": 0, "velocity": 1, "acceleration": 2}


@dataclass(frozen=True)
class Data:
    """The samples, or the means over windows of them, that candidates are compared with.

    t (s from the record's first sample, where motions start) and y, (n,), of `thinned` samples each; scales of the
    motion: amplitude and final amplitude of the displacement, frequency (rad/s), rest, cycles; noise: sd of y's noise
    after thinning; start: θ₀ and θ̇₀ at the record's first sample. windows: of the samples whose means y are, none
    where y are samples.

    averaged: where t and y are not samples but amplitudes and phases in blocks, at the times of the oscillation that
    stands for the record's. record: the samples that t and y were made of, from 0 s; rows: which of them are in each
    window, (n, m). readings: y before outliers and rounding were taken out of it (`working`), (n,).
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

    @property
    def recorded(self) -> np.ndarray:
        """The values as they were recorded, or means of these, (n,)."""
        return self.y if self.readings is None else self.readings

    def working(self, change: np.ndarray) -> Data:
        """Return the data with every sample of the record changed by so much, (m,), and `readings` as they were."""
        own = change if self.rows is None else change[self.rows].mean(axis=1)
        return replace(self, y=self.recorded + own, readings=self.recorded)

    @property
    def recorded_amplitude(self) -> float:
        """The first amplitude in the unit of y."""
        return self.amplitude * self.frequency ** ORDERS[self.quantity]

    @property
    def times(self) -> np.ndarray:
        """Times of y in the record, s from its first sample, (n,)."""
        return self.t if self.averaged is None else np.repeat(self.averaged.track.middles, NUMBERS)

    @property
    def end(self) -> float:
        """Time until which motions are solved, s of `t`; the last window of samples ends after the last `t`."""
        return float(self.t[-1] if self.windows is None else self.windows.times[-1, -1])

    @property
    def duration(self) -> float:
        """Of the record, s."""
        return self.end * (1.0 if self.averaged is None else self.averaged.track.slowness)

    def first(self, count: int) -> Data:
        """Return the first values alone."""
        windows = None if self.windows is None else self.windows.first(count)
        rows = None if self.rows is None else self.rows[:count]
        readings = None if self.readings is None else self.readings[:count]
        return replace(
            self, t=self.t[:count], y=self.y[:count], windows=windows, rows=rows, readings=readings
        )

    def of_amplitude(self, values: np.ndarray) -> np.ndarray:
        """Of values (n,) those that are no phases and no midlines."""
        return values if self.averaged is None else values[::NUMBERS]

    def solver(
        self, terms: Sequence[str], restoring: str, epsilon: float, knots: np.ndarray
    ) -> Solver | AveragedSolver:
        """Motions of damping terms under a law as y has them; knots: in the time of t."""
        given = (
            tuple(terms), restoring, self.t, self.quantity, self.amplitude, self.frequency, epsilon, knots,
        )  # fmt: skip
        if self.averaged is not None:
            return AveragedSolver(*given, track=self.averaged.track)
        return Solver(*given, self.windows)

    def rest_under(self, restoring: str, law: np.ndarray) -> float:
        """Where motions under parameters of a restoring law come to rest; the record's midline where nowhere."""
        at = rest_of(restoring, law, self.rest, 2 * self.amplitude)
        return self.rest if at is None else at

    @property
    def least_variance(self) -> float:
        """Of a noise below which the solver's own error would be taken for the record's."""
        return (SOLVED * self.recorded_amplitude) ** 2


def prepared(signal: Signal, average: bool = True) -> Data:
    """The data of a signal. Raises Refusal where it does not oscillate.

    average: whether one of very many cycles may be taken as amplitudes and phases.
    """
    seen = features(signal)
    t, y = np.asarray(signal.t, float), np.asarray(signal.y, float)
    t = t - t[0]
    whole = t, y
    many = max(1, int(seen.samples_per_cycle // A_CYCLE))
    windows = rows = None
    if many > 1:
        # Windows begin again after a hole, and a few samples before it are left out.
        holes = np.flatnonzero(np.diff(t) > HOLE * seen.period / A_CYCLE) + 1
        ends = [0, *holes.tolist(), t.size]
        first = np.concatenate([np.arange(a, b - many + 1, many) for a, b in pairwise(ends)])
        rows = first[:, None] + np.arange(many)
        windows = Windows.of(t[rows])
        t, y = t[rows].mean(axis=1), y[rows].mean(axis=1)
    stop = _last(t, seen, signal.t[0])
    t, y, windows = t[:stop], y[:stop], windows and windows.first(stop)
    cycles = float((t[-1] if windows is None else windows.times[-1, -1]) / seen.period)
    start = _start(t, y, signal.quantity, seen)
    last = int(np.searchsorted(whole[0], t[-1])) + 1
    few = averaged(whole[0][:last], whole[1][:last], seen, float(signal.t[0])) if average else None
    record = None
    if few is not None:
        t, y, many, windows, rows = few.t, few.y, few.samples, None, None
    else:
        rows = None if rows is None else rows[:stop]
        last = t.size if rows is None else int(rows[-1, -1]) + 1
        record = replace(signal, t=whole[0][:last], y=whole[1][:last])
    noise = max(seen.roughness / np.sqrt(many), 1e-9 * float(np.ptp(y)))
    return Data(
        t, y, signal.quantity, seen.amplitude, max(seen.final_amplitude, LEAST * seen.amplitude), seen.frequency,
        seen.rest, cycles, noise, start, many, seen, few, windows, record, rows,
    )  # fmt: skip


def _last(t: np.ndarray, seen: Features, first: float) -> int:
    """How many samples there are until the amplitude has fallen to `LEAST`, and a few cycles at least."""
    sizes = seen.turning_amplitudes
    small = np.flatnonzero(sizes < LEAST * sizes[0])
    if small.size == 0 or small[0] == 0:
        return t.size
    until = max(float(seen.turning_times[small[0] - 1] - first), FEWEST_CYCLES * seen.period)
    return int(np.searchsorted(t, until)) + 1


def _start(t: np.ndarray, y: np.ndarray, quantity: str, seen: Features) -> tuple[float, float]:
    """θ₀ and θ̇₀ by a sinusoid through the first cycle."""
    w = seen.frequency
    stop = max(int(np.searchsorted(t, 1.05 * seen.period)), min(6, t.size))
    x = w * t[:stop]
    columns = np.column_stack([np.ones_like(x), np.cos(x), np.sin(x), x * np.cos(x), x * np.sin(x)])
    c = np.linalg.lstsq(columns[:, : 5 if stop > 12 else 3], y[:stop], rcond=None)[0]
    value, slope = c[1], w * (c[2] + (c[3] if c.size > 3 else 0.0))
    match ORDERS[quantity]:
        case 0:
            return float(c[0] + value), float(slope)
        case 1:
            return float(seen.rest - slope / w**2), float(value)
        case _:
            return float(seen.rest - value / w**2), float(-slope / w**2)
