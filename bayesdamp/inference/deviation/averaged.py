"""A record of hundreds of cycles or more, reduced to amplitudes and phases of blocks.

The averaged motion is compared with these instead of the samples: as many numbers for a million cycles as for a
thousand.
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

MOST_CYCLES = 1200.0
"""Largest number of cycles for which the ODE is solved instead if averaged motions are not accurate: the Jacobian then
takes 1 GB (measured)."""
FEWEST_CYCLES = 400.0
"""Number of cycles from which on a record is averaged (conventional)."""
BLOCKS = 64
"""Number of blocks. The oscillation that is solved in place of the record's has `TURNS` cycles per block. For a record
of 400 cycles its damping is three times the record's: a damping ratio of 0.4 % if the amplitude falls to a
twentieth."""
PIECES = 20
"""Number of polynomial pieces of the smooth splines of amplitude and phase."""
LEAST_SAMPLES = 24
"""Smallest number of samples in a block."""
HOLE = 0.4
"""Gap between samples, in lengths of a block, from which on it is a hole: blocks end before it and begin again after it
(conventional)."""
SHORTEST = 0.25
"""Length, in blocks, of the shortest piece between two holes that is used (conventional)."""
WINDOW = 4.0
"""Length in cycles of the windows whose demodulation gives the first estimates of phase and amplitude."""
FULL = 0.7
"""A window is used only if the summed taper weights of its samples are more than this fraction of their median over all
windows (conventional)."""
REACH = 2.5
"""The cycles in a hole are counted by polynomials through the phase on either side, as far as this many lengths of the
hole from its middle (conventional)."""
LEAST_REACH = 10.0
"""For `REACH`, a hole that is shorter than this many windows (`WINDOW`) counts as this long (conventional)."""
DEGREE = 3
"""Largest degree of the polynomials of `REACH` (conventional)."""
UNSURE = 0.25
"""The number of cycles in a hole counts as known if its distance from a whole number plus three sds is at most this
(conventional)."""
FOLLOWED = 8
"""Number of windows (`WINDOW`) in each piece of the spline that follows a wandering phase; the noise of so many windows
hardly shifts it."""
OVERTONES = 3
"""Largest multiple of the frequency that is also removed from a block."""
BENT = 3.0
"""Largest `_scatter` of amplitudes and phases about the curves with which blocks are used. By chance alone it is 1; at
3, the mean over a block differs from the value in its middle by 0.3 sds."""
PASSES = 3
"""Largest number of fits of the blocks, between which the curves are corrected."""
ROUNDS = 10
"""Largest number of refits of the blocks with new working residuals, under a noise model other than least squares."""
SETTLED = 0.05
"""Refits with new working residuals end when the last of them changes the motion by less than this many sds of the
whole record's noise."""
MOST_SHIFT = 0.1
"""Averaged motions are used if averaging shifts no parameter by more than this, in posterior sds."""


@dataclass(frozen=True)
class Averaged:
    """A record as amplitudes, phases and midlines of b blocks.

    Attributes
    ----------
    t : ndarray, shape (3b,)
        Ends of the blocks on the clock of the oscillation that is solved, in s; each is repeated for the three values
        of y.
    y : ndarray, shape (3b,)
        Amplitudes, phases and midlines in turn, as an `AveragedSolver` gives them.
    track : Track
        Points of the blocks in the record and in the oscillation that is solved.
    noise : float
        Sd of y's noise, in the record's unit.
    samples : int
        Number of samples that each value stands for.
    residual : ndarray, shape (n,)
        Record minus the fit of its block, in the record's unit; 0 for samples that are in no block.
    wander : float
        Sd at the record's end of a random walk of the phase, in rad; 0 where the phase is smooth.
    jumps : tuple of float
        Times in s of holes in which the cycles cannot be counted.
    """

    t: np.ndarray
    y: np.ndarray
    track: Track
    noise: float
    samples: int
    residual: np.ndarray
    wander: float = 0.0
    jumps: tuple[float, ...] = ()


