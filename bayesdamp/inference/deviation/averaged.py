"""Reduce a record of hundreds of cycles or more to amplitudes, phases and midlines of about 64 blocks of cycles.

Candidates (sums of damping terms under a restoring law) are fitted to these values instead of the samples, because
their number does not grow with the number of cycles. The solver does not integrate all cycles. It integrates a
compressed oscillation, which has M times the damping and 1/M of the cycles, and therefore decays through the same
amplitudes (see `bayesdamp.physics.kernel.averaged`).
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
"""If a fit to averages over blocks of cycles is not accurate enough, the samples are fitted instead, but only in a
record of at most this many cycles: the Jacobian of its motion takes 1 GB of memory (measured). From this length on, a
record whose phase wanders may be averaged although its amplitude is not smooth (`average_of`)."""
FEWEST_CYCLES = 400.0
"""A record with at least this many cycles is reduced to amplitudes and phases of blocks of cycles (conventional)."""
BLOCKS = 64
"""Number of blocks into which a record of very many cycles is divided. The solver integrates a compressed oscillation
with only `TURNS` cycles in each block, which has more damping and decays through the same amplitudes. For a record of
400 cycles, the damping of the compressed oscillation is three times that of the record. Its damping ratio is then 0.4 %
if the amplitude falls to a twentieth over the record."""
PIECES = 20
"""Number of polynomial pieces of each smooth cubic spline through a record of very many cycles. One spline follows the
logarithm of the amplitude and one the phase, both against time."""
LEAST_SAMPLES = 24
"""Smallest number of samples in a block of cycles. If a block has fewer, the record is not reduced to amplitudes and
phases. A part of the record before, between or after holes (`HOLE`) that has fewer is left out."""
HOLE = 0.4
"""A gap between neighbouring samples that is longer than this fraction of a block's duration is a hole. No block of
cycles extends over a hole: one block ends before it and another begins after it (conventional)."""
SHORTEST = 0.25
"""A piece of the record between two holes (long gaps) is left out if its duration is less than this fraction of a
block's duration (conventional). The pieces before the first and after the last hole must last a whole block."""
WINDOW = 4.0
"""Length in cycles of the windows in which a record is demodulated for the first estimates of its phase and
amplitude."""
FULL = 0.7
"""A short window in which the record is demodulated is used only if it has enough samples: the sum of their taper
weights must be larger than this fraction of the median sum over all windows (conventional)."""
REACH = 2.5
"""Range of the data from which the cycles in a hole (a long gap in the record) are counted, on either side of the hole,
in lengths of the hole from its middle (conventional). One polynomial is fitted to the phase before the hole and one to
the phase after it; their difference in the middle gives the number of cycles."""
LEAST_REACH = 10.0
"""The cycles in a hole (a long gap in the record) are counted from the data within a range that is proportional to the
length of the hole (`REACH`). A hole that is shorter than this many demodulation windows (of `WINDOW` cycles) counts as
this long (conventional)."""
DEGREE = 3
"""Largest degree of the polynomials through the phase before and after a hole (a long gap in the record), from which
the number of cycles in the hole is computed (see `REACH`; conventional)."""
UNSURE = 0.25
"""The number of cycles in a hole (a long gap in the record) is estimated as a real number with a standard deviation. It
counts as known if its distance from the nearest whole number, plus three standard deviations, is at most this many
cycles. Otherwise the phase after the hole is unknown (conventional)."""
FOLLOWED = 8
"""Number of demodulation windows (of `WINDOW` cycles) in each piece of the spline that follows a randomly wandering
phase. With so many windows in a piece, the noise hardly shifts the spline."""
OVERTONES = 3
"""Highest harmonic of the oscillation that is fitted in each block of cycles. The fundamental is number 1."""
BENT = 3.0
"""Largest accepted roughness (`_scatter`) of the deviations of the blocks' amplitudes and phases from smooth curves
against time (`average_of` names two exceptions). The roughness is 1 for white noise alone. At 3, the mean over a block
differs from the value in its middle by 0.3 sds."""
PASSES = 3
"""Largest number of times that amplitudes and phases are fitted to the blocks; between two fits the smooth curves of
amplitude and phase are corrected by the result."""
ROUNDS = 10
"""Largest number of refits for noise that is not Gaussian. Each is a least-squares fit to modified values, the motion
plus `FittedNoise.working_residuals`; with these, repeated least squares converge to the most probable motion."""
SETTLED = 0.05
"""The refits for noise that is not Gaussian (`ROUNDS`) end when the last one changed the motion by less than this: norm
of the change over all samples, in sds of the noise of a sample."""
MOST_SHIFT = 0.1
"""Largest shift of a parameter by the remaining error of averaged motions (`Averaging.error`), in posterior sds, at
which they are accurate enough. Otherwise the samples are fitted, unless the record has more than `MOST_CYCLES`
cycles."""


