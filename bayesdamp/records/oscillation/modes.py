"""Fit a record as a sum of damped sinusoids, and decide whether it is the free decay of one oscillator."""

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise
from typing import Literal

import numpy as np

from bayesdamp.numerics.levenberg_marquardt import Expansion, Step, levenberg_marquardt
from bayesdamp.records.oscillation.features import reason_not_oscillating, zigzag
from bayesdamp.records.oscillation.noise import LEAST_SHARE, block_means, coarse_period, roughness

LEAST_AVERAGED = 1500
"""Neighbouring samples are averaged in blocks before the fit. At least this many block means remain, and at least
`PER_CYCLE` means in a period (conventional)."""
PER_CYCLE = 12
"""Smallest number of block means in a period when neighbouring samples are averaged in blocks before the fit. With
fewer samples in a period, the amplitude is measured by a fitted sinusoid (conventional)."""
MIN_SEPARATION = 0.6
"""The search for a new mode is not started at a frequency that differs from that of a mode already in the fit by less
than this, in units of 1 / (duration of the record). An exception is the strongest line of the residuals."""
PADDING = 4
"""Factor by which padding with zeros lengthens a record before its spectrum is computed (conventional)."""
TOLERANCE = 1e-8
"""The search for modes ends when a step reduces the sum of squares by less than this fraction (as in SciPy)."""
MOST_SEARCHED = 6_000
"""Largest number of samples in the search for a mode. From a longer record, this many samples are drawn at random,
which avoids aliasing. The resulting fit is then judged on all samples (conventional)."""
# Unless their text says otherwise, these thresholds were chosen on simulated and measured records.
MIN_EXPLAINED = 0.95
"""A record counts as two oscillations only if two damped sinusoids explain at least this fraction of its variance. It
counts as one that grows or stays constant only if one damped sinusoid does."""
GROWTH_SIGMAS = 6.0
"""An oscillation counts as growing only if its decay rate is below zero by more than this many standard errors."""
MIN_GROWTH = 1.05
"""An oscillation counts as growing only if its amplitude grows by more than this factor over the record."""
CLOSE_FREQUENCIES = 0.2
"""Two frequencies that differ by less than this fraction may belong to one oscillator whose frequency changes with its
amplitude. So may two that differ by less than the mean of their line widths (decay rate / π). Further evidence, such
as a rising amplitude, must then show that there are two oscillators."""
HARMONIC_TOLERANCE = 0.05
"""A second frequency counts as a harmonic of one oscillator if it differs from a multiple of the first frequency by
less than this fraction."""
EXACT_HARMONIC, HARMONIC_SIZE = 0.004, 0.04
"""A second frequency that is a multiple of the first except for less than the fraction `EXACT_HARMONIC`, with an
amplitude below `HARMONIC_SIZE` times that of the first, is a harmonic of one oscillator even if no law fits. For
example, the force of structural damping jumps, and so contains the third harmonic."""
MOST_DAMPED = 0.5
"""A damped sinusoid is not one of two oscillations if its damping ratio is above this."""
MIN_RISE = 0.05
"""Two close frequencies count as two oscillations if the amplitude, after it has fallen, rises again by at least this
fraction of its value after the rise."""
RISE_SIGMAS = 3.0
"""To measure a rise of the amplitude, the ranges (maximum minus minimum) of periods are compared. A rise of the range
is reduced by this many standard deviations of the noise of a sample."""
LEAST_BEATS = 1.0
"""If the amplitude never rises, two close frequencies count as two oscillations only if there are more than this many
beats within the time in which one decays by a factor e more than the other. With fewer beats, they look like one
oscillator whose frequency changes with its amplitude."""
NATS_AHEAD, RATES_ALIKE, SIZES_ALIKE, LEAST_WIDTHS = 50.0, 2.0, 0.9, 0.35
"""Two close frequencies also count as two oscillations if their fit is ahead of that of the best law of one oscillator
by at least `NATS_AHEAD` nats of log likelihood, and one of them decays less than `RATES_ALIKE` times as fast as the
other, as the two modes of a nearly symmetric body do. The smaller one must have less than `SIZES_ALIKE` times the
amplitude of the other: two equal sinusoids that have not yet cancelled have a constant frequency, and an amplitude like
that of one oscillator whose damping ratio increases as it decays, such as with an eddy-current brake. The frequencies
must differ by at least `LEAST_WIDTHS` of the mean line width (decay rate / π): closer ones look like one oscillator
with a damper whose force bends. Of 150 simulated and 20 measured decays of one oscillator none fulfilled all four."""
MOST_MISFIT = 1.3
"""Two modes explain a record to its noise if the rms residual is below this many standard deviations of the noise."""
SUCCESSIVE_PERIODS = 2
"""A rise of the amplitude counts only if the ranges (maximum minus minimum) of this many successive periods are all
larger than those of as many successive periods before."""
GONE_FRACTION, TRANSIENT_CYCLES = 0.01, 15.0
"""A second oscillation is only a transient if its amplitude falls below `GONE_FRACTION` times that of the other
oscillation within `TRANSIENT_CYCLES` cycles of the other oscillation."""
STEADY_RATE_RATIO = 0.1
"""One of two oscillations counts as sustained by a drive only if its decay rate is below this fraction of the other
decay rate."""
HOLE_IN_PERIOD = 0.2
"""The amplitude is not measured in periods that contain a gap in the samples longer than this fraction of the period
and than 2.5 sampling intervals, because a peak may be missing."""
MIN_CYCLES = 3.0
"""A record counts as two oscillations only if the slower one has at least this many cycles. It counts as one
oscillation of constant amplitude only if this one has more cycles than this."""
DRIFT_CYCLES = 8.0
"""A second oscillation that is smaller and slower than the first counts as a drift of the baseline if it does not decay
and has fewer cycles than this."""
RATE_SIGMAS = 3.0
"""A decay rate below this many of its standard errors does not prove that an oscillation decays."""
MAX_SUSTAINED_FALL = 0.05
"""An oscillation is sustained if its amplitude falls by less than this fraction, over the record or over its last
third. A free decay that has halved, with damping by a power of the velocity up to the third, still falls by at least 10
% in the last third."""
MIN_FALL = 2.0
"""A decay together with a sustained oscillation of close frequency is recognised only if the amplitude falls by at
least this factor before it stays constant. A record counts as excited throughout only if its amplitude changes by less
than this factor from the first to the last third."""
RISE_RATIO, MIN_RISES, RISE_PERIODS = 1.5, 4, 3
"""A record counts as excited throughout only if its amplitude rises at least `MIN_RISES` times, each time by at least
the factor `RISE_RATIO` and over at least `RISE_PERIODS` periods."""
MIN_RISING_FRACTION = 0.25
"""A record counts as excited throughout only if the amplitude rises in at least this fraction of its duration. Under
random excitation it rises half of the time, after repeated releases only during a small part of it."""
STANDING_OUT = 10.0
"""A record does not count as excited throughout if its largest amplitude is more than this factor times the median: it
then contains a decay that stands out. Under Gaussian random forces, one period in 2^100 has such an amplitude."""
MIN_RANGE_SIGMAS = 20.0
"""An oscillation that stays constant after a decay is recognised only if its range (maximum minus minimum) is at least
this many standard deviations of a sample's noise."""