@dataclass(frozen=True)
class Averaging:
    """How far averaged motions are from the equation of motion.

    Attributes
    ----------
    cycles : float
        Number of cycles in the record.
    error : float
        Largest shift that averaging causes in a parameter of the most probable candidate (displacement and velocity at
        the start excluded), in posterior sds; infinite if the equation of motion cannot be solved.
    """

    cycles: float
    error: float

    @property
    def close(self) -> bool:
        """Whether averaged motions can replace the equation of motion."""
        return self.error <= MOST_SHIFT


@dataclass(frozen=True)
class _Curves:
    """Phase in rad and log amplitude against time in s.

    phase, log_size: splines. steps: pairs of a time in s and the step in rad that is added to the spline of the phase
    after it.
    """

    phase: BSpline
    log_size: BSpline
    steps: tuple[tuple[float, float], ...] = ()

    def phase_at(self, t: np.ndarray) -> np.ndarray:
        """Return the phase with its steps at times t, (n,)."""
        return self.phase(t) + sum((size * (t > at) for at, size in self.steps), np.zeros(1))


def average_of(
    t: np.ndarray, y: np.ndarray, features: Features, noise: FittedNoise | None = None
) -> Averaged | None:
    """Reduce a record to amplitudes, phases and midlines of blocks.

    Return None if the record has too few cycles (`FEWEST_CYCLES`) or samples, or if amplitude or phase do not change
    smoothly and the record is short enough for the ODE (`MOST_CYCLES`).

    Parameters
    ----------
    t, y : ndarray, shape (n,)
        Times in s, from 0, and values.
    features : Features
        Features of the record.
    noise : FittedNoise, optional
        Model of the samples' noise, under which amplitudes and phases are the most probable ones; by default white
        Gaussian noise.
    """
    averaged = _least_squares(t, y, features)
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
        averaged = _least_squares(t, working, features)
        if averaged is not None:
            moved = working - averaged.residual - motion
            if float(moved @ moved) < SETTLED**2 * variance:
                break
    return None if averaged is None else replace(averaged, residual=averaged.residual + y - working)


def _least_squares(t: np.ndarray, y: np.ndarray, features: Features) -> Averaged | None:
    """Reduce values to amplitudes and phases by least squares. Arguments and result are those of `average_of`.

    Phases are relative to a smooth curve. If the record's phase does not follow one, it is treated as a random walk:
    the fits are relative to a spline that follows it. Return None in the cases that `average_of` lists.
    """
    if t[-1] < FEWEST_CYCLES * features.period or t.size < LEAST_SAMPLES * BLOCKS:
        return None
    used = _long_pieces(t)
    residual, t, y = np.zeros(t.size), t[used], y[used]
    times, phases, sizes, steps = _demodulated(t, y, features)
    knots, following = _knots(times, PIECES, t[-1]), times.size // FOLLOWED
    log_size = _smooth(times, np.log(sizes), sizes, knots)
    curves = _Curves(_smooth(times, phases, sizes, knots), log_size, steps)
    phases_there = curves.phase(t)
    cycles = float(phases_there[-1] - curves.phase(0.0)) / (2 * np.pi)
    parts, limits = _blocks(t, phases_there, 2 * np.pi * cycles / BLOCKS)
    if min(b - a for a, b in parts) < LEAST_SAMPLES:
        return None
    middles = np.clip([t[a:b].mean() for a, b in parts], *limits)
    fit, wanders = _fit_curves(t, y, parts, middles, curves), False
    if fit.bent > BENT and following > PIECES:
        phase = _smooth(times, phases, sizes, _knots(times, following, t[-1]))
        fit, wanders = _fit_curves(t, y, parts, middles, _Curves(phase, log_size, steps), follows=True), True
    if fit.bent > BENT and (not wanders or cycles < MOST_CYCLES):
        return None
    size, off, sd, midline_sd = np.abs(fit.z), np.angle(fit.z), fit.sd, fit.sd / np.sqrt(2)
    if wanders:
        # Means of the phase over the blocks, relative to the smooth phase. The residual in a block contains what the
        # spline does not follow, so that its sd is too large: amplitudes and midlines show theirs.
        further = fit.curves.phase(t) - phases_there
        off += np.array([further[a:b].mean() for a, b in parts])
        left = (np.log(size) - fit.curves.log_size(middles)) * size / sd
        sd = sd * np.sqrt(left @ left / (size.size - fit.curves.log_size.c.size))
        midline_sd = midline_sd * _scatter(fit.midline, 1 / midline_sd)
    else:
        curves = fit.curves
    # The covariance of the phases' errors: noise, a jump in each hole with uncounted cycles, and a random walk.
    covariance = np.diag((sd / size) ** 2)
    for jump, _ in steps:
        after = middles > jump
        covariance += (2 * np.pi) ** 2 * np.outer(after, after)
    rate = 0.0
    if wanders:
        # Of the means of a walk over blocks: a block's own variance is smaller by a sixth of its duration.
        walk = np.minimum.outer(middles, middles) - np.diag([(t[b - 1] - t[a]) / 6 for a, b in parts])
        rate = _walk_rate(middles, curves.phase(middles) + off, size, covariance, walk)
        covariance += rate * walk
    usual = float(np.median(sd))
    weights = usual / np.column_stack([sd, midline_sd])
    whitening = usual * np.linalg.inv(np.linalg.cholesky(covariance))
    track = _track(curves, middles, cycles / (TURNS * BLOCKS), weights, whitening)
    if track is None:
        return None
    residual[used] = fit.left
    until = track.times[:, -1].copy()
    until[-1] = max(until[-1], t[-1] / track.slowness)  # the last block ends where the record does
    return Averaged(
        t=np.repeat(until, NUMBERS),
        y=track.combine(size, off, fit.midline),
        track=track,
        noise=usual,
        samples=int(np.median([b - a for a, b in parts])) // 2,
        residual=residual,
        wander=float(np.sqrt(rate * t[-1])),
        jumps=tuple(jump for jump, _ in steps),
    )


