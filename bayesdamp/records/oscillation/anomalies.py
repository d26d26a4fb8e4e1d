"""Detect records that are not free decays: clipped peaks, lost sign (rectified), rising amplitude, tone burst."""

from itertools import pairwise

import numpy as np

from bayesdamp.records.oscillation.features import Features, true_runs
from bayesdamp.records.oscillation.modes import relative_rise
from bayesdamp.records.oscillation.noise import coarse_period, roughness
from bayesdamp.types import Signal

MIN_RISE = 0.02
"""The amplitude counts as rising if the range of half cycles (maximum minus minimum) grows again by more than this
fraction, beyond the noise. Measured: with a beat of 0.4 mm in a decay of 80 mm it grows by 0.027, in decays of one
oscillator by at most 0.01."""
SUCCESSIVE_HALF_CYCLES = 3
"""A rise of the amplitude counts only if this many successive half cycles are all larger than those before. A spike
changes only one turning point and thus two half cycles."""
MIN_FLAT_SAMPLES = 3
"""Smallest number of successive samples at the extreme value for a peak to count as clipped, if the values are not
rounded."""
FLAT_RATIO = 1.5
"""A peak of rounded values counts as clipped only if it stays at its extreme value more than this many times longer
than the peak of a sinusoid. The unclipped peaks of a pendulum at 2.8 rad also stay somewhat longer."""
# These limits decide whether a record is rectified (the absolute value or the square of an oscillation). All are
# conventional.
MIN_HALF_CYCLES = 6
"""A record counts as rectified (the absolute value or the square of an oscillation) only if it has at least this many
half cycles."""
MIN_PEAK = 0.3
"""The test for a rectified record uses half cycles only as long as their peak is above this fraction of the largest
peak; later ones may be noise and offsets."""
MAX_MINIMUM = 0.15
"""Between its peaks, a rectified record (the absolute value or the square of an oscillation) must fall below this
fraction of each peak. It does if a half cycle has at least eleven samples."""
MAX_LAST_PEAK = 0.8
"""In a rectified record (the absolute value or the square of an oscillation), the last peak must be below this fraction
of the first. Otherwise the record may be pulses or a counter, which do not decay."""
MAX_UNDERSHOOT, MAX_OFFSET, NOISE_SDS = 0.1, 0.05, 5
"""A rectified record has only one sign, except for noise and the sensor's zero offset: its largest value of the
opposite sign must be at most the fraction `MAX_UNDERSHOOT` of the largest peak. It must also be at most the fraction
`MAX_OFFSET` of this peak plus `NOISE_SDS` standard deviations of the noise. A step response that a high-pass filter
returns to zero has one sign at first, but then it crosses zero smoothly."""
MIN_MEDIAN = 0.3
"""In a rectified record, the median of the values in a half cycle must be above this fraction of its peak. It is 0.71
of the peak for |sin|, 0.5 for sin², and 0 for pulses."""
ENVELOPE_PER_PERIOD, MOST_ENVELOPE_SAMPLES = 24, 200_000
"""To decide whether a record is a tone burst, its envelope is computed from about `ENVELOPE_PER_PERIOD` samples in a
period, but at most `MOST_ENVELOPE_SAMPLES` samples in total."""
FLANK_LEVEL, FLANK_CYCLES, MAX_ASYMMETRY = 0.2, 3, 0.15
"""A record is a tone burst if the rising and the falling flank of its envelope have the same shape. Both flanks, above
`FLANK_LEVEL` times the peak, must last at least `FLANK_CYCLES` cycles and differ by less than `MAX_ASYMMETRY` times the
peak. Measured: they differ by up to 0.13 in tone bursts with 5 % noise, and by at least 0.6 in real decays with an
equally long rise."""

CLIPPED = "The peaks are cut off: the record stays at its extreme value."
RISES_AGAIN = "The amplitude rises again: possible causes are beats, a second mode or a drive."


def find_anomalies(signal: Signal, features: Features) -> tuple[str, ...]:
    """Return the reasons why a record may not be a free decay (`CLIPPED`, `RISES_AGAIN`); empty if there are none.

    features: features of the signal, from the function `features`.
    """
    faults = []
    if is_clipped(signal.y, features.samples_per_cycle):
        faults.append(CLIPPED)
    # Rounding shifts all samples near a turning point equally, so it does not average out: add half a step.
    noise = float(np.hypot(features.roughness, 0.5 * signal.step))
    if relative_rise(2 * features.swing_sizes, noise, SUCCESSIVE_HALF_CYCLES) > MIN_RISE:
        faults.append(RISES_AGAIN)
    return tuple(faults)


def is_clipped(y: np.ndarray, per_cycle: float) -> bool:
    """Return whether the peaks of a record are cut off (clipped) at an extreme value.

    A peak can be flat for other reasons: few levels, a sensor that repeats values, a body that sticks by friction, or a
    hand that holds it at the start. Then the record approaches its extreme slowly, whereas a clipped record reaches and
    leaves it at full speed.

    Parameters
    ----------
    y
        Equally spaced values, (n,).
    per_cycle
        Number of samples in a cycle.
    """
    size, levels = 0.5 * float(np.ptp(y)), np.unique(y)
    gaps = np.diff(levels)
    gaps = gaps[gaps > 1e-9 * size]
    if gaps.size == 0:
        return False
    step = float(np.median(gaps))
    # `repeats`: how often the sensor repeats each value, measured near the midline, where the motion is fast. If there
    # are only few levels, values also repeat, but then neighbouring values differ by one level (not `is_lone`).
    edges = np.flatnonzero(np.diff(y)) + 1
    begins, ends = np.concatenate([[0], edges]), np.concatenate([edges, [y.size]])
    is_fast = np.abs(y[begins] - 0.5 * (y.max() + y.min())) < 0.5 * size
    is_lone = np.abs(np.diff(y, prepend=y[0])[begins]) > 1.5 * float(np.diff(levels).min())
    moving = (ends - begins)[is_fast & is_lone]
    repeats = max(int(np.median(moving)), 1) if moving.size >= 5 else 1
    # `usual`: number of samples for which a sinusoid stays within one step of its extreme value.
    usual = np.arccos(max(1.0 - step / size, -1.0)) / np.pi * per_cycle
    limit = max(MIN_FLAT_SAMPLES, FLAT_RATIO * usual + 1) * repeats
    runs = [run for edge in (levels[0], levels[-1]) for run in true_runs(np.abs(y - edge) <= 1e-9 * size)]
    # At the ends of the record the body may be held or stick.
    runs = [(a, b) for a, b in runs if a > 0 and b < y.size]
    return any(limit <= b - a < 0.5 * per_cycle and _has_corners(y, a, b, per_cycle, step) for a, b in runs)


