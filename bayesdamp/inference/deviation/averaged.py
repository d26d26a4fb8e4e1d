"""A record of hundreds of cycles and more as amplitudes and phases, in blocks: what of it the averaged motion is
compared with, as many numbers for a million cycles as for a thousand."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np

from bayesdamp.physics.kernel.averaged import NUMBERS, OFFSETS, REAL_OFFSETS, TURNS, Track
from bayesdamp.records.oscillation.features import Features

if TYPE_CHECKING:
    from scipy.interpolate import BSpline

FEWEST_CYCLES = 400.0
"""Cycles from which on a record is taken so (conventional)."""
BLOCKS = 64
"""Of which each stands for as many cycles that are solved as are read at once: of 400 cycles the damping is three times
larger, and its ratio, where the amplitude falls to a twentieth, 0.4 %."""
PIECES = 20
"""Of the splines that amplitude and phase are taken against."""
LEAST_SAMPLES = 24
"""In a block."""
COVERED = 0.98
"""Share of the record in which turning points must be seen."""
HOLE, BESIDE = 0.4, 50
"""Share of a block without any sample from which on the record is left to the equation of motion, and swings on either
side by which those within are counted (conventional)."""
UNLIKE = 1.3
"""Factor by which the noise of blocks may differ."""
OVERTONES = 3
"""Multiples of the frequency that are taken out of a block besides it."""
BENT = 0.3
"""Curvature of amplitude and phase within a block, as a share of their sd, up to which they are told by their mean; by
chance alone it is 0.1."""
PASSES = 3
CLOSE = 0.1
"""Posterior standard deviations by which averaging may move a parameter."""


@dataclass(frozen=True)
class Averaged:
    """t: ends of the blocks in s of the oscillation that is solved, y: amplitudes, phases and midlines in turn, each
    (3b,), as an `AveragedSolver` gives them. noise: their sd, in the record's unit; samples: that each stands for;
    residual: what blocks leave of the record's values, (n,)."""

    t: np.ndarray
    y: np.ndarray
    track: Track
    noise: float
    samples: int
    residual: np.ndarray


@dataclass(frozen=True)
class Averaging:
    """How far averaged motions are from the equation of motion.

    cycles: of the record; error: the most by which averaging moves a parameter of the likeliest candidate, in its
    posterior sds, the start apart; infinite where the ODE does not follow.
    """

    cycles: float
    error: float

    @property
    def close(self) -> bool:
        """Whether the one may stand for the other."""
        return self.error <= CLOSE


@dataclass(frozen=True)
class _Curves:
    """Phase in rad and log amplitude against time in s."""

    phase: BSpline
    log_size: BSpline

    def with_added(
        self, t: np.ndarray, phase: np.ndarray, log_size: np.ndarray, weight: np.ndarray
    ) -> _Curves:
        """With smooth curves through what is missing at times t, (b,)."""
        from scipy.interpolate import BSpline

        end = self.phase.t[-1]
        curves = (self.phase, self.log_size)
        more = (_smooth(t, values, weight, end) for values in (phase, log_size))
        return _Curves(*(BSpline(old.t, old.c + one.c, 3) for old, one in zip(curves, more, strict=True)))


def averaged(t: np.ndarray, y: np.ndarray, seen: Features, first: float) -> Averaged | None:
    """Amplitudes and phases of values y (n,) at times t (n,), s from 0; None where the record has few cycles, or is not
    sampled alike all over, or where neither changes smoothly.

    first: the time of t = 0 on the features' clock.
    """
    duration = float(t[-1])
    if duration < FEWEST_CYCLES * seen.period or t.size < LEAST_SAMPLES * BLOCKS:
        return None
    curves = _seen(seen, first, duration)
    if curves is None:
        return None
    ends = curves.phase(np.array([0.0, duration]))
    slowness = float(ends[1] - ends[0]) / (2 * np.pi * TURNS * BLOCKS)
    places = np.searchsorted(curves.phase(t), np.linspace(ends[0], ends[1], BLOCKS + 1))
    places[0], places[-1] = 0, t.size
    if np.diff(places).min() < LEAST_SAMPLES:
        return None
    middles = np.array([t[a:b].mean() for a, b in pairwise(places)])
    for number in range(PASSES):
        blocks = [
            _block(t[a:b], y[a:b], at, curves) for (a, b), at in zip(pairwise(places), middles, strict=True)
        ]
        z, middle, share = (np.array(one) for one in list(zip(*blocks, strict=True))[:3])
        left = np.concatenate([b[3] for b in blocks])
        variance = float(left @ left) / sum(b[4] for b in blocks)
        sd = np.sqrt(variance * share)
        off, log = np.angle(z), np.log(np.abs(z)) - curves.log_size(middles)
        bent = max(_bend(off, np.abs(z) / sd), _bend(log, np.abs(z) / sd))
        if bent < BENT and number:  # the turning points' own phase is off by what noise does to them
            break
        curves = curves.with_added(middles, off, log, np.abs(z) / sd)
    else:
        return None
    if sd.max() > UNLIKE * np.median(sd) or sd.min() * UNLIKE < np.median(sd):
        return None
    track = _track(curves, middles, slowness, np.abs(z))
    if track is None:
        return None
    noise = float(np.sqrt(np.mean(sd**2)))
    threes = np.column_stack([np.abs(z), np.abs(z) * off, np.sqrt(2) * middle]).ravel()
    samples = int(np.median(np.diff(places))) // 2
    until = track.times[:, -1].copy()
    until[-1] = max(until[-1], duration / slowness)  # the last block ends where the record does
    return Averaged(np.repeat(until, NUMBERS), threes, track, noise, samples, left)