@dataclass(frozen=True)
class Modes:
    """Damped sinusoids (modes) fitted to a record; the first has the largest amplitude at either end of the record.

    Attributes
    ----------
    frequencies
        Damped frequencies in Hz, (k,).
    rates, errors
        Decay rates in 1/s (negative for growth), and their standard errors, each (k,).
    first, last
        Amplitudes at the first and at the last time of the record, in its unit, each (k,).
    left
        Fraction of the variance about the fitted constant that the fit does not explain.
    """

    frequencies: np.ndarray
    rates: np.ndarray
    errors: np.ndarray
    first: np.ndarray
    last: np.ndarray
    left: float

    @property
    def ratios(self) -> np.ndarray:
        """Return the damping ratios, (k,): decay rate divided by undamped angular frequency."""
        return self.rates / np.hypot(self.rates, 2 * np.pi * self.frequencies)


def damped_modes(t: np.ndarray, y: np.ndarray) -> Iterator[Modes]:
    """Fit a constant and one damped sinusoid to a record, then two, and so on, until all searches for a mode fail.

    Frequencies and decay rates are searched, starting from lines of the spectrum. Amplitudes and phases, on which the
    model depends linearly, are computed by linear least squares (variable projection).

    Parameters
    ----------
    t, y
        Times in s and values, each (n,).

    Yields
    ------
    Modes
        The fit with one mode, then that with two modes, and so on.

    References
    ----------
    G. H. Golub and V. Pereyra, SIAM J. Numer. Anal. 10, 413 (1973): variable projection.
    """
    t, y = np.asarray(t, float) - t[0], np.asarray(y, float)
    points, rest = np.empty((0, 2)), y - y.mean()
    while fit := _add_mode(t, y, points, rest):
        points, columns, c, rest = fit
        omega, rate = points.T
        size = np.hypot(c[1::2], c[2::2])
        ends = size * np.exp(-rate * t[-1])
        order = np.argsort(-np.maximum(size, ends))
        misfit = float(rest @ rest)
        variance = misfit / max(t.size - columns.shape[1] - points.size, 1)
        # Standard errors from the Jacobian of all parameters, linear and nonlinear. Frequencies and decay rates were
        # fitted to the samples of the search only.
        variance *= max(t.size / MOST_SEARCHED, 1.0)
        both = np.column_stack([columns, _slopes(t, columns, c)])
        spread = np.sqrt(variance * np.maximum(np.diag(np.linalg.pinv(both.T @ both)), 0.0))
        errors = spread[columns.shape[1] + 1 :: 2]
        left = misfit / max(float(np.sum((y - c[0]) ** 2)), 1e-300)
        yield Modes(omega[order] / (2 * np.pi), rate[order], errors[order], size[order], ends[order], left)


