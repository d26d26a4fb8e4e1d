"""Estimate damping and frequency as functions of the amplitude, without assuming a damping law or a restoring law.

First, sinusoids are fitted in short windows. The windows are at least two periods long and weighted by a raised cosine,
so that a second mode or a harmonic at about twice the frequency or above hardly changes the fitted amplitude (it would
change turning points by its own size).

Then amplitudes and phases are smoothed. The amplitude, or a power of it, is modelled as a straight line in time plus an
integrated random walk, which lets the decay rate vary (a cubic smoothing spline: G. Wahba, 1978). The unknown variance
of the walk is averaged over, weighted by its marginal likelihood. The frequency is the slope of the phases, smoothed in
the same way. A polynomial of the frequency in the squared amplitude (the backbone curve) gives the energy of the
oscillation, and from it the equivalent viscous damping ratio follows.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import scipy  # loads its modules when they are used
from threadpoolctl import threadpool_limits

from bayesdamp.records.oscillation.features import features, once_per_record
from bayesdamp.records.oscillation.noise import block_means, group_by_size, neighbourhoods
from bayesdamp.types import DERIVATIVES, NORMAL_95, LawFreeDamping, Refusal, Signal

SHORTEST_WINDOW, LONGEST_WINDOW, WINDOW_FRACTION = 2.0, 8.0, 0.05
"""A sinusoid is fitted in each of many windows of a record. The length of a window is the fraction `WINDOW_FRACTION` of
the record's cycles, but at least `SHORTEST_WINDOW` and at most `LONGEST_WINDOW` periods (conventional)."""
STARTS_PER_WINDOW = 4
"""Windows overlap: this many windows start within the length of one window (conventional)."""
MOST_WINDOWS, FEWEST_WINDOWS = 100, 3
"""Largest and smallest number of windows in a record. In long records the windows are further apart, so that there are
not more; a record is refused if fewer have enough samples (conventional)."""
SAMPLES_PER_CYCLE = 64
"""Neighbouring samples are averaged to about this many samples a cycle; this reduces all amplitudes by 0.04 %."""
FEWEST_SAMPLES = 8
"""Smallest number of samples in a window in which a sinusoid is fitted; windows with fewer are left out."""
LEAST_COVERAGE = 0.6
"""Smallest fraction of the weight of a full window that the samples in a window must have. A window over a gap in the
samples has less and is left out."""
OUTLIER_SDS = 6.0
"""A sample is left out of a window if it differs from the fitted sinusoid by more than this many robust standard
deviations of the residuals (conventional)."""
ROUNDING_SD = 0.29
"""Standard deviation of a rounding error, as a fraction of the recording step: 1/√12."""
LEAST_ERROR = 1e-5
"""Smallest relative standard error of a fitted amplitude, because the motion is not exactly a sinusoid
(conventional)."""
NUGGET = 1e-3
"""Fraction of the error variance of an amplitude that is assumed to be independent between windows, so that the
correlation matrix is not singular."""
POWERS = (-1.0, -0.5, 0.0, 0.5, 1.0)
"""Powers of the amplitude (0: its log), each of which is modelled as a straight line in time plus a random walk (Box
and Cox 1964). Without the walk, the first power is exact for quadratic drag, the middle one for viscous damping, and
the last one for dry friction."""
WALKS = np.concatenate([[0.0], np.geomspace(1.0, 1e8, 9)])
"""Possible variances of the integrated random walk that lets the decay rate vary, relative to the error variance of the
amplitudes. The result is averaged over them; 0 means no walk."""
NOISE_WEIGHT = 4.0
"""In the estimate of the error variance of the amplitudes, the noise measured within the windows counts as much as this
many amplitudes (conventional)."""
POOR_FIT = 9.0
"""In a short record, the frequency is a polynomial with one coefficient more if the mean squared error of the phases is
more than this many times what their noise explains (conventional: three standard deviations)."""
IRREGULAR = "the amplitudes of the cycles differ too much for a curve without a law"
PROBABILITY_NO_WALK = 0.2
"""Prior probability that no random walk is added to the straight line that models a power of the amplitude in time. The
other variances in `WALKS` share the rest equally. With 0.5 and smaller walks, the intervals at the ends of a record
were too narrow (measured on 104 records, by a factor of up to 7; with the present values, 3.5). The reason is that no
power of the amplitude is a straight line under a sum of dampings."""
RATE_ERROR = 5e-4
"""Relative systematic error (standard deviation) of decay rates, which occurs because amplitudes are averages over
windows."""
FREQUENCY_ERROR = 1.0
"""Relative systematic error (standard deviation) of a frequency, in units of the squared damping ratio. The phase of a
decaying sinusoid is slower than the natural frequency: by 0.5 of this unit for viscous damping, and by 2 for dry
friction. The reason for the latter is the alternating offset 4 δ / π, which is in quadrature with the sinusoid and
grows relative to it."""
DEGREE = 5
"""Largest degree of the polynomial in time that approximates the log amplitude, to find the time at which the motion
has a given amplitude (`LawFree.line`)."""
AVERAGING_ROUNDS = 2
"""Number of rounds that correct the amplitudes for the averaging over windows."""
CONVERSION_ROUNDS, CONVERTED = 40, 1e-5
"""The amplitudes of a velocity or acceleration are converted to the displacement by iteration, until log amplitudes
change by less than `CONVERTED`. If this needs more than `CONVERSION_ROUNDS` rounds, the record is refused."""
HARMONIC_ERROR = 1.0
"""Relative systematic error (standard deviation) of a damping ratio, in units of the amplitude of the third harmonic
relative to the first. It is twice as large for a recorded velocity and three times for an acceleration. Measured on
pendulums from 30 to 150 degrees and cubic springs."""
CONSTANT_ERRORS = (0.0, 0.03, 0.1, 0.3, 1.0)
"""Noise in a narrow band around the oscillation is not visible within a window. Therefore a constant standard error is
added to the errors of all amplitudes: the most likely of these fractions of the smallest amplitude."""
ESTIMATES_PER_WINDOW = 1.5
"""Number of statistically independent estimates of the amplitude that overlapping windows give within the length of one
window (for windows that are raised cosines)."""
MOST_HARMONIC = 0.05
"""Largest amplitude of the third harmonic, relative to the first, that is used in corrections; a larger one is replaced
by this value (conventional)."""
LEAST_PACE = 0.01
"""A frequency is limited to at least this fraction of that of small oscillations, and an energy to at least this
fraction of the squared largest velocity, where they are extrapolated (conventional)."""
Smoothed = Callable[[np.ndarray], tuple[np.ndarray, np.ndarray, np.ndarray]]
"""A function of scaled times (k,) that returns smoothed log amplitudes or phases, their slopes, and the variances or
standard deviations of the slopes, with the last axis (k,) each."""
_X, _W = np.polynomial.legendre.leggauss(16)  # nodes and weights of the energy integral