def _long_pieces(t: np.ndarray) -> np.ndarray:
    """Return a mask (n,) of the samples, at times t (n,), that are in long enough pieces between holes.

    A piece at either end of the record must be at least a block long, because a motion is read over a whole block;
    others at least `SHORTEST` blocks. Each must have `LEAST_SAMPLES` samples.
    """
    block = float(t[-1]) / BLOCKS
    cuts = [0, *(np.flatnonzero(np.diff(t) > HOLE * block) + 1).tolist(), t.size]
    used = np.ones(t.size, bool)
    for a, b in pairwise(cuts):
        least = block if a == 0 or b == t.size else SHORTEST * block
        used[a:b] = t[b - 1] - t[a] >= least and b - a >= LEAST_SAMPLES
    return used


def _demodulated(
    t: np.ndarray, y: np.ndarray, features: Features
) -> tuple[np.ndarray, np.ndarray, np.ndarray, tuple[tuple[float, float], ...]]:
    """Return times in s, phases in rad and amplitudes of windows, (w,) each, and `_Curves.steps`.

    In a hole whose cycles cannot be counted the phase has a step, which is left out of the phases.
    """
    frequency = features.frequency
    share, number = np.modf(t * frequency / (2 * np.pi * WINDOW))
    firsts = np.flatnonzero(np.diff(number, prepend=-1.0))
    taper = np.sin(np.pi * share) ** 2
    weight = np.add.reduceat(taper, firsts)
    full = weight > FULL * np.median(weight)
    z, times = (
        np.add.reduceat(taper * values, firsts)[full] / weight[full]
        for values in (2 * (y - features.rest) * np.exp(-1j * frequency * t), t)
    )
    phases, steps = np.unwrap(np.angle(z)), []
    # Across a hole, whole cycles are counted by the smooth curves of the phase on either side.
    length = 2 * np.pi * WINDOW / frequency
    for i in np.flatnonzero(np.diff(times) > 1.5 * length):
        reach = max(times[i + 1] - times[i], LEAST_REACH * length)
        x = (times - 0.5 * (times[i] + times[i + 1])) / reach
        sides = [(np.abs(x) < REACH) & (x * sign > 0) for sign in (-1, 1)]
        counts = [np.count_nonzero(side) for side in sides]
        if min(counts) < 4:  # at an end of the record
            continue
        fits = [
            np.polyfit(x[side], phases[side], min(DEGREE, count // 4), cov=True)
            for side, count in zip(sides, counts, strict=True)
        ]
        turns = (fits[0][0][-1] - fits[1][0][-1]) / (2 * np.pi)
        sd = np.sqrt(sum(covariance[-1, -1] for _, covariance in fits)) / (2 * np.pi)
        if abs(turns - round(turns)) + 3 * sd > UNSURE:
            steps.append((0.5 * float(times[i] + times[i + 1]), -2 * np.pi * float(turns)))
        else:
            turns = round(turns)
        phases[i + 1 :] += 2 * np.pi * turns
    return times, phases + frequency * times, np.abs(z), tuple(steps)


@dataclass(frozen=True)
class _BlockFit:
    """The oscillation in b blocks, relative to curves of phase and amplitude.

    curves: the reference. z: amplitude and phase relative to the curves as complex numbers, (b,); |z| has the unit of
    the record. midline: (b,). sd: standard errors of the amplitudes, (b,). left: the residual, (n,). bent: the larger
    of the `_scatter` of amplitudes and of phases about the curves.
    """

    curves: _Curves
    z: np.ndarray
    midline: np.ndarray
    sd: np.ndarray
    left: np.ndarray
    bent: float


def _fit_curves(
    t: np.ndarray,
    y: np.ndarray,
    parts: list[tuple[int, int]],
    middles: np.ndarray,
    curves: _Curves,
    follows: bool = False,
) -> _BlockFit:
    """Fit the blocks, and correct the curves until they describe the blocks, because noise shifts the windows' phase.

    parts, middles: as of `_fit_blocks`. follows: whether the curve of the phase follows the record's phase closely, so
    that blocks cannot correct it.
    """
    fit = _fit_blocks(t, y, parts, middles, curves)
    for _ in range(1, PASSES):
        weight, curves = np.abs(fit.z) / fit.sd, fit.curves
        log = np.log(np.abs(fit.z)) - curves.log_size(middles)
        phase = curves.phase if follows else _plus(curves.phase, middles, np.angle(fit.z), weight)
        curves = replace(curves, phase=phase, log_size=_plus(curves.log_size, middles, log, weight))
        fit = _fit_blocks(t, y, parts, middles, curves, follows)
        if fit.bent < BENT:
            break
    return fit


def _fit_blocks(
    t: np.ndarray,
    y: np.ndarray,
    parts: list[tuple[int, int]],
    middles: np.ndarray,
    curves: _Curves,
    follows: bool = False,
) -> _BlockFit:
    """Fit the oscillation in each block by least squares, relative to the curves.

    parts: first and last + 1 sample of each block. middles: times of the blocks in s, (b,). follows: whether to leave
    the phases out of `_BlockFit.bent`.
    """
    fits, lefts, freedom = [], [], 0
    for (a, b), at in zip(parts, middles, strict=True):
        # The oscillation and a quarter period before it, both with an amplitude that grows along the block.
        own, phase = t[a:b], curves.phase_at(t[a:b])
        turned = np.exp(curves.log_size(own) - float(curves.log_size(at))) * np.exp(1j * phase)
        since = (own - own.mean()) / (0.5 * (own[-1] - own[0]))
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
    sd = np.sqrt(float(left @ left) / freedom * share)
    log, weight = np.log(np.abs(z)) - curves.log_size(middles), np.abs(z) / sd
    bent = max(_scatter(log, weight), 0.0 if follows else _scatter(np.angle(z), weight))
    return _BlockFit(curves, z, midline, sd, left, bent)


def _blocks(
    t: np.ndarray, phases: np.ndarray, block: float
) -> tuple[list[tuple[int, int]], tuple[float, float]]:
    """Return first and last + 1 sample of each block, and the least and greatest allowed middle of a block in s.

    block: approximate change of the phase in a block, in rad. phases: phase at times t, (n,). Blocks end before a hole
    and begin again after it.
    """
    cuts = [0, *(np.flatnonzero(np.diff(t) > HOLE * t[-1] / BLOCKS) + 1).tolist(), t.size]
    places = []
    for a, b in pairwise(cuts):
        number = max(1, round((phases[b - 1] - phases[a]) / block))
        inner = np.linspace(phases[a], phases[b - 1], number + 1)[1:-1]
        places += [a, *np.searchsorted(phases, inner).tolist()]
    low, high = np.interp([phases[0] + 0.5 * block, phases[-1] - 0.5 * block], phases, t)
    return list(pairwise([*places, t.size])), (low, high)


def _walk_rate(
    t: np.ndarray, phases: np.ndarray, sizes: np.ndarray, covariance: np.ndarray, walk: np.ndarray
) -> float:
    """Return the variance in rad²/s of a random walk of the phase, by restricted maximum likelihood.

    Without the walk, the phases would be those of a frequency that changes with the squared amplitude, which is
    estimated too (H. D. Patterson and R. Thompson, Biometrika 58, 545 (1971)). t, phases, sizes: times, phases and
    amplitudes of the blocks, (b,). covariance: of the other errors of the phases, (b, b). walk: covariance that a walk
    of 1 rad²/s would cause, (b, b).
    """
    power = np.square(sizes)
    energy = np.concatenate([[0.0], np.cumsum(0.5 * (power[1:] + power[:-1]) * np.diff(t))])
    columns = np.column_stack([np.ones_like(t), t / t[-1], energy / energy[-1]])

    def cost(log_rate: float) -> float:
        root = np.linalg.cholesky(covariance + np.exp(log_rate) * walk)
        whole = np.linalg.solve(root, np.column_stack([columns, phases]))
        triangle = np.abs(np.diag(np.linalg.qr(whole, mode="r")))
        return 2 * float(np.sum(np.log(np.diag(root))) + np.sum(np.log(triangle[:-1]))) + float(
            triangle[-1] ** 2
        )

    rough = float(
        np.sum(np.diff(phases - np.polynomial.Polynomial.fit(t, phases, 2)(t)) ** 2) / (t[-1] - t[0])
    )
    best = scipy.optimize.minimize_scalar(
        cost, bounds=(np.log(rough) - 10, np.log(rough) + 5), method="bounded"
    )
    return float(np.exp(best.x))


def _knots(t: np.ndarray, pieces: int, end: float) -> np.ndarray:
    """Return the knots of a cubic spline from 0 to `end`; each piece contains equally many of the times t, (m,)."""
    inner = np.quantile(t, np.linspace(0.0, 1.0, pieces + 1)[1:-1])
    return np.concatenate([[0.0] * 4, inner, [end] * 4])


def _smooth(t: np.ndarray, values: np.ndarray, weight: np.ndarray, knots: np.ndarray) -> BSpline:
    """Return the least-squares cubic spline, with the given knots, of values at times t, (m,).

    weight: 1/sd of each value, up to a factor, (m,).
    """
    return scipy.interpolate.make_lsq_spline(t, values, knots, 3, w=weight / weight.max())


def _plus(curve: BSpline, t: np.ndarray, values: np.ndarray, weight: np.ndarray) -> BSpline:
    """Return a spline plus the least-squares spline, with the same knots, of values at times t, (m,)."""
    more = _smooth(t, values, weight, curve.t)
    return scipy.interpolate.BSpline(curve.t, curve.c + more.c, 3)


def _scatter(values: np.ndarray, weight: np.ndarray) -> float:
    """Return the rms second difference of blocks' values, (b,), divided by that of independent noise of sd 1/weight."""
    return float(np.sqrt(np.mean((np.diff(values, 2) * weight[1:-1]) ** 2) / 6))


def _track(
    curves: _Curves, middles: np.ndarray, slowness: float, weights: np.ndarray, whitening: np.ndarray
) -> Track | None:
    """Return the blocks' points in the record and in the oscillation that is solved.

    None if these points are not in order of time or start before 0, as where the phase goes backwards. slowness:
    duration of the record divided by that of the oscillation that is solved.
    """
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
    return Track(slowness, times, phases, real[0], real_phases, weights, whitening)
