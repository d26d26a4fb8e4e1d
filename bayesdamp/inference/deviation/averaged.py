"""A record of hundreds of cycles or more as amplitudes and phases, in blocks.

The averaged motion is compared with these: as many numbers for a million cycles as for a thousand.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np
import scipy  # loads its modules when they are used

from bayesdamp.inference.noise import FittedNoise
from bayesdamp.physics.kernel.averaged import NUMBERS, OFFSETS, REAL_OFFSETS, TURNS, Track
from bayesdamp.records.oscillation.features import Features

if TYPE_CHECKING:
    from scipy.interpolate import BSpline

FEWEST_CYCLES = 400.0
"""Cycles from which on a record is averaged (conventional)."""
BLOCKS = 64
"""Number of blocks. Each stands for as many cycles that are solved as are read at once: with 400 cycles the damping is
three times larger, and its ratio, where the amplitude falls to a twentieth, 0.4 %."""
PIECES = 20
"""Of the splines that amplitude and phase are taken against."""
LEAST_SAMPLES = 24
"""In a block."""
COVERED = 0.98
"""Share of the record that must have turning points."""
HOLE, BESIDE = 0.4, 50
"""Share of a block without any sample from which on the record is left to the equation of motion, and number of swings
on either side by which the swings in a hole are counted (conventional)."""
UNLIKE = 1.3
"""Factor by which the noise of blocks may differ."""
OVERTONES = 3
"""Multiples of the frequency that are also removed from a block."""
BENT = 0.3
"""Largest curvature of amplitude and phase within a block, as a share of their sd, for which their mean describes them;
by chance alone it is 0.1."""
PASSES = 3
ROUNDS = 10
"""Changes of the working residuals, at most."""
SETTLED = 0.05
"""Largest change of the motion by the last of them, in standard deviations of the whole record's noise."""
CLOSE = 0.1
"""Posterior standard deviations by which averaging may move a parameter."""


@dataclass(frozen=True)
class Averaged:
    """A record as amplitudes, phases and midlines of b blocks.

    Attributes
    ----------
    t : ndarray, shape (3b,)
        Ends of the blocks, in s of the oscillation that is solved.
    y : ndarray, shape (3b,)
        Amplitudes, phases and midlines in turn, as an `AveragedSolver` gives them.
    track : Track
        Points of the blocks in the record and in the oscillation that is solved.
    noise : float
        Sd of y's noise, in the record's unit.
    samples : int
        Number of samples that each value stands for.
    residual : ndarray, shape (n,)
        What the blocks leave of the record's values.
    """

    t: np.ndarray
    y: np.ndarray
    track: Track
    noise: float
    samples: int
    residual: np.ndarray


@dataclass(frozen=True)
class Averaging:
    """How far averaged motions are from the equation of motion.

    Attributes
    ----------
    cycles : float
        Of the record.
    error : float
        Largest shift of a parameter of the likeliest candidate, in its posterior sds, apart from the start; infinite
        where the equation of motion cannot be followed.
    """

    cycles: float
    error: float

    @property
    def close(self) -> bool:
        """Whether averaged motions can replace the equation of motion."""
        return self.error <= CLOSE


@dataclass(frozen=True)
class _Curves:
    """Phase in rad and log amplitude against time in s."""

    phase: BSpline
    log_size: BSpline


def average_of(
    t: np.ndarray, y: np.ndarray, features: Features, first: float, noise: FittedNoise | None = None
) -> Averaged | None:
    """Take a record as amplitudes and phases.

    None where the record has few cycles, is not sampled evenly enough, or where neither changes smoothly.

    Parameters
    ----------
    t, y : ndarray, shape (n,)
        Times in s, from 0, and values.
    features : Features
        Of the record.
    first : float
        The time of t = 0 on the features' clock, in s.
    noise : FittedNoise, optional
        Model of the samples' noise, under which amplitudes and phases are the most probable ones; by default white
        Gaussian noise.
    """
    averaged = _least_squares(t, y, features, first)
    if noise is None:
        return averaged
    gaps, working = np.diff(t), y
    for _ in range(ROUNDS):
        if averaged is None:
            return None
        motion = working - averaged.residual
        residual = y - motion
        variance = noise.variance(residual, motion - motion.mean(), gaps)
        working = motion + noise.working_residuals(residual, gaps, variance)
        averaged = _least_squares(t, working, features, first)
        if averaged is not None:
            moved = working - averaged.residual - motion
            if float(moved @ moved) < SETTLED**2 * variance:
                break
    return None if averaged is None else replace(averaged, residual=averaged.residual + y - working)


