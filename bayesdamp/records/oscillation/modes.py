"""Fit a record as a sum of damped sinusoids, and decide whether it is the free decay of one oscillator."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise
from typing import Literal

import numpy as np
import scipy  # loads its modules when they are used

from bayesdamp.records.oscillation.features import LEAST_SHARE, wandering
from bayesdamp.records.oscillation.noise import roughness
from bayesdamp.records.oscillation.spectrum import averaged, coarse_period
from bayesdamp.records.oscillation.turning import zigzag

MOST = 1500
"""Samples that are fitted at most; in longer records, neighbours are averaged as long as `PER_CYCLE` samples remain in
a period."""
PER_CYCLE = 12
APART = 0.6
"""Distance of two frequencies, in 1 over the record's length, from which they are sought as two lines."""
PADDED = 4
"""Times its length to which a record is padded before its spectrum is taken."""
SEARCHED = 6_000
"""Samples that a search uses of a longer record, drawn from all of it at random, so that there is no aliasing; the
result is judged on all samples."""
EXPLAINED = 0.95
"""Share of what one damped sinusoid leaves that a second must explain, and of the whole that both must."""
SIGMAS = 6.0
"""Standard errors of a rate from which an oscillation grows."""
GROWN = 1.05
"""Factor by which an oscillation must grow over the record."""
CLOSE = 0.2
"""Relative distance of two frequencies below which only a rising amplitude distinguishes their sum from one oscillator:
the frequency of one oscillator may change with its amplitude by so much."""
HARMONIC = 0.05
"""Relative distance from a whole multiple of the first frequency below which a second is one oscillator's harmonic."""
LIFTED = 0.05
"""Rise of the amplitude, relative to itself then, from which close frequencies are two oscillations."""
CLEAR = 3.0
"""Standard deviations of a sample by which a range of a period must exceed an earlier one; its own is about one."""
TOGETHER = 2
"""Swings that must rise together."""
GONE, PASSING = 0.01, 15.0
"""Share of the first oscillation to which a second one must fall within so many cycles to be a passing one."""
STEADY = 0.1
"""Share of the other's decay rate below which a drive sustains an oscillation."""
HOLE = 0.2
"""Part of a period without a sample in which a turning point may be missed."""
CYCLES = 3.0
"""Cycles of the slower mode below which nothing is decided."""
WANDERING = 8.0
"""Cycles of a smaller, slower oscillation that does not decay below which it is a base line that wanders."""
UNSEEN = 3.0
"""Standard errors of a rate below which no decay is seen."""
SUSTAINED = 0.05
"""Fall of the amplitude over a record, or over its last third, below which something sustains it: for damping by a
power of the velocity up to the third, an amplitude that has halved falls by 10 % and more in the last third."""
HALVED = 2.0
"""Factor by which the amplitude falls at least before it stays."""
AGAIN, RISES, SLOWLY = 1.5, 4, 3
"""Factor by which an amplitude rises, how many times, and in how many periods at least, where it is excited
throughout."""
RISING = 0.25
"""Share of the record in which it does so, at least: half where chance does it, little where a hand lets go again and
again."""
ABOVE = 20.0
"""Standard deviations of a sample by which a range of a period must exceed it, to be an oscillation that stays."""


@dataclass(frozen=True)
class Modes:
    """Damped sinusoids, the largest first.

    Attributes
    ----------
    frequencies
        In Hz, (k,).
    rates, errors
        Decay rates in 1/s, below 0 where they grow, and their standard errors, each (k,).
    first, last
        Amplitudes at the first and the last time, each (k,).
    left
        Share of the variance about the midline that they do not explain.
    """

    frequencies: np.ndarray
    rates: np.ndarray
    errors: np.ndarray
    first: np.ndarray
    last: np.ndarray
    left: float

    @property
    def ratios(self) -> np.ndarray:
        """Damping ratios of the modes, (k,), each decay rate over its undamped angular frequency."""
        return self.rates / np.hypot(self.rates, 2 * np.pi * self.frequencies)