def _has_corners(y: np.ndarray, begin: int, end: int, per_cycle: float, step: float) -> bool:
    """Return whether y (n,) leaves a flat peak as fast as a clipped sinusoid, not as slowly as a body that stops there.

    Return False also if the flat peak is too long, or too near an end of the record, to decide. begin, end: index of
    the first sample of the flat peak, and of the first sample after it. per_cycle: number of samples in a cycle. step:
    usual difference of neighbouring levels, in the unit of y.
    """
    flat = end - begin
    phase = np.pi * flat / per_cycle  # half of the duration of the flat part
    away = max(round(per_cycle / 24), 2)
    near = y[max(begin - round(per_cycle), 0) : end + round(per_cycle)]
    height = abs(float(y[begin] - np.median(near)))  # clipping does not change the median
    if begin < away or end + away > y.size or phase > 1.4 or per_cycle <= 2.5 * flat:
        return False
    angle = 2 * np.pi * (away - 0.5) / per_cycle  # the flat part ends between two samples
    cut = height * (1 - np.cos(phase + angle) / np.cos(phase))
    # A body that stops at each turning point moves faster in between.
    stopped = height * (1 - np.cos(min(angle / (1 - 2 * flat / per_cycle), np.pi)))
    fallen = float(np.mean(np.abs(y[begin] - y[[begin - away, end - 1 + away]])))
    return bool(fallen > max(0.5 * (cut + stopped), stopped + step))


def is_rectified(y: np.ndarray) -> bool:
    """Return whether values y (n,) are the absolute value or the square of a decaying oscillation, with either sign.

    The values must be equally spaced in time. The result is True only if there are at least `MIN_HALF_CYCLES` half
    cycles whose peaks are above `MIN_PEAK` times the largest.
    """
    y = y if abs(y.max()) >= abs(y.min()) else -y
    if y.min() < -MAX_UNDERSHOOT * y.max():
        return False
    half_cycle, _ = coarse_period(index := np.arange(y.size, dtype=float), y)  # the period of |y|
    if y.size < MIN_HALF_CYCLES * half_cycle or half_cycle < 2:
        return False
    if y.min() < -MAX_OFFSET * y.max() - NOISE_SDS * roughness(index, y, half_cycle):
        return False
    halves = [y[begin:end] for begin, end in pairwise(np.arange(0.0, y.size, half_cycle).astype(int))]
    peaks = np.array([half.max() for half in halves])
    first = int(np.argmax(peaks))
    small = np.flatnonzero(peaks[first:] < MIN_PEAK * peaks[first])
    behind = first + int(small[0]) if small.size else peaks.size
    if behind - first < MIN_HALF_CYCLES:
        return False
    halves, peaks = halves[first:behind], peaks[first:behind]
    lowest = np.array([half.min() for half in halves]) / peaks
    middle = np.array([float(np.median(half)) for half in halves]) / peaks
    falls = peaks[-1] < MAX_LAST_PEAK * peaks[0]
    return bool(falls and lowest.max() < MAX_MINIMUM and np.median(middle) > MIN_MEDIAN)


def is_tone_burst(t: np.ndarray, y: np.ndarray, period: float) -> bool:
    """Return whether the envelope of a record rises in the same way as it falls, as that of a tone burst.

    The envelope is the amplitude at the strongest frequency, averaged over a period. In a free decay the rise is
    shorter or has another shape, because a hit, a release or a drive causes it.

    Parameters
    ----------
    t, y
        Times in s and values, each (n,).
    period
        Period of the strongest oscillation, s.
    """
    count = int(
        np.clip(ENVELOPE_PER_PERIOD * (t[-1] - t[0]) / period, 2 * ENVELOPE_PER_PERIOD, MOST_ENVELOPE_SAMPLES)
    )
    grid = np.linspace(t[0], t[-1], count)
    wave = (np.interp(grid, t, y) - np.median(y)) * np.exp(-2j * np.pi * grid / period)
    each = max(int(period / (grid[1] - grid[0])), 3)
    weights = np.hanning(each + 2)[1:-1]
    envelope = np.abs(np.convolve(wave, weights / weights.sum(), "same"))
    top = int(np.argmax(envelope))
    low = envelope < FLANK_LEVEL * envelope[top]
    before, after = np.flatnonzero(low[:top]), np.flatnonzero(low[top:])
    if not before.size or not after.size or min(top - before[-1], after[0]) < FLANK_CYCLES * each:
        return False
    off = np.arange(min(top - int(before[-1]), int(after[0])))
    return bool(np.abs(envelope[top - off] - envelope[top + off]).max() < MAX_ASYMMETRY * envelope[top])
