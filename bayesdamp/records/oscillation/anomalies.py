"""Detect what is not a free decay: clipped peaks, a lost sign, an amplitude that rises, a tone burst."""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from bayesdamp.records.oscillation.features import Features
from bayesdamp.records.oscillation.modes import lifted
from bayesdamp.records.oscillation.spectrum import coarse_period
from bayesdamp.records.oscillation.turning import true_runs
from bayesdamp.types import Signal

RISE = 0.02
"""Share by which later swings must significantly exceed earlier ones. Measured: a beat of 0.4 mm in a decay of 80 mm
rises by 0.027, decays of one oscillator by 0.01 at most."""
TOGETHER = 3
"""Swings that must rise together: a spike spoils one turning point, and with it two swings."""
FLAT = 3
"""Samples in a row at the extreme value that chance does not explain where values are not rounded."""
MARGIN = 1.5
"""How much longer than a sinusoid a rounded record must stay at its extreme: a pendulum at 2.8 rad does."""
FEWEST = 6
"""Fewest half-cycles for a decision."""
LARGE = 0.3
"""Share of the largest peak down to which half-cycles are used: below are noise and offsets."""
TOUCHES = 0.15
"""Share of a peak to which the record falls on either side: with eleven samples a half-cycle or more it does."""
FALLS = 0.8
"""Largest share of the first peak that the last one has: pulses, or a counter, do not decay."""
NOISE = 0.1
"""Largest excursion below zero that noise may cause in values of one sign, as a share of the largest peak."""
BETWEEN = 0.3
"""Least share of a peak that the median of its half-cycle has: 0.71 for |sin|, 0.5 for sin², near 0 for pulses."""
PER_PERIOD, MOST = 24, 200_000
"""Samples in a period, and most in a record, from which the envelope is computed."""
FLANK, FLANK_CYCLES, MIRRORED = 0.2, 3, 0.15
"""Share of its peak from which an envelope's flanks are compared, their fewest cycles, and the share of the peak by
which the two may differ. Measured: tone bursts differ by up to 0.13 at a twentieth of noise, real decays whose rise is
so long by 0.6 and more."""

CLIPPED = "The peaks are cut off: the record stays at its extreme value."
RISES = "The amplitude rises again, which beats, a second mode or a drive would cause."


def anomalies(signal: Signal, features: Features) -> tuple[str, ...]:
    """Return sentences on what is wrong with a record as a free decay."""
    faults = []
    if clipped(signal.y, features.samples_per_cycle):
        faults.append(CLIPPED)
    # Rounding shifts all samples about a turning point equally.
    noise = float(np.hypot(features.roughness, 0.5 * signal.step))
    if lifted(2 * features.swing_sizes, noise, TOGETHER) > RISE:
        faults.append(RISES)
    return tuple(faults)


def clipped(y: np.ndarray, per_cycle: float) -> bool:
    """Return whether a record stays at an extreme value because it was cut off there.

    A peak is flat for other reasons too: few levels, a sensor that repeats its values for some samples, a body that
    friction stops, a hand that holds it at the start. Then the record approaches its extreme slowly, whereas a clipped
    one reaches and leaves it at full speed.

    Parameters
    ----------
    y
        Equally spaced values, (n,).
    per_cycle
        Samples a cycle.
    """
    size = 0.5 * float(np.ptp(y))
    levels = np.unique(y)
    gaps = np.diff(levels)
    gaps = gaps[gaps > 1e-9 * size]
    if gaps.size == 0:
        return False
    step = float(np.median(gaps))
    # A sensor may repeat a value for some samples, also in the middle of the swings, where all moves. Few levels repeat
    # as well, but then the steps between them are the motion in so many samples.
    edges = np.flatnonzero(np.diff(y)) + 1
    begins, ends = np.concatenate([[0], edges]), np.concatenate([edges, [y.size]])
    is_fast = np.abs(y[begins] - 0.5 * (y.max() + y.min())) < 0.5 * size
    is_lone = np.abs(np.diff(y, prepend=y[0])[begins]) > 1.5 * float(np.diff(levels).min())
    moving = (ends - begins)[is_fast & is_lone]
    repeats = max(int(np.median(moving)), 1) if moving.size >= 5 else 1
    # A sinusoid that just reaches the extreme level stays within one step of it for this share of a cycle.
    usual = np.arccos(max(1.0 - step / size, -1.0)) / np.pi * per_cycle
    limit = max(FLAT, MARGIN * usual + 1) * repeats
    runs = [run for edge in (levels[0], levels[-1]) for run in true_runs(np.abs(y - edge) <= 1e-9 * size)]
    runs = [(a, b) for a, b in runs if a > 0 and b < y.size]  # at its ends it may be held, or stick
    return any(limit <= b - a < 0.5 * per_cycle and _has_corners(y, a, b, per_cycle, step) for a, b in runs)