@dataclass(frozen=True)
class Averaged:
    """A record that is reduced to the amplitude, phase and midline of each of b blocks of cycles.

    Attributes
    ----------
    t : ndarray, shape (3b,)
        Ends of the blocks in s, each repeated for the three values of y. They are times of the compressed oscillation,
        which is solved in place of the record. It decays through the same amplitudes in fewer cycles.
    y : ndarray, shape (3b,)
        Amplitude, phase and midline of each block in turn; the phase is relative to the phase of `track`. They are
        multiplied by the factors of `track`, so that all have the record's unit and independent noise of the same sd.
        An `AveragedSolver` returns motions in the same form.
    track : Track
        Times and phases, in the record and in the compressed oscillation, at which each block is measured.
    noise : float
        Standard deviation of the noise of each value of y, in the record's unit.
    samples : int
        Half the median number of samples in a block: the noise of a value of y has about 1/`samples` of the variance of
        a sample's noise.
    residual : ndarray, shape (n,)
        Each sample of the record minus the oscillation fitted to its block, in the record's unit; 0 for samples that
        are in no block.
    wander : float
        Standard deviation of the phase at the record's end because of its random walk, in rad; 0 if the phase is
        smooth.
    jumps : tuple of float
        Times in s of the middles of gaps in the record in which the cycles cannot be counted.
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
    """The error of a record's inferred parameters because the motion is averaged over blocks of cycles.

    Attributes
    ----------
    cycles : float
        Number of cycles in the used part of the record.
    error : float
        Largest shift of an inferred parameter of the most probable model, in posterior sds, by the error of its
        averaged motion that remains after the correction with the full equation (`AveragedSolver.defect`). Displacement
        and velocity at the start are not included. Infinite if the equation of motion cannot be solved.
    """

    cycles: float
    error: float

    @property
    def close(self) -> bool:
        """Return whether averages over blocks of cycles are accurate enough: `error` is at most `MOST_SHIFT`."""
        return self.error <= MOST_SHIFT


@dataclass(frozen=True)
class _Curves:
    """Splines of the phase in rad and of the log amplitude against time in s.

    phase, log_size: the splines of the phase and of the log amplitude. steps: one pair for each long gap of the record
    in which the number of cycles is not known, with the time in s of the middle of the gap, and a step in rad. After
    this time the step is added to the spline of the phase.
    """

    phase: BSpline
    log_size: BSpline
    steps: tuple[tuple[float, float], ...] = ()

    def phase_at(self, t: np.ndarray) -> np.ndarray:
        """Return the phase in rad, (n,), at times t in s, (n,): the spline plus all steps before each time."""
        return self.phase(t) + sum((size * (t > at) for at, size in self.steps), np.zeros(1))


def average_of(
    t: np.ndarray, y: np.ndarray, features: Features, noise: FittedNoise | None = None
) -> Averaged | None:
    """Reduce a record to amplitudes, phases and midlines of blocks of cycles; None if this is not possible.

    It is not possible

    - if the record has fewer than `FEWEST_CYCLES` cycles, or a block has fewer than `LEAST_SAMPLES` samples;
    - if the phase does not increase along the record;
    - if amplitude or phase do not change smoothly (`BENT`). There are two exceptions if the record has more than about
      700 cycles, not counting gaps: a randomly wandering phase is accepted, and from `MOST_CYCLES` cycles on a rough
      amplitude too.

    Parameters
    ----------
    t, y : ndarray, shape (n,)
        Increasing times in s, from 0, and recorded values, in any unit ("the record's unit").
    features : Features
        Features of the record; only period, frequency and midline are used.
    noise : FittedNoise, optional
        Noise model of the samples; the amplitudes and phases are the most probable ones under it. By default they are
        those of least squares (white Gaussian noise).
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
    """Reduce recorded values to amplitudes and phases of blocks of cycles by least squares.

    In each block, amplitude and phase are fitted relative to smooth curves. If the phase of the record wanders too much
    for a smooth curve, it is fitted relative to a spline that follows it closely, and its deviation from the smooth
    curve is treated as a random walk. Parameters and result are those of `average_of`, which lists the cases in which
    the result is None.
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
        # Add the mean difference of the two splines, so that the phases of the blocks are relative to the smooth one.
        # The residual in a block contains the fast wandering that the spline does not follow, so that the sds from it
        # are too large. Estimate the sds from the scatter of the amplitudes and of the midlines instead.
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
        # Covariance of the means over blocks of a random walk of 1 rad²/s. The variance of a mean is that of the walk
        # in the middle of the block, minus a sixth of the block's duration.
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
    """Return a mask, (n,), of the samples that are in long enough pieces of the record, between holes (long gaps).

    A hole is a gap longer than `HOLE` blocks; a block lasts 1/`BLOCKS` of the record. The first and the last piece must
    last at least one block, because the amplitude and phase of a motion are measured over a whole block. The other
    pieces must last at least `SHORTEST` blocks. Each piece must have at least `LEAST_SAMPLES` samples. t: times of the
    samples in s, (n,).
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
    """Demodulate a record in short windows (`WINDOW`), and count the cycles across holes (gaps between windows).

    Return times in s, unwrapped phases in rad and amplitudes in the record's unit of the w windows, (w,) each, and the
    steps for `_Curves.steps`. A window that has few samples (`FULL`) is left out. A hole with fewer than four windows
    near it (`REACH`) before or after it is ignored. The whole cycles that are counted in another hole are added to the
    phases after it. If they cannot be counted (`UNSURE`), these phases are shifted so that they continue smoothly, and
    the step of this hole undoes the shift. t, y, features: as in `average_of`.
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
    # Count the whole cycles in a hole (a long gap) by polynomials through the phase on either side.
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
    """Least-squares fits of the oscillation in b blocks of cycles, relative to smooth curves of phase and amplitude.

    curves: these curves. z: complex amplitudes, (b,): |z| is the amplitude in the record's unit, and the argument is
    the phase minus that of the curve, in rad. midline: midlines of the blocks, (b,). sd: standard errors of the
    amplitudes, (b,). left: residuals of all samples, (n,); midline, sd and left are in the record's unit. bent:
    roughness (`_scatter`) of the amplitudes or of the phases about the curves, whichever is larger. If the curve
    follows a wandering phase, it is the roughness of the amplitudes.
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
    """Fit the oscillation in each block, and correct the curves of amplitude and phase until they describe the blocks.

    The given `curves` come from short windows, whose noise shifts them. At least two and at most `PASSES` fits are
    made. They end when the roughness of the blocks about the curves (`_BlockFit.bent`) is below `BENT`; the last fit is
    returned in any case. t, y, parts, middles: as in `_fit_blocks`. follows: whether the curve of the phase follows a
    wandering phase closely; it is then not corrected.
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
    """Fit the oscillation, its midline and its harmonics in each block by least squares, relative to the curves.

    t, y: times in s and recorded values, (n,). parts: indices of each block's first sample and of the sample after its
    last. middles: times of the blocks in s, (b,). curves: curves of phase and amplitude against time. follows: if true,
    `_BlockFit.bent` (the roughness about the curves) does not include the phases.
    """
    fits, lefts, freedom = [], [], 0
    for (a, b), at in zip(parts, middles, strict=True):
        # Cosine and minus sine of the phase times the amplitude, each also multiplied by the time since the middle,
        # because amplitude and phase may change along the block.
        own, phase = t[a:b], curves.phase_at(t[a:b])
        turned = np.exp(curves.log_size(own) - float(curves.log_size(at))) * np.exp(1j * phase)
        since = (own - own.mean()) / (0.5 * (own[-1] - own[0]))
        columns = [turned.real, -turned.imag, np.ones_like(own), since * turned.real, -since * turned.imag]
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
    """Divide a record into blocks of about the same change of the phase, which do not extend over holes (`HOLE`).

    Return the indices of each block's first sample and of the sample after its last. Return also the least and the
    greatest time in s that the middle of a block may have: half a `block` after the first and before the last sample.
    t: times in s, (n,). phases: the phase at these times in rad, (n,). block: approximate change of the phase in a
    block, in rad; a block between two holes may be shorter.
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
    """Estimate the variance of the phase's random walk per unit time, in rad²/s, by restricted maximum likelihood.

    The phase without the walk is the integral of a frequency that depends linearly on the squared amplitude; this
    dependence is estimated too (H. D. Patterson and R. Thompson, Biometrika 58, 545 (1971)). t, phases, sizes: times in
    s, phases in rad and amplitudes of the blocks, (b,) each. covariance: covariance of the other errors of the phases,
    (b, b). walk: covariance that a walk of 1 rad²/s would cause, (b, b).
    """
    power = np.square(sizes)
    energy = np.concatenate([[0.0], np.cumsum(0.5 * (power[1:] + power[:-1]) * np.diff(t))])
    columns = np.column_stack([np.ones_like(t), t / t[-1], energy / energy[-1]])

    def cost(log_rate: float) -> float:
        root = np.linalg.cholesky(covariance + np.exp(log_rate) * walk)
        whole = np.linalg.solve(root, np.column_stack([columns, phases]))
        triangle = np.abs(np.diag(np.linalg.qr(whole, mode="r")))
        logs = np.sum(np.log(np.diag(root))) + np.sum(np.log(triangle[:-1]))
        return 2 * float(logs) + float(triangle[-1] ** 2)

    trend = np.polynomial.Polynomial.fit(t, phases, 2)
    rough = np.log(float(np.sum(np.diff(phases - trend(t)) ** 2) / (t[-1] - t[0])))
    best = scipy.optimize.minimize_scalar(cost, bounds=(rough - 10, rough + 5), method="bounded")
    return float(np.exp(best.x))