def _least_squares(t: np.ndarray, y: np.ndarray, features: Features, first: float) -> Averaged | None:
    """Take values as amplitudes and phases by least squares. Arguments and result are those of `average_of`."""
    duration = float(t[-1])
    if duration < FEWEST_CYCLES * features.period or t.size < LEAST_SAMPLES * BLOCKS:
        return None
    curves = _first_curves(features, first, duration)
    if curves is None:
        return None
    ends = curves.phase(np.array([0.0, duration]))
    slowness = float(ends[1] - ends[0]) / (2 * np.pi * TURNS * BLOCKS)
    places = np.searchsorted(curves.phase(t), np.linspace(ends[0], ends[1], BLOCKS + 1))
    places[0], places[-1] = 0, t.size
    if np.diff(places).min() < LEAST_SAMPLES:
        return None
    parts = list(pairwise(places))
    middles = np.array([t[a:b].mean() for a, b in parts])
    for number in range(PASSES):
        fits, lefts, freedom = [], [], 0
        for (a, b), at in zip(parts, middles, strict=True):
            # The oscillation and a quarter period before it, both with an amplitude that grows along the block.
            own, phase = t[a:b], curves.phase(t[a:b])
            turned = np.exp(curves.log_size(own) - float(curves.log_size(at))) * np.exp(1j * phase)
            since = (own - at) / (0.5 * (own[-1] - own[0]))
            columns = [
                turned.real,
                -turned.imag,
                np.ones_like(own),
                since * turned.real,
                -since * turned.imag,
            ]
            for k in range(2, OVERTONES + 1):
                columns += [np.cos(k * phase), np.sin(k * phase)]
            rows = np.column_stack(columns)
            inverse = np.linalg.inv(rows.T @ rows)
            c = inverse @ (rows.T @ y[a:b])
            fits.append((complex(c[0], c[1]), float(c[2]), float(inverse[0, 0])))
            lefts.append(y[a:b] - rows @ c)
            freedom += own.size - c.size
        z, midline, share = map(np.array, zip(*fits, strict=True))
        left = np.concatenate(lefts)
        variance = float(left @ left) / freedom
        sd = np.sqrt(variance * share)
        weight = np.abs(z) / sd
        off, log = np.angle(z), np.log(np.abs(z)) - curves.log_size(middles)
        bent = max(_bend(off, weight), _bend(log, weight))
        if bent < BENT and number:  # the noise shifts the turning points' own phase
            break
        both = ((curves.phase, off), (curves.log_size, log))
        more = [(old, _smooth(middles, values, weight, old.t[-1])) for old, values in both]
        curves = _Curves(*(scipy.interpolate.BSpline(old.t, old.c + new.c, 3) for old, new in more))
    else:
        return None
    if sd.max() > UNLIKE * np.median(sd) or sd.min() * UNLIKE < np.median(sd):
        return None
    track = _track(curves, middles, slowness, np.abs(z))
    if track is None:
        return None
    noise = float(np.sqrt(np.mean(sd**2)))
    threes = np.column_stack([np.abs(z), np.abs(z) * off, np.sqrt(2) * midline]).ravel()
    samples = int(np.median(np.diff(places))) // 2
    until = track.times[:, -1].copy()
    until[-1] = max(until[-1], duration / slowness)  # the last block ends where the record does
    return Averaged(np.repeat(until, NUMBERS), threes, track, noise, samples, left)


def _first_curves(features: Features, first: float, duration: float) -> _Curves | None:
    """Return phase and amplitude by the turning points, or by the middles of swings where the record has holes.

    None where they do not cover nearly all of the record, or a hole is long.
    """
    t, sizes = features.turning_times - first, features.turning_amplitudes
    from_top = features.turning_values[0] > features.turning_values[1]
    phase = np.pi * (np.arange(t.size) + (0 if from_top else 1))
    if features.swing_times.size >= t.size:  # in more than one piece
        from scipy.ndimage import median_filter

        begin = t[0]
        t, sizes = features.swing_times - first, features.swing_sizes
        gaps = np.diff(t)
        if gaps.max() > HOLE * duration / BLOCKS + features.period:
            return None
        # The usual gap nearby is half a period: it tells how many half periods a hole has.
        usual = median_filter(gaps, 2 * BESIDE + 1, mode="nearest")
        count = np.concatenate([[0], np.cumsum(np.round(gaps / usual))])
        phase = phase[0] + np.pi * (count - count[np.searchsorted(t, begin)] + 0.5)
    inside = (t >= 0) & (t <= duration)
    t, phase, sizes = t[inside], phase[inside], np.maximum(sizes[inside], 1e-300)
    if t.size < 8 * PIECES or t[-1] - t[0] < COVERED * duration:
        return None
    return _Curves(*(_smooth(t, values, sizes, duration) for values in (phase, np.log(sizes))))


def _smooth(t: np.ndarray, values: np.ndarray, weight: np.ndarray, end: float) -> BSpline:
    """Fit a cubic spline of `PIECES` equal pieces from 0 to `end` by least squares to values at times t, (m,)."""
    knots = np.concatenate([[0.0] * 3, np.linspace(0.0, end, PIECES + 1), [end] * 3])
    return scipy.interpolate.make_lsq_spline(t, values, knots, 3, w=weight / weight.max())


def _bend(values: np.ndarray, weight: np.ndarray) -> float:
    """Return the rms distance of blocks' means from their middles, in sds: a 24th of the second difference."""
    return float(np.sqrt(np.mean((np.diff(values, 2) * weight[1:-1]) ** 2)) / 24)


def _track(curves: _Curves, middles: np.ndarray, slowness: float, sizes: np.ndarray) -> Track | None:
    """Return the blocks' points in the record and in the oscillation that is solved; None where the phase goes back."""
    phase, rate = curves.phase, curves.phase.derivative()
    origin, end = float(phase(0.0)), phase.t[-1]
    real_phases = phase(middles)[:, None] + REAL_OFFSETS
    phases = origin + (phase(middles)[:, None] - origin) / slowness + OFFSETS
    real = []
    for wanted in (real_phases, origin + slowness * (phases - origin)):
        # Times (b, s) at which the phase is as wanted, by Newton's method.
        t = np.clip(middles[:, None] + (wanted - phase(middles)[:, None]) / rate(middles)[:, None], 0.0, end)
        for _ in range(20):
            t = np.clip(t - (phase(t) - wanted) / rate(t), 0.0, end)
        real.append(t)
    times = real[1] / slowness
    if np.any(np.diff(times[:, 0]) <= 0) or np.any(np.diff(times, axis=1) <= 0) or times.min() < 0:
        return None
    return Track(slowness, times, phases, real[0], real_phases, sizes)