def _columns(t: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Return the design matrix of the linear fit, (n, 1 + 2k): ones, then a damped cosine and sine for each mode.

    t: times in s, (n,). points: angular frequency (rad/s) and decay rate (1/s) of each of the k modes, (k, 2).
    """
    parts = [np.ones_like(t)]
    for omega, rate in points:
        fall = np.exp(-np.clip(rate * t, -50, 50))
        parts += [fall * np.cos(omega * t), fall * np.sin(omega * t)]
    return np.column_stack(parts)


def _slopes(t: np.ndarray, columns: np.ndarray, c: np.ndarray) -> np.ndarray:
    """Return the derivatives (n, 2k) of the fit `columns @ c` by the angular frequency and the decay rate of each mode.

    t: times in s, (n,). columns: design matrix by `_columns`. c: its coefficients, (1 + 2k,).
    """
    slopes = np.empty((t.size, c.size - 1))
    for i in range(1, c.size, 2):
        pair = columns[:, i : i + 2]
        slopes[:, i - 1] = t * (pair @ np.array([c[i + 1], -c[i]]))
        slopes[:, i] = -t * (pair @ c[i : i + 2])
    return slopes


def _add_mode(
    t: np.ndarray, y: np.ndarray, points: np.ndarray, rest: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray] | None:
    """Return the least-squares fit with one more mode; None if all searches fail.

    The fit consists of its points (k + 1, 2), design matrix (n, 2k + 3), coefficients (2k + 3,) and residuals (n,).

    t, y: times in s and values, (n,). points: angular frequency (rad/s) and decay rate (1/s) of each of the k modes of
    the previous fit, (k, 2). rest: its residuals, (n,). All modes are searched together, from `points` and a new mode.
    The new mode starts at the strongest line in the spectrum of `rest`, or near the frequency of one of the other
    modes. The search with the smallest sum of squares is used.
    """
    spacing = float(np.median(np.diff(t)))
    grid = np.arange(0.0, t[-1], spacing)
    values = np.interp(grid, t, rest)
    size = PADDING * grid.size
    power = np.abs(np.fft.rfft(values * np.hanning(grid.size + 2)[1:-1], size)) ** 2
    power[: PADDING * 2] = 0.0  # fewer than two cycles in the record are a drift
    bin_width = 2 * np.pi / t[-1]
    starts = [2 * np.pi * float(np.argmax(power)) / (size * spacing)]
    starts += [omega + side * bin_width for omega, _ in points for side in (-1.5, 1.5)]
    few, few_y = t, y
    if t.size > MOST_SEARCHED:
        some = np.sort(np.random.default_rng(0).choice(t.size, MOST_SEARCHED, replace=False))
        few, few_y = t[some], y[some]
    count = len(points) + 1
    scale = np.tile([bin_width, 1.0 / t[-1]], count)
    low = np.tile([0.5, -12.0], count)
    high = np.tile([np.pi / spacing / scale[0], 60.0], count)

    def expand(z: np.ndarray) -> Expansion:
        """Return minus half of the sum of squares as a function of the scaled frequencies and rates z, (2k + 2,).

        z contains the angular frequency in units of 2π/T and the decay rate in units of 1/T of each mode, where T is
        the duration of the record. The derivatives are those of Golub and Pereyra (1973).
        """
        columns = _columns(few, (z * scale).reshape(-1, 2))
        inverse = np.linalg.pinv(columns)
        c = inverse @ few_y
        residuals = few_y - columns @ c
        of_columns = _slopes(few, columns, c)
        by_residuals = np.zeros((c.size, c.size - 1))  # derivatives of the columns times the residuals
        along = (few * residuals) @ columns
        for i in range(1, c.size, 2):
            by_residuals[i : i + 2, i - 1] = -along[i + 1], along[i]
            by_residuals[i : i + 2, i] = -along[i : i + 2]
        slopes = (columns @ (inverse @ of_columns) - of_columns - inverse.T @ by_residuals) * scale
        return Expansion(-0.5 * float(residuals @ residuals), -residuals @ slopes, slopes.T @ slopes)

    def has_converged(step: Step) -> bool:
        return 0 <= step.gain < TOLERANCE * -step.at.value

    def move(z: np.ndarray, step: np.ndarray) -> np.ndarray:
        return np.minimum(z + step, high)

    fits: list[tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]] = []
    for omega in starts:
        if omega <= 0 or (fits and np.any(np.abs(points[:, 0] - omega) < MIN_SEPARATION * bin_width)):
            continue
        start = np.vstack([points, [omega, 1.0 / t[-1]]]).ravel() / scale
        start = np.clip(start, low + 1e-6, high - 1e-6)
        try:
            top = levenberg_marquardt(expand, start, low, has_converged, limit=60, retract=move)
        except np.linalg.LinAlgError:
            continue
        modes = (top.x * scale).reshape(-1, 2)
        columns = _columns(t, modes)
        c = np.linalg.lstsq(columns, y, rcond=None)[0]
        fits.append((modes, columns, c, y - columns @ c))
    return min(fits, key=lambda fit: float(fit[-1] @ fit[-1]), default=None)


def few_samples(t: np.ndarray, y: np.ndarray, period: float) -> tuple[np.ndarray, np.ndarray]:
    """Average the samples of a record in blocks, so that fewer remain.

    The blocks are as long as possible, but leave at least `LEAST_AVERAGED` means, and at least `PER_CYCLE` means in a
    period. A record with less than twice as many samples is not changed. t, period: in s. Return the mean times and
    values of the blocks, (m,) each; an incomplete last block is dropped.
    """
    cycles = float(t[-1] - t[0]) / period
    block = max(int(t.size / max(LEAST_AVERAGED, PER_CYCLE * cycles)), 1)
    return block_means(t, block), block_means(y, block)


@dataclass(frozen=True)
class OtherMotion:
    """A motion that is not the free decay of one oscillator.

    Attributes
    ----------
    kind
        Kind of the motion. "growing" and "steady" are one oscillation that grows or stays constant; "beats" and
        "two modes" are two oscillations of close or of different frequencies; "driven" is a decay together with a
        sustained oscillation; "excited" is excited throughout.
    modes
        The fitted oscillations, one or two. For "excited", the rates are NaN, and `first` and `last` are the smallest
        and the largest amplitude of the record.
    size
        For two oscillations, the largest amplitude of the second relative to that of the first; for "growing", the
        factor of growth minus 1; for "steady", 1; for "excited", the number of times that the amplitude rises.
    complete
        Whether two modes explain the record to its noise (`MOST_MISFIT`). If their frequencies are close, there must
        also be enough beats (`LEAST_BEATS`), or no law may fit nearly as well (`NATS_AHEAD`). False for "growing",
        "steady" and "excited".
    misfit
        For two oscillations, the standard deviation of the residual relative to that of the noise; 1 for other kinds.
    clear
        False if the record may also be the decay of one oscillator that follows none of the compared laws: two
        oscillations of close frequencies explain it far better than they do, but their sizes are alike (`SIZES_ALIKE`)
        or their lines overlap (`LEAST_WIDTHS`).
    """

    kind: Literal["growing", "steady", "beats", "two modes", "driven", "excited"]
    modes: Modes
    size: float
    complete: bool = False
    misfit: float = 1.0
    clear: bool = True


def find_other_motion(
    t: np.ndarray, y: np.ndarray, period: float, no_law_fits: bool = False, unexplained: float = 0.0
) -> OtherMotion | None:
    """Return what motion a record contains instead of the free decay of one oscillator; None if it may be such a decay.

    Three motions are tested in turn: one oscillation that grows or stays constant, two oscillations, and excitation
    throughout (`find_excited`). Two oscillations are accepted if two damped sinusoids explain nearly all of the record,
    leave at most half of what one leaves, and a single oscillator, even a nonlinear one, cannot move in this way. It
    cannot if the second frequency is neither close to the first nor a harmonic of it, and if the two explain the record
    to its noise or are too lightly damped to imitate the end of another decay. For close frequencies the amplitude must
    rise, or fall and then stay constant. The result is None for fewer than 20 (averaged) samples or three cycles, and
    for a drift of the baseline.

    Parameters
    ----------
    t, y
        Times in s and values, each (n,).
    period
        Approximate period of the oscillation, s.
    no_law_fits
        Whether it is known that no damping and restoring law of one oscillator fits the record. If true, more second
        modes are accepted: a harmonic of the first frequency, and a mode that soon decays. A mode close to the first
        frequency is then accepted without a rising amplitude, if the two beat and explain the record to its noise.
    unexplained
        Rms of the residual, beyond the noise, that the best law of one oscillator leaves, in the unit of y; 0 if it is
        not known. If two close frequencies explain much more, they are accepted without a rising amplitude.
    """
    t, y = few_samples(np.asarray(t, float), np.asarray(y, float), period)
    if t.size < 20:
        return None
    return _other_by_modes(t, y, no_law_fits, unexplained) or find_excited(t, y, period)


def _other_by_modes(
    t: np.ndarray, y: np.ndarray, no_law_fits: bool, unexplained: float
) -> OtherMotion | None:
    """Return the motion from fits of one and two damped sinusoids; None if the record may be a single free decay.

    The result is also None if two sinusoids do not explain the record, if the slower one has fewer than `MIN_CYCLES`
    cycles, or if it is a drift. t, y: times in s and values, each (n,). no_law_fits, unexplained: as in
    `find_other_motion`.
    """
    fits = damped_modes(t, y)
    single = next(fits, None)
    if single is None or single.left >= 1:
        return None
    duration = float(t[-1] - t[0])
    rate, error = float(single.rates[0]), float(single.errors[0])
    if single.left < 1 - MIN_EXPLAINED:
        if rate < -GROWTH_SIGMAS * error and single.last[0] > MIN_GROWTH * single.first[0]:
            return OtherMotion("growing", single, float(single.last[0] / single.first[0] - 1))
        no_decay = rate < RATE_SIGMAS * error and (abs(rate) + 2 * error) * duration < MAX_SUSTAINED_FALL
        if single.frequencies[0] * duration > MIN_CYCLES and no_decay:
            return OtherMotion("steady", single, 1.0)
    two = next(fits, None)
    if two is None or two.left > (1 - MIN_EXPLAINED) or two.left > 0.5 * single.left:
        return None
    if two.ratios.max() > MOST_DAMPED:
        return None
    if not no_law_fits and transient_duration(two, duration / 4):
        return None
    largest = np.maximum(two.first, two.last)
    size = float(largest[1] / largest[0])
    slowest, fastest = sorted(two.rates.tolist())
    # `steady`: the mode that decays more slowly does not halve during the record, whereas the other one decays.
    steady = abs(slowest) < min(STEADY_RATE_RATIO * fastest, np.log(MIN_FALL) / duration)
    f, g = float(two.frequencies.min()), float(two.frequencies.max())
    if f * duration < MIN_CYCLES:
        return None
    if two.frequencies[1] == f and f * duration < DRIFT_CYCLES and two.rates[1] < RATE_SIGMAS * two.errors[1]:
        return None  # a drift of the baseline
    noise = float(np.std(y)) * two.left**0.5
    rough = max(roughness(t, y, 1 / f), 1e-12 * float(np.std(y)))
    misfit, complete = noise / rough, noise < MOST_MISFIT * rough
    if g / f - 1 < CLOSE_FREQUENCIES or 2 * np.pi * (g - f) < fastest + slowest:
        ranges = _ranges(t, y, 1 / f)
        # `levels`: in the last third, the amplitude and the slower mode stay constant, well above the noise.
        last = ranges[-(ranges.size // 3) :]
        levels = steady and last.size >= 3 * SUCCESSIVE_PERIODS
        levels = levels and ranges[0] > MIN_FALL * np.median(last) > MIN_FALL * MIN_RANGE_SIGMAS * noise
        if levels:
            falls = (abs(slowest) + 2 * float(two.errors[np.argmin(two.rates)])) * duration / 3
            early, late = np.median(last[: last.size // 2]), np.median(last[-(last.size // 2) :])
            levels = falls < MAX_SUSTAINED_FALL and abs(early / late - 1) < MAX_SUSTAINED_FALL
        together = min(duration, 1 / max(fastest - slowest, 1e-300))  # time in s with comparable amplitudes
        nats = 0.5 * t.size * ((unexplained / rough) ** 2 + 1 - misfit**2)
        possible = complete and nats > NATS_AHEAD and fastest < RATES_ALIKE * slowest
        apart = 2 * np.pi * (g - f) > LEAST_WIDTHS * (fastest + slowest)
        ahead = possible and size < SIZES_ALIKE and apart
        complete = ahead or (complete and (g - f) * together > LEAST_BEATS)
        clear = relative_rise(ranges, noise) >= MIN_RISE or levels or ((no_law_fits or ahead) and complete)
        if not clear and not possible:
            return None
        return OtherMotion("driven" if steady else "beats", two, size, complete, misfit, clear)
    if not complete and g - f < fastest:  # two damped sinusoids imitate how another decay ends
        return None
    multiple = two.frequencies[1] / two.frequencies[0]
    off = abs(multiple / max(round(multiple), 1) - 1)
    exact = off < EXACT_HARMONIC and size < HARMONIC_SIZE
    if multiple > 1 and (exact or (not no_law_fits and off < HARMONIC_TOLERANCE)):
        return None
    return OtherMotion("driven" if steady else "two modes", two, size, complete, misfit)


def find_excited(t: np.ndarray, y: np.ndarray, period: float) -> OtherMotion | None:
    """Return the motion of a record that is excited throughout, by random forces or a hand.

    The amplitude of such a record rises repeatedly, about as slowly as it falls, is at the end about as large as at the
    start, and never stands out (`STANDING_OUT`).

    Parameters
    ----------
    t, y
        Times in s and values, each (n,).
    period
        Period of the oscillation, in s.

    Returns
    -------
    OtherMotion or None
        The motion; None if the amplitude does not behave like this, if the record has fewer than 36 periods, or if it
        does not oscillate with this period.
    """
    ranges = _ranges(t, y, period)
    if ranges.size < 3 * MIN_RISES * RISE_PERIODS:
        return None
    third = ranges.size // 3
    before, after = float(np.median(ranges[:third])), float(np.median(ranges[-third:]))
    if not before < MIN_FALL * after < MIN_FALL**2 * before:  # this form is also right if a median is 0
        return None
    if ranges.max() > STANDING_OUT * np.median(ranges):
        return None
    noise = roughness(t, y, period)
    if (
        ranges.min() <= RISE_SIGMAS * noise
        or coarse_period(t, y)[1] < LEAST_SHARE
        or reason_not_oscillating(t, y, period, noise)
    ):
        return None
    turns, _ = zigzag(np.log(ranges), np.full(ranges.size, np.log(RISE_RATIO)))
    rises = [b - a for a, b in pairwise(turns[:-1]) if ranges[b] > ranges[a] and b - a >= RISE_PERIODS]
    if len(rises) < MIN_RISES or sum(rises) < MIN_RISING_FRACTION * ranges.size:
        return None
    nan, f = np.array([np.nan]), np.array([1 / period])
    modes = Modes(f, nan, nan, np.array([0.5 * ranges.min()]), np.array([0.5 * ranges.max()]), 1.0)
    return OtherMotion("excited", modes, float(len(rises)))


def transient_duration(two: Modes, longest: float) -> float:
    """Return the duration in s of a transient mode in a fit of two modes; 0 if neither mode is a transient.

    A transient, such as the ringing of a filter, is a mode that decays much faster than the other one. Its duration is
    the time until its amplitude is below `GONE_FRACTION` times that of the other mode. It is a transient only if this
    time is less than `TRANSIENT_CYCLES` cycles of the other mode and less than `longest` seconds. two: the fit.
    """
    fast, slow = int(np.argmax(two.rates)), int(np.argmin(two.rates))
    size = float(two.first[fast] / max(two.first[slow], 1e-300))
    long = float(np.log(max(size / GONE_FRACTION, 1.0)) / max(two.rates[fast] - two.rates[slow], 1e-300))
    return long if long < min(TRANSIENT_CYCLES / float(two.frequencies[slow]), longest) else 0.0


def _ranges(t: np.ndarray, y: np.ndarray, period: float) -> np.ndarray:
    """Return the range (maximum − minimum) of the values in each period, in time order, as a measure of the amplitude.

    Periods with three or fewer samples, or with a gap (`HOLE_IN_PERIOD`), are left out. With fewer than `PER_CYCLE`
    samples in a period, which miss the extremes, the range is that of a fitted sinusoid. t, period: in s. The result is
    in the unit of y.
    """
    edges = np.searchsorted(t, np.arange(t[0], t[-1], period))
    spacing = float(np.median(np.diff(t)))
    widest = max(HOLE_IN_PERIOD * period, 2.5 * spacing)

    def size(a: int, b: int) -> float:
        if period > PER_CYCLE * spacing:
            return float(np.ptp(y[a:b]))
        turn = 2 * np.pi / period * t[a:b]
        c = np.linalg.lstsq(
            np.column_stack([np.ones_like(turn), np.cos(turn), np.sin(turn)]), y[a:b], rcond=None
        )[0]
        return float(2 * np.hypot(c[1], c[2]))

    long = [(a, b) for a, b in pairwise(edges) if b - a > 3]
    return np.array([size(a, b) for a, b in long if np.diff(t[max(a - 1, 0) : b + 1]).max() <= widest])


def relative_rise(ranges: np.ndarray, noise: float, together: int = SUCCESSIVE_PERIODS) -> float:
    """Return the largest rise of an amplitude after it has fallen, relative to its value after the rise.

    A rise is reduced by `RISE_SIGMAS` times `noise`. Damping removes energy, so for a free decay of one oscillator the
    result is about 0. It is exactly 0 if no rise is larger than this reduction, or if there are fewer than 2 ×
    `together` ranges.

    Parameters
    ----------
    ranges
        Ranges (maximum minus minimum) of successive periods or half cycles, (n,).
    noise
        Standard deviation of the noise of a sample, in the unit of the ranges.
    together
        The largest of this many successive ranges is compared with the smallest of as many later ones.
    """
    if ranges.size < 2 * together:
        return 0.0
    runs = np.lib.stride_tricks.sliding_window_view(ranges, together)
    before, later = np.minimum.accumulate(runs.max(axis=1))[:-together], runs.min(axis=1)[together:]
    return float(max(np.max((later - before - RISE_SIGMAS * noise) / np.maximum(later, 1e-300)), 0.0))