def _knots(t: np.ndarray, pieces: int, end: float) -> np.ndarray:
    """Return the knots of a cubic spline from 0 to `end`, (pieces + 7,), where each end occurs four times.

    Each of the `pieces` polynomial pieces contains equally many of the times t, (m,). All times are in s.
    """
    return np.concatenate([[0.0] * 4, np.quantile(t, np.linspace(0.0, 1.0, pieces + 1)[1:-1]), [end] * 4])


def _smooth(t: np.ndarray, values: np.ndarray, weight: np.ndarray, knots: np.ndarray) -> BSpline:
    """Fit a cubic spline with given knots (see `_knots`) to values at times t in s, (m,) each, by least squares.

    weight: 1/sd of each value, up to a factor, (m,).
    """
    return scipy.interpolate.make_lsq_spline(t, values, knots, 3, w=weight / weight.max())


def _plus(curve: BSpline, t: np.ndarray, values: np.ndarray, weight: np.ndarray) -> BSpline:
    """Return a spline plus another one, which is fitted to values at times t in s, (m,) each, by least squares.

    Both splines have the knots of `curve`. weight: 1/sd of each value, up to a factor, (m,).
    """
    return scipy.interpolate.BSpline(curve.t, curve.c + _smooth(t, values, weight, curve.t).c, 3)


def _scatter(values: np.ndarray, weight: np.ndarray) -> float:
    """Return the roughness of values of the blocks: their rms second difference, divided by that of white noise.

    It is 1 for white noise alone. values: one for each block, (b,). weight: 1/sd of the noise of each value, (b,).
    """
    return float(np.sqrt(np.mean((np.diff(values, 2) * weight[1:-1]) ** 2) / 6))


def _track(
    curves: _Curves, middles: np.ndarray, slowness: float, weights: np.ndarray, whitening: np.ndarray
) -> Track | None:
    """Return the times and phases at which each block is measured, in the record and in the compressed oscillation.

    The compressed oscillation is solved in place of the record; it decays through the same amplitudes in fewer cycles.
    None if its times do not increase or are negative, for example if the phase decreases. curves: phase and amplitude
    of the record against time. middles: times of the blocks in the record in s, (b,). slowness: duration of the record
    divided by that of the compressed oscillation. weights, whitening: factors of amplitudes and midlines, (b, 2), and
    matrix for the phases, (b, b), that give all values independent noise of the same variance.
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