def damped_modes(t: np.ndarray, y: np.ndarray) -> Iterator[Modes]:
    """Fit one damped sinusoid and a constant to a record, then two, and so on, until no search converges.

    Amplitudes and phases are linear and solved for, frequencies and rates searched from the spectrum's lines.

    Parameters
    ----------
    t, y
        Times in s and values, each (n,).

    References
    ----------
    G. H. Golub and V. Pereyra, SIAM J. Numer. Anal. 10, 413 (1973): variable projection.
    """
    t, y = np.asarray(t, float) - t[0], np.asarray(y, float)
    points, rest = np.empty((0, 2)), y - y.mean()
    while fit := _add_mode(t, y, points, rest):
        points, rest = fit
        omega, rate = points.T
        columns = _columns(t, points)
        c = np.linalg.lstsq(columns, y, rcond=None)[0]
        size = np.hypot(c[1::2], c[2::2])
        ends = size * np.exp(-rate * t[-1])
        order = np.argsort(-np.maximum(size, ends))
        misfit = float(rest @ rest)
        variance = misfit / max(t.size - columns.shape[1] - points.size, 1)
        both = np.column_stack([columns, _slopes(t, columns, c)])
        spread = np.sqrt(variance * np.maximum(np.diag(np.linalg.pinv(both.T @ both)), 0.0))
        errors = spread[columns.shape[1] + 1 :: 2]
        left = misfit / max(float(np.sum((y - c[0]) ** 2)), 1e-300)
        yield Modes(omega[order] / (2 * np.pi), rate[order], errors[order], size[order], ends[order], left)