def _has_corners(y: np.ndarray, begin: int, end: int, per_cycle: float, step: float) -> bool:
    """Return whether y leaves its flat peak like a sinusoid that is cut off, rather than like one that turns there."""
    flat = end - begin
    phase = np.pi * flat / per_cycle  # half of what is flat
    away = max(round(per_cycle / 24), 2)
    near = y[max(begin - round(per_cycle), 0) : end + round(per_cycle)]
    height = abs(float(y[begin] - np.median(near)))  # a cut does not change the median
    if begin < away or end + away > y.size or phase > 1.4 or per_cycle <= 2.5 * flat:
        return False
    angle = 2 * np.pi * (away - 0.5) / per_cycle  # the flat part ends between two samples
    cut = height * (1 - np.cos(phase + angle) / np.cos(phase))
    # Where it rests at each turn, it swings faster in between.
    turned = height * (1 - np.cos(min(angle / (1 - 2 * flat / per_cycle), np.pi)))
    fallen = float(np.mean(np.abs(y[begin] - y[[begin - away, end - 1 + away]])))
    return bool(fallen > max(0.5 * (cut + turned), turned + step))


def rectified(y: np.ndarray) -> bool:
    """Return whether equally spaced values y (n,) are a decaying oscillation without its sign, |y| or y²."""
    y = y if abs(y.max()) >= abs(y.min()) else -y
    if y.min() < -NOISE * y.max():
        return False
    half_cycle, _ = coarse_period(np.arange(y.size, dtype=float), y)  # from a peak to the next
    if y.size < FEWEST * half_cycle or half_cycle < 2:
        return False
    edges = np.arange(0.0, y.size, half_cycle).astype(int)
    halves = [y[begin:end] for begin, end in pairwise(edges)]
    peaks = np.array([half.max() for half in halves])
    first = int(np.argmax(peaks))
    small = np.flatnonzero(peaks[first:] < LARGE * peaks[first])
    behind = first + int(small[0]) if small.size else peaks.size
    if behind - first < FEWEST:
        return False
    halves, peaks = halves[first:behind], peaks[first:behind]
    lowest = np.array([half.min() for half in halves]) / peaks
    middle = np.array([float(np.median(half)) for half in halves]) / peaks
    falls = peaks[-1] < FALLS * peaks[0]
    return bool(falls and lowest.max() < TOUCHES and np.median(middle) > BETWEEN)


def tone_burst(t: np.ndarray, y: np.ndarray, period: float) -> bool:
    """Return whether a record rises in the way it falls, as a windowed tone does.

    The envelope is that of the strongest frequency, averaged over a period. A free decay falls by its damping, but
    rises in a hit, in a release, or by a drive.

    Parameters
    ----------
    t, y
        Times in s and values, each (n,).
    period
        Of the strongest oscillation, s.
    """
    count = int(np.clip(PER_PERIOD * (t[-1] - t[0]) / period, 2 * PER_PERIOD, MOST))
    grid = np.linspace(t[0], t[-1], count)
    wave = (np.interp(grid, t, y) - np.median(y)) * np.exp(-2j * np.pi * grid / period)
    each = max(int(period / (grid[1] - grid[0])), 3)
    weights = np.hanning(each + 2)[1:-1]
    envelope = np.abs(np.convolve(wave, weights / weights.sum(), "same"))
    top = int(np.argmax(envelope))
    low = envelope < FLANK * envelope[top]
    before, after = np.flatnonzero(low[:top]), np.flatnonzero(low[top:])
    if not before.size or not after.size or min(top - before[-1], after[0]) < FLANK_CYCLES * each:
        return False
    off = np.arange(min(top - int(before[-1]), int(after[0])))
    return bool(np.abs(envelope[top - off] - envelope[top + off]).max() < MIRRORED * envelope[top])