@dataclass(frozen=True)
class Sinusoids:
    """Sinusoids fitted in k windows of a record, in time order.

    Attributes
    ----------
    times
        Middle times of the windows in s, (k,).
    amplitudes
        Amplitudes in the unit of the record, (k,).
    phases
        Unwrapped phases φ in rad of the sinusoids A cos φ at these times, (k,).
    errors
        Standard errors of the phases, which equal the relative standard errors of the amplitudes, (k,).
    correlation
        Correlation matrix of the errors, (k, k); they are correlated because windows overlap.
    widths
        Widths of the windows in s, (k,).
    """

    times: np.ndarray
    amplitudes: np.ndarray
    phases: np.ndarray
    errors: np.ndarray
    correlation: np.ndarray
    widths: np.ndarray

    @property
    def covariance(self) -> np.ndarray:
        """Return the covariance (k, k) of the errors of the phases, which is also that of the log amplitudes."""
        return self.errors[:, None] * self.errors * self.correlation

    @property
    def scaled_times(self) -> np.ndarray:
        """Return the middle times of the windows, scaled to −1 (first window) to 1 (last window), (k,)."""
        first, last = self.times[0], self.times[-1]
        return 2 * (self.times - first) / (last - first) - 1


def sinusoids(signal: Signal) -> Sinusoids:
    """Fit a sinusoid with linearly changing amplitude and midline in each of many overlapping windows of a record.

    A window is at least two periods long (less in very short records). The amplitudes are those of the recorded
    quantity, even if it is not the displacement. Raises Refusal if the record does not oscillate, or if fewer than
    three windows have enough samples.
    """
    measured = features(signal)
    block = max(int(measured.samples_per_cycle / SAMPLES_PER_CYCLE), 1)
    t, y = (block_means(np.asarray(values, float), block) for values in (signal.t, signal.y))
    first = max(float(t[0]), float(measured.swing_times[0]) - 0.75 * measured.period)
    last = min(float(t[-1]), float(measured.swing_times[-1]) + 0.75 * measured.period)
    turns = measured.turning_times
    if last - first > MOST_WINDOWS * SHORTEST_WINDOW * measured.period and turns.size > 1:
        # Windows that hardly overlap do not determine the number of cycles between them; the turning points do.
        # Therefore use only the part of the record between the first and the last turning point.
        first, last = max(first, float(turns[0])), min(last, float(turns[-1]))
    periods = float(np.clip(WINDOW_FRACTION * measured.cycles, SHORTEST_WINDOW, LONGEST_WINDOW))
    periods = max(min(periods, (last - first) / measured.period - 1.5), 1.0)
    inside = last - first - periods * measured.period
    wanted = STARTS_PER_WINDOW * inside / (periods * measured.period) + 1
    count = int(np.clip(wanted, FEWEST_WINDOWS, MOST_WINDOWS))
    middles = first + 0.5 * periods * measured.period + np.linspace(0, 1, count) * max(inside, 0.0)
    # First estimate of the local period, from neighbouring turning points; smoothed, because a turning point may be
    # wrong.
    local = np.full(middles.size, measured.period)
    if turns.size >= 3:
        local = turns[2:] - turns[:-2]
        if local.size >= 5:
            local = np.median(neighbourhoods(local, 5), axis=1)
            local = neighbourhoods(local, 5).mean(axis=1)
        local = np.interp(middles, turns[1:-1], local)
    # Fit again with the frequency from the slope of the phases, which is more precise than turning points.
    constant = np.zeros(middles.size)
    times, _, phases, _, used = _fit_windows(t, y, middles, 2 * np.pi / local, constant, periods, turns)
    pace = np.interp(middles, times, np.gradient(phases, times, edge_order=2))
    pace = np.clip(pace, 0.8 * used.min(), 1.25 * used.max())
    change = np.gradient(pace, middles, edge_order=2)
    times, amplitudes, phases, gains, used = _fit_windows(t, y, middles, pace, change, periods, turns)
    widths = 2 * np.pi * periods / used
    noise = float(np.hypot(measured.roughness, ROUNDING_SD * signal.step)) / np.sqrt(block)
    errors = np.maximum(noise * gains / amplitudes, LEAST_ERROR)
    # The errors of overlapping windows correlate by the autocorrelation of the raised cosine at their distance. The
    # same width is used for all, so that the matrix is positive definite.
    lag = np.minimum(np.abs(times[:, None] - times) / float(np.median(widths)), 1.0)
    turn = 2 * np.pi * lag
    overlap = (1 - lag) * (2 + np.cos(turn)) / 3 + np.sin(turn) / (2 * np.pi)
    correlation = (1 - NUGGET) * overlap + NUGGET * np.eye(times.size)
    return Sinusoids(times, amplitudes, phases, errors, correlation, widths)