def _columns(t: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Return 1, and cosine and sine of each mode, (n, 1 + 2k); points: angular frequencies and rates, (k, 2)."""
    parts = [np.ones_like(t)]
    for omega, rate in points:
        fall = np.exp(-np.clip(rate * t, -50, 50))
        parts += [fall * np.cos(omega * t), fall * np.sin(omega * t)]
    return np.column_stack(parts)


def _slopes(t: np.ndarray, columns: np.ndarray, c: np.ndarray) -> np.ndarray:
    """Return the derivatives of columns (n, 1 + 2k) times c by angular frequencies and rates in turn, (n, 2k)."""
    slopes = np.empty((t.size, c.size - 1))
    for i in range(1, c.size, 2):
        pair = columns[:, i : i + 2]
        slopes[:, i - 1] = t * (pair @ np.array([c[i + 1], -c[i]]))
        slopes[:, i] = -t * (pair @ c[i : i + 2])
    return slopes


def _residuals(t: np.ndarray, y: np.ndarray, points: np.ndarray) -> np.ndarray:
    columns = _columns(t, points)
    return y - columns @ np.linalg.lstsq(columns, y, rcond=None)[0]


def _add_mode(
    t: np.ndarray, y: np.ndarray, points: np.ndarray, rest: np.ndarray
) -> tuple[np.ndarray, np.ndarray] | None:
    """Return the best fit with one mode more: its points, (k + 1, 2), and residuals, (n,); None without convergence.

    It is searched from the strongest line of the residuals `rest` of the fit with modes `points`, (k, 2), and from
    frequencies near these modes.
    """
    spacing = float(np.median(np.diff(t)))
    grid = np.arange(0.0, t[-1], spacing)
    values = np.interp(grid, t, rest)
    size = PADDED * grid.size
    power = np.abs(np.fft.rfft(values * np.hanning(grid.size + 2)[1:-1], size)) ** 2
    power[: PADDED * 2] = 0.0  # less than two cycles in a record are a drift
    bin_width = 2 * np.pi / t[-1]
    starts = [2 * np.pi * float(np.argmax(power)) / (size * spacing)]
    starts += [omega + side * bin_width for omega, _ in points for side in (-1.5, 1.5)]
    few, few_y = t, y
    if t.size > SEARCHED:
        some = np.sort(np.random.default_rng(0).choice(t.size, SEARCHED, replace=False))
        few, few_y = t[some], y[some]
    count = len(points) + 1
    scale = np.tile([bin_width, 1.0 / t[-1]], count)
    low = np.tile([0.5, -12.0], count)
    high = np.tile([np.pi / spacing / scale[0], 60.0], count)

    def residuals(z: np.ndarray) -> np.ndarray:
        return _residuals(few, few_y, (z * scale).reshape(-1, 2))

    def slopes(z: np.ndarray) -> np.ndarray:
        """Return the derivatives of the residuals, (n, 2k + 2), after Golub and Pereyra."""
        columns = _columns(few, (z * scale).reshape(-1, 2))
        inverse = np.linalg.pinv(columns)
        c = inverse @ few_y
        of_columns = _slopes(few, columns, c)
        turned = np.zeros((c.size, c.size - 1))  # the columns' own derivatives times the residuals
        along = (few * (few_y - columns @ c)) @ columns
        for i in range(1, c.size, 2):
            turned[i : i + 2, i - 1] = -along[i + 1], along[i]
            turned[i : i + 2, i] = -along[i : i + 2]
        return (columns @ (inverse @ of_columns) - of_columns - inverse.T @ turned) * scale

    best: tuple[np.ndarray, np.ndarray] | None = None
    for omega in starts:
        is_near = np.any(np.abs(points[:, 0] - omega) < APART * bin_width)
        if omega <= 0 or (best is not None and is_near):
            continue
        start = np.vstack([points, [omega, 1.0 / t[-1]]]).ravel() / scale
        start = np.clip(start, low + 1e-6, high - 1e-6)
        try:
            fit = scipy.optimize.least_squares(
                residuals, start, slopes, (low, high), max_nfev=60, x_scale=np.tile([0.1, 0.3], count)
            )
        except (ValueError, np.linalg.LinAlgError):
            continue
        modes = (fit.x * scale).reshape(-1, 2)
        left = _residuals(t, y, modes)
        if best is None or float(left @ left) < float(best[1] @ best[1]):
            best = modes, left
    return best


def few_samples(t: np.ndarray, y: np.ndarray, period: float) -> tuple[np.ndarray, np.ndarray]:
    """Return the record with at most `MOST` samples, or `PER_CYCLE` a period where that is more, by block averages."""
    cycles = float(t[-1] - t[0]) / period
    block = int(max(t.size // max(MOST, round(PER_CYCLE * cycles)), 1))
    block = min(block, max(int(period * t.size / float(t[-1] - t[0]) / PER_CYCLE), 1))
    return averaged(t, block), averaged(y, block)


@dataclass(frozen=True)
class OtherMotion:
    """The motion of a record that is not the free decay of one oscillator.

    Attributes
    ----------
    kind
        What it is.
    modes
        The oscillation that grows or stays, or both oscillations. Of one that is excited throughout, rates are nan, and
        amplitudes the least and the largest.
    size
        Of the second mode, relative to the largest amplitude of the first. Of growth, the factor by which it grows,
        less 1; of one that stays, 1; of one that is excited throughout, how many times its amplitude rises.
    """

    kind: Literal["growing", "steady", "beats", "two modes", "driven", "excited"]
    modes: Modes
    size: float


def find_other_motion(
    t: np.ndarray, y: np.ndarray, period: float, harmonics: bool = False
) -> OtherMotion | None:
    """Return what a record is, if not the free decay of one oscillator; None where nothing contradicts that.

    A second mode is accepted where two damped sinusoids explain nearly all, one does not, and both together do what no
    single oscillator does, be it linear or not: another frequency that is not a harmonic, or an amplitude that rises,
    or falls and then stays.

    Parameters
    ----------
    t, y
        Times in s and values, each (n,).
    period
        About the period of the oscillation, s.
    harmonics
        Whether a second mode at a whole multiple of the frequency, or one that soon decays, is accepted too.
    """
    t, y = few_samples(np.asarray(t, float), np.asarray(y, float), period)
    if t.size < 20:
        return None
    return _other_by_modes(t, y, harmonics) or excited(t, y, period)


def _other_by_modes(t: np.ndarray, y: np.ndarray, harmonics: bool) -> OtherMotion | None:
    """Return the motion of which one damped sinusoid that does not decay is the fit, or two are."""
    fits = damped_modes(t, y)
    single = next(fits, None)
    if single is None or single.left >= 1:
        return None
    duration = float(t[-1] - t[0])
    rate, error = float(single.rates[0]), float(single.errors[0])
    if single.left < 1 - EXPLAINED:
        if rate < -SIGMAS * error and single.last[0] > GROWN * single.first[0]:
            return OtherMotion("growing", single, float(single.last[0] / single.first[0] - 1))
        no_decay = rate < UNSEEN * error and (abs(rate) + 2 * error) * duration < SUSTAINED
        if single.frequencies[0] * duration > CYCLES and no_decay:
            return OtherMotion("steady", single, 1.0)
    two = next(fits, None)
    if two is None or two.left > (1 - EXPLAINED) or two.left > 0.5 * single.left:
        return None
    if not harmonics and passing(two, duration / 4):
        return None
    largest = np.maximum(two.first, two.last)
    size = float(largest[1] / largest[0])
    slowest, fastest = sorted(two.rates.tolist())
    # Steady: it does not halve in the record, while the other decays.
    steady = abs(slowest) < min(STEADY * fastest, np.log(HALVED) / duration)
    f, g = float(two.frequencies.min()), float(two.frequencies.max())
    if f * duration < CYCLES:
        return None
    slow = int(np.argmin(two.frequencies))
    if slow == 1 and f * duration < WANDERING and two.rates[slow] < UNSEEN * two.errors[slow]:
        return None  # a base line that wanders
    if g / f - 1 < CLOSE:
        ranges, noise = _ranges(t, y, 1 / f), float(np.std(y)) * two.left**0.5
        # The amplitude has fallen and stays, clear of the noise, for the last third; so does the slower mode.
        last = ranges[-(ranges.size // 3) :]
        levels = steady and last.size >= 3 * TOGETHER
        levels = levels and ranges[0] > HALVED * np.median(last) > HALVED * ABOVE * noise
        if levels:
            falls = (abs(slowest) + 2 * float(two.errors[np.argmin(two.rates)])) * duration / 3
            early, late = np.median(last[: last.size // 2]), np.median(last[-(last.size // 2) :])
            levels = falls < SUSTAINED and abs(early / late - 1) < SUSTAINED
        if lifted(ranges, noise) < LIFTED and not levels:
            return None
        return OtherMotion("driven" if steady else "beats", two, size)
    multiple = two.frequencies[1] / two.frequencies[0]
    if not harmonics and multiple > 1 and abs(multiple - round(multiple)) < HARMONIC * multiple:
        return None
    return OtherMotion("driven" if steady else "two modes", two, size)


def excited(t: np.ndarray, y: np.ndarray, period: float) -> OtherMotion | None:
    """Return the motion of a record whose amplitude rises again and again, as slowly as it falls, and ends unchanged.

    Random forces do this, or a hand that keeps pushing.

    Parameters
    ----------
    t, y
        Times in s and values, each (n,).
    period
        Of the oscillation, in s.

    Returns
    -------
    OtherMotion or None
        None where the amplitude does not behave so.
    """
    ranges = _ranges(t, y, period)
    if ranges.size < 3 * RISES * SLOWLY:
        return None
    third = ranges.size // 3
    before, after = float(np.median(ranges[:third])), float(np.median(ranges[-third:]))
    if not before < HALVED * after < HALVED**2 * before:  # also where the first third is constant
        return None
    noise = roughness(t, y, period)
    if (
        ranges.min() <= CLEAR * noise
        or coarse_period(t, y)[1] < LEAST_SHARE
        or wandering(t, y, period, noise)
    ):
        return None
    turns, _ = zigzag(np.log(ranges), np.full(ranges.size, np.log(AGAIN)))
    rises = [b - a for a, b in pairwise(turns[:-1]) if ranges[b] > ranges[a] and b - a >= SLOWLY]
    if len(rises) < RISES or sum(rises) < RISING * ranges.size:
        return None
    nan, f = np.array([np.nan]), np.array([1 / period])
    modes = Modes(f, nan, nan, np.array([0.5 * ranges.min()]), np.array([0.5 * ranges.max()]), 1.0)
    return OtherMotion("excited", modes, float(len(rises)))


def passing(two: Modes, longest: float) -> float:
    """Return for how long, in s, the faster decaying of two modes is seen at the beginning of a record.

    0 where that is more than a few cycles, or more than `longest`, s: then it is a mode, and not a filter's ringing.
    """
    fast, slow = int(np.argmax(two.rates)), int(np.argmin(two.rates))
    size = float(two.first[fast] / max(two.first[slow], 1e-300))
    long = float(np.log(max(size / GONE, 1.0)) / max(two.rates[fast] - two.rates[slow], 1e-300))
    return long if long < min(PASSING / float(two.frequencies[slow]), longest) else 0.0


def _ranges(t: np.ndarray, y: np.ndarray, period: float) -> np.ndarray:
    """Return the ranges of whole periods without a hole, in order."""
    edges = np.searchsorted(t, np.arange(t[0], t[-1], period))
    widest = max(HOLE * period, 2.5 * float(np.median(np.diff(t))))
    long = [(a, b) for a, b in pairwise(edges) if b - a > 3]
    return np.array([np.ptp(y[a:b]) for a, b in long if np.diff(t[max(a - 1, 0) : b + 1]).max() <= widest])


def lifted(ranges: np.ndarray, noise: float, together: int = TOGETHER) -> float:
    """Return by how much an amplitude significantly rises again after it has fallen, relative to itself then.

    Damping of any law takes energy: for one oscillator this is noise.

    Parameters
    ----------
    ranges
        Ranges of periods or of swings, (n,), in their order.
    noise
        Standard deviation of a sample.
    together
        The largest of so many ranges in a row is compared with the least of as many later ones.
    """
    if ranges.size < 2 * together:
        return 0.0
    runs = np.lib.stride_tricks.sliding_window_view(ranges, together)
    before, later = np.minimum.accumulate(runs.max(axis=1))[:-together], runs.min(axis=1)[together:]
    rises = later - before - CLEAR * noise
    return float(max(np.max(rises / np.maximum(later, 1e-300)), 0.0))