def _seen(seen: Features, first: float, duration: float) -> _Curves | None:
    """Phase and amplitude by the turning points, or where holes part these by the middles of swings; None where they
    are not seen over nearly all of the record, or a hole is long."""
    t, sizes, count = seen.turning_times - first, seen.turning_amplitudes, np.arange(seen.turning_times.size)
    phase = np.pi * (count + (0 if seen.turning_values[0] > seen.turning_values[1] else 1))
    if seen.swing_times.size >= t.size:  # of more than one piece
        begins = t[0]
        t, sizes = seen.swing_times - first, seen.swing_sizes
        from scipy.ndimage import median_filter

        gaps = np.diff(t)
        if gaps.max() > HOLE * duration / BLOCKS + seen.period:
            return None
        # The usual gap near each, which is half a period: a hole of so many is counted by it.
        usual = median_filter(gaps, 2 * BESIDE + 1, mode="nearest")
        count = np.concatenate([[0], np.cumsum(np.round(gaps / usual))])
        phase = phase[0] + np.pi * (count - count[np.searchsorted(t, begins)] + 0.5)
    inside = (t >= 0) & (t <= duration)
    t, phase, sizes = t[inside], phase[inside], np.maximum(sizes[inside], 1e-300)
    if t.size < 8 * PIECES or t[-1] - t[0] < COVERED * duration:
        return None
    return _Curves(*(_smooth(t, values, sizes, duration) for values in (phase, np.log(sizes))))


def _smooth(t: np.ndarray, values: np.ndarray, weight: np.ndarray, end: float) -> BSpline:
    """A cubic spline of `PIECES` equal pieces from 0 to `end`, by least squares through values at times t, (m,)."""
    from scipy.interpolate import make_lsq_spline

    inner = np.linspace(0.0, end, PIECES + 1)
    knots = np.concatenate([[0.0] * 3, inner, [end] * 3])
    return make_lsq_spline(t, values, knots, 3, w=weight / weight.max())


def _block(
    t: np.ndarray, y: np.ndarray, at: float, curves: _Curves
) -> tuple[complex, float, float, np.ndarray, int]:
    """A block's complex amplitude against the curves at time `at`, its midline, the amplitude's variance by noise as a
    share of a sample's, what is left of the values, and its degrees of freedom."""
    phase, base = curves.phase(t), float(curves.log_size(at))
    size = np.exp(curves.log_size(t) - base)
    turned = size * np.exp(1j * phase)
    since = (t - at) / (0.5 * (t[-1] - t[0]))
    columns = [turned.real, -turned.imag, np.ones_like(t), since * turned.real, -since * turned.imag]
    for k in range(2, OVERTONES + 1):
        columns += [np.cos(k * phase), np.sin(k * phase)]
    rows = np.column_stack(columns)
    square = rows.T @ rows
    inverse = np.linalg.inv(square)
    c = inverse @ (rows.T @ y)
    left = y - rows @ c
    return complex(c[0], c[1]), float(c[2]), float(inverse[0, 0]), left, t.size - c.size


def _bend(values: np.ndarray, weight: np.ndarray) -> float:
    """Root mean square of what a block's mean is off its middle, in sds: a 24th of the second difference."""
    return float(np.sqrt(np.mean((np.diff(values, 2) * weight[1:-1]) ** 2)) / 24)


def _track(curves: _Curves, middles: np.ndarray, slowness: float, sizes: np.ndarray) -> Track | None:
    """The blocks' points in the record and in the oscillation that is solved; None where the phase turns back."""
    origin, rate = float(curves.phase(0.0)), curves.phase.derivative()
    real_phases = curves.phase(middles)[:, None] + REAL_OFFSETS
    phases = origin + (curves.phase(middles)[:, None] - origin) / slowness + OFFSETS
    real = [
        _when(curves.phase, rate, wanted, middles)
        for wanted in (real_phases, origin + slowness * (phases - origin))
    ]
    times = real[1] / slowness
    if np.any(np.diff(times[:, 0]) <= 0) or np.any(np.diff(times, axis=1) <= 0) or times.min() < 0:
        return None
    return Track(slowness, times, phases, real[0], real_phases, sizes)


def _when(phase: BSpline, rate: BSpline, wanted: np.ndarray, near: np.ndarray) -> np.ndarray:
    """Times at which the phase is as wanted, (b, s), by Newton's method from times (b,)."""
    end = phase.t[-1]
    t = np.clip(near[:, None] + (wanted - phase(near)[:, None]) / rate(near)[:, None], 0.0, end)
    for _ in range(20):
        t = np.clip(t - (phase(t) - wanted) / rate(t), 0.0, end)
    return t