def _fit_windows(
    t: np.ndarray,
    y: np.ndarray,
    middles: np.ndarray,
    pace: np.ndarray,
    change: np.ndarray,
    periods: float,
    turns: np.ndarray,
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Fit sinusoids of angular frequency `pace` (m,) in windows of `periods` periods around the times `middles` (m,).

    t, y: times in s and values, (n,). pace, change: angular frequency in rad/s, and its time derivative in rad/s², (m,)
    each; with a constant frequency, amplitudes would be too small. turns: times of the turning points in s, (c,); they
    count the half cycles between windows. Return, for the k windows with enough samples: times (s), amplitudes (in the
    unit of y), unwrapped phases (rad), noise gains (standard deviation of an amplitude divided by that of a sample) and
    angular frequencies (rad/s), (k,) each. Raises Refusal if k is less than `FEWEST_WINDOWS`.
    """
    width = periods * 2 * np.pi / pace
    begins = np.searchsorted(t, middles - 0.5 * width)
    sizes = np.searchsorted(t, middles + 0.5 * width) - begins
    spacing = float(t[-1] - t[0]) / (t.size - 1)
    fits = np.full((3, middles.size), np.nan)
    for n, same in group_by_size(sizes, FEWEST_SAMPLES):
        rows, wide = begins[same, None] + np.arange(n), width[same, None]
        u, values = t[rows] - middles[same, None], y[rows]
        angle, place = (pace[same, None] + 0.5 * change[same, None] * u) * u, u / wide
        wave = [np.cos(angle), np.sin(angle)]
        columns = np.stack([*wave, np.ones_like(u), place, place * wave[0], place * wave[1]], axis=2)
        weight = np.cos(np.pi * u / wide) ** 2
        c, inverse = _solve_weighted(columns, values, weight)
        off = np.abs(values - (columns @ c[:, :, None])[:, :, 0])
        far = off > OUTLIER_SDS * 1.4826 * np.median(off, axis=1, keepdims=True)
        again = np.flatnonzero(far.any(axis=1) & (np.sum(~far, axis=1) >= FEWEST_SAMPLES))
        weight[again] = np.where(far[again], 0.0, weight[again])
        c[again], inverse[again] = _solve_weighted(columns[again], values[again], weight[again])
        size = np.hypot(c[:, 0], c[:, 1])
        good = (size > 0) & (weight.sum(axis=1) * spacing >= LEAST_COVERAGE * 0.5 * wide[:, 0])
        which, c, size = same[good], c[good], size[good]
        ends = c[:, 0, None] * inverse[good, 0] + c[:, 1, None] * inverse[good, 1]
        gains = np.linalg.norm(ends / size[:, None], axis=1)
        fits[:, which] = size, np.arctan2(-c[:, 1], c[:, 0]), gains
    good = np.isfinite(fits[0])
    if np.count_nonzero(good) < FEWEST_WINDOWS:
        raise Refusal("the record has too few cycles to estimate damping and frequency")
    times, used, (amplitudes, phases, gains) = middles[good], pace[good], fits[:, good]
    # Unwrap the phases: their advance between windows must agree with the number of turning points.
    ahead = np.diff(times) * 0.5 * (used[1:] + used[:-1])
    if turns.size > 1:
        counted = np.diff(np.interp(times, turns, np.pi * np.arange(turns.size)))
        ahead = np.where((times[:-1] >= turns[0]) & (times[1:] <= turns[-1]), counted, ahead)
    steps = np.diff(phases)
    steps = steps + 2 * np.pi * np.round((ahead - steps) / (2 * np.pi))
    phases = phases[0] + np.concatenate([[0.0], np.cumsum(steps)])
    return times, amplitudes, phases, gains, used


def _solve_weighted(
    columns: np.ndarray, values: np.ndarray, weight: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Solve weighted least squares (minimise Σ weight × residual²) in w windows.

    columns: design matrices, (w, n, 6). values, weight: (w, n). Return the coefficients (w, 6), and the matrices (w, 6,
    n) by which the values are multiplied to get them.
    """
    weighted = np.swapaxes(columns * weight[:, :, None], 1, 2)
    inverse = np.linalg.pinv(weighted @ columns, hermitian=True) @ weighted
    return (inverse @ values[:, :, None])[:, :, 0], inverse


@dataclass(frozen=True)
class LawFree:
    """The smoothed amplitude and frequency of a record. The method `at` evaluates them and the damping ratio.

    Attributes
    ----------
    windows
        Sinusoids fitted in windows. Their amplitudes are those of the recorded quantity (perhaps a velocity), but their
        phases are those of the displacement.
    sizes
        Natural logarithms of the amplitudes of the displacement, in its base unit (rad, m, V, ...), in the middle of
        the windows, (k,).
    backbone
        Angular frequency as a polynomial in the squared amplitude of the displacement (several degrees, averaged).
    line
        Polynomial in time, fitted to `sizes`. The time is scaled to −1 in the middle of the first window and 1 in the
        middle of the last.
    harmonic_error
        Relative systematic error of damping ratios, in units of the third harmonic relative to the first.
    """

    windows: Sinusoids
    sizes: np.ndarray
    backbone: Backbone
    line: np.polynomial.Polynomial
    harmonic_error: float

    @property
    def span(self) -> tuple[float, float]:
        """Return the middle times of the first and of the last window, in s."""
        return float(self.windows.times[0]), float(self.windows.times[-1])

    def times_of(self, amplitudes: np.ndarray) -> np.ndarray:
        """Return the times in s, (k,), at which the amplitude of the displacement first falls to `amplitudes`, (k,).

        For an amplitude that does not occur between the first and the last window (`span`), return the nearer end of
        this span. Amplitudes are in the base unit, such as rad.
        """
        first, last = self.span
        grid = np.linspace(-1, 1, 401)
        falling = np.minimum.accumulate(self.line(grid))
        return first + 0.5 * (np.interp(-np.log(amplitudes), -falling, grid) + 1) * (last - first)

    def halfway(self) -> float:
        """Return the time in s at which the amplitude is the geometric mean of its first and its last value."""
        first, last = np.exp(self.line(np.array([-1.0, 1.0])))
        return float(self.times_of(np.array([np.sqrt(first * last)]))[0])

    @cached_property
    def _curves(self) -> tuple[Smoothed, Smoothed]:
        """Return the smoothed log amplitude of the displacement and the smoothed phase, as functions of scaled time."""
        return _smooth(self.windows, self.sizes), _smooth(self.windows, self.windows.phases, (0.0,))

    def at(self, times: np.ndarray) -> LawFreeDamping:
        """Return amplitude and energy, and damping ratio and frequency (Hz) with standard errors, at times in s, (k,).

        Amplitude and energy are those of the displacement. The times should be within `span`; outside, the curves are
        extrapolated.
        """
        first, last = self.span
        half = 0.5 * (last - first)
        place = 2 * (np.asarray(times, float) - first) / (last - first) - 1
        with threadpool_limits(1, "blas"):
            # The frequency is the slope of the smoothed phases.
            (sizes, slope, variance), (_, frequency, spread) = (curve(place) for curve in self._curves)
        sd = np.sqrt(variance + (RATE_ERROR * slope) ** 2)
        amplitude = np.exp(sizes)
        _, factor, factor_sd, energy = self.backbone.at(amplitude)
        rate = -slope / half * factor
        ratio = rate / np.hypot(rate, 1.0)
        ratio_sd = np.hypot(sd / half * factor, slope / half * factor_sd)
        ratio_sd = np.hypot(ratio_sd, self.harmonic_error * self.backbone.third_harmonic(amplitude) * ratio)
        frequency_sd = np.hypot(np.sqrt(spread), FREQUENCY_ERROR * ratio**2 * frequency)
        frequency, frequency_sd = (w / half / (2 * np.pi) for w in (frequency, frequency_sd))
        return LawFreeDamping(amplitude, ratio, ratio_sd, frequency, frequency_sd, energy)


@once_per_record
def law_free(signal: Signal) -> LawFree:
    """Return the smoothed amplitude and frequency of the displacement in a record.

    The amplitudes and phases of a recorded velocity or acceleration are converted to those of the displacement. Raises
    Refusal if the record does not oscillate or has too few cycles, if the amplitudes of the cycles differ too much for
    a smooth curve, or if the conversion fails because the recorded quantity hardly changes with the amplitude, like the
    acceleration of a pendulum beyond 110 degrees.
    """
    windows = sinusoids(signal)
    # Add a constant error to those of the amplitudes, the most likely of several: noise in a narrow band around the
    # oscillation is not visible within a window, only between windows.
    least, log_sizes, x = float(windows.amplitudes.min()), np.log(windows.amplitudes), windows.scaled_times
    options = [
        replace(windows, errors=np.hypot(windows.errors, share * least / windows.amplitudes))
        for share in CONSTANT_ERRORS
    ]
    windows = max(options, key=lambda w: _smooth_power(w, log_sizes, 0.0)[0].max())
    order = DERIVATIVES[signal.quantity]
    sizes, phases, half = log_sizes, windows.phases, 0.5 * float(windows.times[-1] - windows.times[0])
    if order:
        sizes = log_sizes - order * np.log(np.abs(_fit_line(windows, phases).deriv()(x)) / half)
    for _ in range(CONVERSION_ROUNDS if order else 0):
        line = _fit_line(windows, sizes)
        backbone = _fit_backbone(replace(windows, phases=phases), np.exp(line(x)))
        # A time derivative multiplies x = exp(iωt − σt) by iω − σ. Convert amplitude and phase to the displacement. A
        # whole step would overshoot if the frequency changes much with the amplitude.
        pace, rate = backbone.at(np.exp(line(x)))[0], -line.deriv()(x) / half
        step = 0.5 * (log_sizes - order * np.log(np.hypot(pace, rate)) - sizes)
        sizes, phases = sizes + step, windows.phases - order * np.arctan2(rate, pace)
        if np.abs(step).max() < CONVERTED:
            break
    else:
        if order:
            what = f"the amplitude cannot be computed from the {signal.quantity}"
            raise Refusal(f"{what}: the spring is too far from linear")
    line = _fit_line(windows, sizes)
    # The motion on a cubic spring is x = a (cos φ + ε cos 3φ), with the third harmonic ε. The sinusoids in the windows
    # have the amplitude a; the amplitude of the motion is a (1 + ε).
    backbone = _fit_backbone(replace(windows, phases=phases), np.exp(line(x)))
    sizes = sizes + np.log1p(backbone.third_harmonic(np.exp(line(x))))
    line = _fit_line(windows, sizes)
    backbone = _fit_backbone(replace(windows, phases=phases), np.exp(line(x)))
    averages, width = sizes, 2 * windows.widths / (windows.times[-1] - windows.times[0])
    share = np.linspace(-0.5, 0.5, 41)
    weight = np.cos(np.pi * share) ** 2
    for _ in range(AVERAGING_ROUNDS):
        # Correct for the average over a window, which is larger than at its middle if the curve is convex.
        try:
            curve = scipy.interpolate.CubicSpline(x, _smooth(windows, sizes)(x)[0])
        except np.linalg.LinAlgError:  # the last correction was too large
            raise Refusal(IRREGULAR) from None
        inside = np.exp(curve(x[:, None] + share * width[:, None]) - curve(x)[:, None])
        sizes = averages - np.log(inside @ (weight / weight.sum()))
    windows, line = replace(windows, phases=phases), _fit_line(windows, sizes)
    fit = LawFree(windows, sizes, backbone, line, HARMONIC_ERROR * (1 + order))
    try:
        _ = fit._curves
    except np.linalg.LinAlgError:
        raise Refusal(IRREGULAR) from None
    return fit


def _fit_line(windows: Sinusoids, sizes: np.ndarray) -> np.polynomial.Polynomial:
    """Return a polynomial in time, fitted to the log amplitudes `sizes`, (k,), in the windows.

    The time is scaled to −1 (first window) to 1 (last window); the weights are 1 / standard error.
    """
    degree = min(DEGREE, max(sizes.size // STARTS_PER_WINDOW, 1))
    return np.polynomial.Polynomial.fit(windows.scaled_times, sizes, degree, w=1 / windows.errors)


def _smooth(windows: Sinusoids, values: np.ndarray, powers: Sequence[float] = POWERS) -> Smoothed:
    """Smooth the `values` (k,) of the windows, which are log amplitudes or phases, as functions of time.

    Return a function of scaled times (m,). It returns the smoothed values, their slopes by scaled time, and the
    variances of these slopes. They are weighted means over `powers` and over the variances of the random walk
    (`WALKS`). powers: powers of the amplitude, each of which is modelled as a straight line in time plus an integrated
    random walk (`_smooth_power`). For phases it must be (0.0,), with which the values themselves are modelled.
    """
    each, curves = zip(*(_smooth_power(windows, values, p) for p in powers), strict=True)
    logs = np.concatenate(each)
    weights = np.exp(logs - logs.max())
    weights = weights / weights.sum()

    def smoothed(at: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        sizes, slopes, sds = map(np.concatenate, zip(*(curve(at) for curve in curves), strict=True))
        return weights @ sizes, *_mix_curves(weights, slopes, sds)

    return smoothed


def _mix_curves(
    weights: np.ndarray, values: Sequence[np.ndarray] | np.ndarray, sds: Sequence[np.ndarray] | np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return mean and variance, (k,), of a mixture of m curves with means and standard deviations (m, k).

    weights: weights of the curves, with the sum 1, (m,).
    """
    mean = weights @ np.array(values)
    return mean, weights @ (np.square(sds) + (np.array(values) - mean) ** 2)


@dataclass(frozen=True)
class Backbone:
    """Angular frequency as a function of the amplitude: polynomials in its square, averaged over several degrees.

    Attributes
    ----------
    largest
        Largest amplitude of the displacement, in its base unit; the polynomials are in amplitudes divided by it.
    parts
        For each degree, its weight (their sum is 1), the coefficients (m,) in rad/s of the powers 0, 1, ... of
        (amplitude/`largest`)², and the covariance (m, m) of the coefficients.
    """

    largest: float
    parts: tuple[tuple[float, np.ndarray, np.ndarray], ...]

    def at(self, amplitude: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """Return, at amplitudes (k,), the frequency ω (rad/s), the factor q (s), its sd, and the energy E, (k,) each.

        q times the decay rate −Ȧ/A (1/s) of the amplitude A is (−dE/dt)/(2ωE), which is the damping ratio for light
        damping. sd: standard deviation. Amplitudes are in the unit of `largest`; energies are per unit of inertia, in
        the square of this unit per s².
        """
        a = amplitude / self.largest
        curves = [_backbone_curves(c, a) for _, c, _ in self.parts]
        sds = []
        for (_, c, covariance), middle in zip(self.parts, curves, strict=True):
            # Error propagation: one standard deviation along each principal axis of the covariance.
            values, axes = np.linalg.eigh(covariance)
            total = np.zeros(a.size)
            for size, axis in zip(np.sqrt(np.maximum(values, 0.0)).tolist(), axes.T, strict=True):
                total = total + (_backbone_curves(c + size * axis, a)[1] - middle[1]) ** 2
            sds.append(np.sqrt(total))
        weights = np.array([w for w, _, _ in self.parts])
        ratio, variance = _mix_curves(weights, [c[1] for c in curves], sds)
        frequency, _, energy = (weights @ np.array(rows) for rows in zip(*curves, strict=True))
        return frequency, ratio, np.sqrt(variance), self.largest**2 * energy

    def third_harmonic(self, amplitude: np.ndarray) -> np.ndarray:
        """Return the amplitude ε of the third harmonic divided by that of the first, at amplitudes (k,), (k,).

        For a cubic spring, ε = (1 − (ω₀/ω)²)/24 in the first order of the nonlinearity, where ω₀ is the frequency ω of
        small oscillations (A. H. Nayfeh and D. T. Mook, Nonlinear Oscillations, 1979, 2.3). The result is limited to ±
        `MOST_HARMONIC`. It is negative if the frequency falls with the amplitude. Amplitudes are in the unit of
        `largest`.
        """
        curves = [_pace(c, np.append(0.0, amplitude / self.largest)) for _, c, _ in self.parts]
        natural, pace = np.split(np.array([w for w, _, _ in self.parts]) @ np.array(curves), [1])
        return np.clip((1 - (natural / pace) ** 2) / 24, -MOST_HARMONIC, MOST_HARMONIC)


def _backbone_curves(c: np.ndarray, a: np.ndarray) -> np.ndarray:
    """Return rows (3, k) at relative amplitudes a (k,): frequency ω, damping ratio divided by the rate −ȧ/a, energy E.

    c: coefficients of ω as a polynomial in a². The damping ratio is (−dE/dt)/(2ωE). The energy is E(a) = ∫ ω dJ, with
    the action J = ωa²(1 − 2ε)/2 of a nearly sinusoidal oscillation. ε = (1 − (ω₀/ω)²)/24 is the third harmonic of a
    cubic spring, and ω₀ is the frequency of small oscillations.
    """
    slope = np.polynomial.polynomial.polyder(c)

    def action_slope(b: np.ndarray, w: np.ndarray) -> np.ndarray:
        """Return dJ/da, where J = (11 ω + ω₀²/ω) a²/24."""
        share = np.minimum((c[0] / w) ** 2, 1 + 24 * MOST_HARMONIC)
        steep = 2 * b * np.polynomial.polynomial.polyval(b**2, slope)
        return b * w * (11 + share) / 12 + b**2 * steep * (11 - share) / 24

    inside, w = 0.5 * a[:, None] * (_X + 1), _pace(c, a)
    within = _pace(c, inside)
    energy = np.maximum(0.5 * a * ((within * action_slope(inside, within)) @ _W), LEAST_PACE * (a * w) ** 2)
    return np.stack([w, a * action_slope(a, w) / (2 * energy), energy])


def _pace(c: np.ndarray, a: np.ndarray) -> np.ndarray:
    """Return the frequency ω at relative amplitudes a: a polynomial in a² with coefficients c, limited to above 0."""
    return np.maximum(np.polynomial.polynomial.polyval(a**2, c), LEAST_PACE * abs(c[0]))


def _fit_backbone(windows: Sinusoids, amplitude: np.ndarray) -> Backbone:
    """Fit the frequency as a polynomial in the squared amplitude to the phases in the windows.

    The phases are modelled as a constant plus the time integral of this polynomial. Polynomials with one, two and three
    coefficients are fitted (fewer in short records, if these fit: `POOR_FIT`). Those that are positive at all
    amplitudes up to the largest are weighted in the result by the Bayesian information criterion. amplitude: amplitude
    of the displacement in the windows, (k,).
    """
    t, largest = windows.times, float(amplitude.max())
    a = amplitude / largest
    root = np.linalg.cholesky(windows.covariance)
    independent = ESTIMATES_PER_WINDOW * t.size / STARTS_PER_WINDOW
    fits, variance = [], 1.0
    for count in (1, 2, 3):
        if count > 1 and independent < count + 1 and (variance < POOR_FIT or t.size < count + 2):
            break
        rates = a[:, None] ** (2 * np.arange(count))
        steps = 0.5 * (rates[1:] + rates[:-1]) * np.diff(t)[:, None]
        integrals = np.concatenate([np.zeros((1, count)), np.cumsum(steps, axis=0)])
        white = np.linalg.solve(root, np.column_stack([np.ones(t.size), integrals]))
        inverse = np.linalg.pinv(white)
        aim = np.linalg.solve(root, windows.phases)
        c = inverse @ aim
        freedom = t.size - count - 1 + NOISE_WEIGHT
        variance = (float(np.sum((aim - white @ c) ** 2)) + NOISE_WEIGHT) / freedom
        wide = float(scipy.special.stdtrit(independent - count - 1 + NOISE_WEIGHT, 0.975)) / NORMAL_95
        covariance = (inverse @ inverse.T)[1:, 1:] * max(variance, 1.0) * wide**2
        if count == 1 or np.all(np.polynomial.polynomial.polyval(np.linspace(0, 1, 21), c[1:]) > 0):
            score = independent * np.log(variance) + (count + 1) * np.log(independent)
            fits.append((score, c[1:], covariance))
    logs = np.array([f[0] for f in fits])
    weights = np.exp(-0.5 * (logs - logs.min()))
    weights /= weights.sum()
    return Backbone(largest, tuple((float(w), c, cov) for w, (_, c, cov) in zip(weights, fits, strict=True)))


def _smooth_power(windows: Sinusoids, logs: np.ndarray, power: float) -> tuple[np.ndarray, Smoothed]:
    """Smooth the amplitude: model a power of it (0: its log) as a straight line in time plus an integrated random walk.

    logs: log amplitudes in the windows, (n,), whose errors have the covariance of the windows. With power 0 they may
    also be phases, which are then smoothed themselves. Return the log marginal likelihoods plus log priors, in nats, of
    the v variances of the walk in `WALKS`, (v,). Return also a function of scaled times (k,), which returns, for each
    variance, the smoothed log amplitudes (or phases), their slopes in scaled time, and the standard deviations of the
    slopes, (v, k) each.
    """
    x, middle = windows.scaled_times, logs.mean()
    base = np.exp(power * (logs - middle))
    values = logs - middle if power == 0 else (base - 1) / power
    # Covariance of the transformed values, and kernel of the integrated random walk, which starts at the first window.
    noise = windows.covariance * np.outer(base, base)
    scale = float(np.exp(np.mean(np.log(np.diag(noise)))))
    z = x + 1.0  # scaled times from the start
    less, more = np.minimum(z[:, None], z), np.maximum(z[:, None], z)
    walk = less**2 * (3 * more - less) / 6
    # Transform the values to coordinates in which the noise is independent with variance `scale`, and the walk is
    # independent too.
    root = np.linalg.cholesky(noise / scale)
    inverse_root = np.linalg.inv(root)
    powers, axes = np.linalg.eigh(inverse_root @ walk @ inverse_root.T)
    to_axes = axes.T @ inverse_root
    columns, values = to_axes @ np.stack([np.ones_like(x), x], axis=1), to_axes @ values
    precision = 1 / (1 + WALKS[:, None] * np.maximum(powers, 0.0))  # (v, n)
    weighted = columns * precision[:, :, None]
    inverse = np.linalg.inv(columns.T @ weighted)
    c = (inverse @ (values @ weighted)[:, :, None])[:, :, 0]
    rest = values - c @ columns.T
    off, free = rest * precision, x.size - 2
    variance = (np.sum(rest * off, axis=1) + NOISE_WEIGHT * scale) / (free + NOISE_WEIGHT)
    prior = np.where(WALKS == 0, PROBABILITY_NO_WALK, (1 - PROBABILITY_NO_WALK) / (WALKS.size - 1))
    log = (
        np.log(prior)
        - np.sum(np.log(np.diag(root)))
        + 0.5 * np.sum(np.log(precision), axis=1)
        + 0.5 * np.linalg.slogdet(inverse)[1]
        - 0.5 * (free + NOISE_WEIGHT) * np.log(variance)
        + np.sum(np.log(base))  # Jacobian: all densities are those of the log amplitudes
    )
    degrees = free * ESTIMATES_PER_WINDOW / STARTS_PER_WINDOW + NOISE_WEIGHT
    wide = float(scipy.special.stdtrit(degrees, 0.975)) / NORMAL_95

    def curves(at: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        w = np.maximum(at + 1.0, 0.0)
        less, more = np.minimum(w[:, None], z), np.maximum(w[:, None], z)
        walk_at = less**2 * (3 * more - less) / 6 @ to_axes.T
        walk_slope = (z * less - 0.5 * less**2) @ to_axes.T
        level = c[:, :1] + c[:, 1:] * at + WALKS[:, None] * (off @ walk_at.T)
        # Keep the curve within 20 to 25 % of the amplitudes.
        base_at = np.interp(at, x, base)
        stretched = np.clip(1 + power * level, 0.8 * base_at, 1.25 * base_at)
        sizes = middle + (level if power == 0 else np.log(stretched) / power)
        slopes = (c[:, 1:] + WALKS[:, None] * (off @ walk_slope.T)) / stretched
        line = np.array([0.0, 1.0]) - WALKS[:, None, None] * (walk_slope @ weighted)
        spread = WALKS[:, None] * (w - WALKS[:, None] * (precision @ walk_slope.T**2))
        spread += np.sum(line @ inverse * line, axis=2)
        return sizes, slopes, wide * np.sqrt(variance[:, None] * np.maximum(spread, 0.0)) / stretched

    return log, curves
