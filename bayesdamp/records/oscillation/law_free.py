"""Measure damping and frequency against amplitude from the record alone, without a damping law or a restoring law.

Sinusoids are fitted in short windows. A window of two periods or more, weighted by a raised cosine, isolates the
oscillation: a second mode or a harmonic near twice its frequency or above hardly changes the fitted amplitude, whereas
it changes turning points by its own size.

The amplitudes and phases are then smoothed. The amplitude, or a power of it, is a straight line in time plus an
integrated random walk, so that the rate of decay may wander (a cubic smoothing spline: G. Wahba, 1978); the walk's size
is unknown and averaged over by its marginal likelihood. The frequency is the slope of the phases, smoothed in the same
way. A polynomial in the squared amplitude through it gives the energy of the oscillation, and with it the equivalent
viscous damping ratio.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import scipy  # loads its modules when they are used
from scipy.linalg import cho_factor, cho_solve
from scipy.ndimage import median_filter, uniform_filter1d
from scipy.special import stdtrit
from threadpoolctl import threadpool_limits

from bayesdamp import formatting as fmt
from bayesdamp.records.oscillation.features import features, once_per_record
from bayesdamp.records.oscillation.noise import of_equal_size
from bayesdamp.records.oscillation.spectrum import averaged
from bayesdamp.types import Refusal, Signal
from bayesdamp.units import Unit

SHORTEST, LONGEST, SHARE = 2.0, 8.0, 0.05
"""Shortest and longest window in periods, and its share of the record's cycles between these (conventional)."""
PER_WINDOW = 4
"""Windows that begin within the length of one."""
MOST, FEWEST = 100, 3
"""Most windows (in a longer record they are further apart), and fewest."""
PER_CYCLE = 64
"""Samples a cycle above which neighbours are averaged, which makes every amplitude 0.04 % smaller."""
FEWEST_SAMPLES = 8
"""Fewest samples of a window."""
COVERED = 0.6
"""Share of a window's weight that samples must cover, so that windows over holes are left out."""
FAR = 6.0
"""Robust standard deviations from which a sample is left out of a window's fit."""
ROUNDING = 0.29
"""Standard deviation of a rounding error, in steps."""
LEAST_ERROR = 1e-5
"""Smallest relative error of an amplitude: below it the fit's own error rules."""
NUGGET = 1e-3
"""Share of the errors' variance that neighbouring windows do not share, which keeps the correlation matrix regular."""
POWERS = (-1.0, -0.5, 0.0, 0.5, 1.0)
"""Powers of the amplitude (0: its log) that may be a straight line in time: drag makes the first one, viscous damping
the middle one, dry friction the last (Box and Cox 1964)."""
WALKS = np.concatenate([[0.0], np.geomspace(1.0, 1e8, 9)])
"""Variances of the random walk over the whole record, relative to those of the amplitudes' errors: none, and as
much as the errors or more."""
KNOWN = 4.0
"""Number of amplitudes that the noise within the windows is worth, in addition to their scatter (conventional)."""
STEADY = 0.2
"""Prior probability that there is no walk; its sizes share the rest. No power of a sum of dampings is a straight
line, so that with 0.5 and smaller walks the intervals at the ends of a record were too narrow (of 104 records, one by a
factor of 7; with these, of 3.5)."""
SYSTEMATIC = 5e-4
"""Relative error of every rate, from averaging over a window."""
SLOWER = 1.0
"""Relative error of a frequency, in squares of the damping ratio: the phase of a decaying sinusoid is slower than the
natural frequency by half of this square with viscous damping, by twice it with dry friction, whose alternating offset
4 δ / π is at right angles to the sinusoid and grows relative to it."""
TWO_SIDED = 1.96
"""Standard deviations of a 95 % interval."""
DEGREE = 5
"""Highest degree of the polynomial of log amplitudes that gives the times of amplitudes."""
ROUNDS = 2
"""Number of rounds that correct the amplitudes for the average over their windows."""
FLOORS = (0.0, 0.03, 0.1, 0.3, 1.0)
"""Constant errors that are tried, relative to the smallest amplitude."""
POINTS = 12
"""Points of a curve that is drawn."""
INDEPENDENT = 1.5
"""Windows' starts within one window over the number of independent estimates in it (of raised cosines)."""
_X, _W = np.polynomial.legendre.leggauss(16)


@dataclass(frozen=True)
class Sinusoids:
    """Fits in k windows, in the order of time.

    Attributes
    ----------
    times
        Middles of the windows in s, (k,).
    amplitudes
        In the unit of the record, (k,).
    phases
        In rad, continuous along the record, (k,).
    errors
        Standard errors of the phases, which are those of the amplitudes relative to themselves, (k,).
    correlation
        Of the errors of overlapping windows, (k, k).
    widths
        Of the windows in s, (k,).
    """

    times: np.ndarray
    amplitudes: np.ndarray
    phases: np.ndarray
    errors: np.ndarray
    correlation: np.ndarray
    widths: np.ndarray

    @property
    def covariance(self) -> np.ndarray:
        """Return the covariance of the errors, (k, k)."""
        return self.errors[:, None] * self.errors * self.correlation

    @property
    def places(self) -> np.ndarray:
        """Return the times scaled to −1 to 1 along the record, (k,)."""
        first, last = self.times[0], self.times[-1]
        return 2 * (self.times - first) / (last - first) - 1


def sinusoids(signal: Signal) -> Sinusoids:
    """Fit a sinusoid of linearly changing amplitude and midline in each of many overlapping windows.

    Raises Refusal where the record is too short for three windows.
    """
    measured = features(signal)
    block = max(int(measured.samples_per_cycle / PER_CYCLE), 1)
    t, y = (averaged(np.asarray(values, float), block) for values in (signal.t, signal.y))
    first = max(float(t[0]), float(measured.swing_times[0]) - 0.75 * measured.period)
    last = min(float(t[-1]), float(measured.swing_times[-1]) + 0.75 * measured.period)
    crossings = measured.crossing_times
    if last - first > MOST * SHORTEST * measured.period and crossings.size > 1:
        # Windows that hardly overlap do not show how many turns are between them: turning points do.
        first, last = max(first, float(crossings[0])), min(last, float(crossings[-1]))
    span = (last - first) / measured.period
    periods = max(min(float(np.clip(SHARE * measured.cycles, SHORTEST, LONGEST)), span - 1.5), 1.0)
    inside = last - first - periods * measured.period
    count = int(np.clip(PER_WINDOW * inside / (periods * measured.period) + 1, FEWEST, MOST))
    middles = first + 0.5 * periods * measured.period + np.linspace(0, 1, count) * max(inside, 0.0)
    # A first pace from neighbouring turning points, smooth, so that one spoilt point does no harm.
    turns = measured.turning_times
    local = np.full(middles.size, measured.period)
    if turns.size >= 3:
        local = turns[2:] - turns[:-2]
        if local.size >= 5:
            local = uniform_filter1d(median_filter(local, 5, mode="nearest"), 5, mode="nearest")
        local = np.interp(middles, turns[1:-1], local)
    # The phases are more precise than turning points, which a second mode shifts: fit again with their pace.
    times, _, phases, _, used = _fit_windows(t, y, middles, 2 * np.pi / local, periods, crossings)
    pace = np.interp(middles, times, np.gradient(phases, times))
    pace = np.clip(pace, 0.8 * used.min(), 1.25 * used.max())
    times, amplitudes, phases, gains, used = _fit_windows(t, y, middles, pace, periods, crossings)
    widths = 2 * np.pi * periods / used
    noise = float(np.hypot(measured.roughness, ROUNDING * signal.step)) / np.sqrt(block)
    errors = np.maximum(noise * gains / amplitudes, LEAST_ERROR)
    # Estimates from overlapping raised cosines correlate by these windows' autocorrelation at their distance. One width
    # for all keeps the matrix positive definite.
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
    periods: float,
    crossings: np.ndarray,
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Fit windows of so many periods at `middles` (m,) with sinusoids of a pace (m,), in rad/s.

    crossings: times in s at which the record crosses its midline, (c,). Return times, amplitudes, continuous phases,
    noise gains and pace of the windows that have samples, (k,) each. Raises Refusal where these are too few.
    """
    width = periods * 2 * np.pi / pace
    begins = np.searchsorted(t, middles - 0.5 * width)
    sizes = np.searchsorted(t, middles + 0.5 * width) - begins
    spacing = float(t[-1] - t[0]) / (t.size - 1)
    fits = np.full((3, middles.size), np.nan)
    for n, same in of_equal_size(sizes, FEWEST_SAMPLES):
        rows, wide = begins[same, None] + np.arange(n), width[same, None]
        u, values = t[rows] - middles[same, None], y[rows]
        angle, place = pace[same, None] * u, u / wide
        wave = [np.cos(angle), np.sin(angle)]
        columns = np.stack([*wave, np.ones_like(u), place, place * wave[0], place * wave[1]], axis=2)
        weight = np.cos(np.pi * u / wide) ** 2
        c, inverse = _solve_weighted(columns, values, weight)
        off = np.abs(values - (columns @ c[:, :, None])[:, :, 0])
        far = off > FAR * 1.4826 * np.median(off, axis=1, keepdims=True)
        again = np.flatnonzero(far.any(axis=1) & (np.sum(~far, axis=1) >= FEWEST_SAMPLES))
        weight[again] = np.where(far[again], 0.0, weight[again])
        c[again], inverse[again] = _solve_weighted(columns[again], values[again], weight[again])
        size = np.hypot(c[:, 0], c[:, 1])
        good = (size > 0) & (weight.sum(axis=1) * spacing >= COVERED * 0.5 * wide[:, 0])
        which, c, size = same[good], c[good], size[good]
        ends = c[:, 0, None] * inverse[good, 0] + c[:, 1, None] * inverse[good, 1]
        gains = np.linalg.norm(ends / size[:, None], axis=1)
        fits[:, which] = size, np.arctan2(-c[:, 1], c[:, 0]), gains
    good = np.isfinite(fits[0])
    if np.count_nonzero(good) < FEWEST:
        raise Refusal("the record has too few cycles to estimate damping and frequency")
    times, used, (amplitudes, phases, gains) = middles[good], pace[good], fits[:, good]
    # Whole turns are added to the phases, so that they advance as the crossings of the midline count them.
    ahead = np.diff(times) * 0.5 * (used[1:] + used[:-1])
    if crossings.size > 1:
        counted = np.diff(np.interp(times, crossings, np.pi * np.arange(crossings.size)))
        within = (times[:-1] >= crossings[0]) & (times[1:] <= crossings[-1])
        ahead = np.where(within, counted, ahead)
    steps = np.diff(phases)
    steps = steps + 2 * np.pi * np.round((ahead - steps) / (2 * np.pi))
    phases = phases[0] + np.concatenate([[0.0], np.cumsum(steps)])
    return times, amplitudes, phases, gains, used


def _solve_weighted(
    columns: np.ndarray, values: np.ndarray, weight: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Solve weighted least squares in w windows with columns (w, n, 6), values and weights (w, n).

    Return the coefficients (w, 6) and the matrices (w, 6, n) that give them.
    """
    weighted = np.swapaxes(columns * weight[:, :, None], 1, 2)
    inverse = np.linalg.pinv(weighted @ columns, hermitian=True) @ weighted
    return (inverse @ values[:, :, None])[:, :, 0], inverse


@dataclass(frozen=True)
class Curves:
    """Curves at k places along a record, each of shape (k,).

    Attributes
    ----------
    amplitude
        Of the displacement, in rad or m.
    ratio, ratio_sd
        Equivalent viscous damping ratio, and its standard error.
    frequency, frequency_sd
        Angular frequency in rad/s, and its standard error.
    """

    amplitude: np.ndarray
    ratio: np.ndarray
    ratio_sd: np.ndarray
    frequency: np.ndarray
    frequency_sd: np.ndarray


@dataclass(frozen=True)
class LawFree:
    """The smoothed amplitude and frequency of a record, from which `at` evaluates curves.

    Attributes
    ----------
    windows
        The fits in windows.
    sizes
        Log amplitudes of the displacement in the windows, (k,).
    backbone
        The frequency's polynomial.
    line
        A polynomial log amplitude, by the place −1 to 1 along the record.
    """

    windows: Sinusoids
    sizes: np.ndarray
    backbone: Backbone
    line: np.polynomial.Polynomial

    @property
    def span(self) -> tuple[float, float]:
        """Return the first and last time that it covers, in s."""
        return float(self.windows.times[0]), float(self.windows.times[-1])

    def times_of(self, amplitudes: np.ndarray) -> np.ndarray:
        """Return when the displacement has these amplitudes (rad or m), in s, within the span."""
        first, last = self.span
        grid = np.linspace(-1, 1, 401)
        falling = np.minimum.accumulate(self.line(grid))
        return first + 0.5 * (np.interp(-np.log(amplitudes), -falling, grid) + 1) * (last - first)

    def halfway(self) -> float:
        """Return when the log amplitude is halfway between its first and its last, in s."""
        first, last = np.exp(self.line(np.array([-1.0, 1.0])))
        return float(self.times_of(np.array([np.sqrt(first * last)]))[0])

    def at(self, times: np.ndarray) -> Curves:
        """Evaluate the curves at times in s, shape (k,)."""
        first, last = self.span
        half = 0.5 * (last - first)
        place = 2 * (np.asarray(times, float) - first) / (last - first) - 1
        with threadpool_limits(1, "blas"):
            sizes, slope, variance = _smooth(self.windows, self.sizes, place)
            # The frequency is the slope of the smoothed phases.
            _, frequency, spread = _smooth(self.windows, self.windows.phases, place, (0.0,))
        sd = np.sqrt(variance + (SYSTEMATIC * slope) ** 2)
        amplitude = np.exp(sizes)
        _, energy, energy_sd = self.backbone.at(amplitude)
        rate = -slope / half * energy
        ratio = rate / np.hypot(rate, 1.0)
        ratio_sd = np.hypot(sd / half * energy, slope / half * energy_sd)
        frequency_sd = np.hypot(np.sqrt(spread), SLOWER * ratio**2 * frequency)
        return Curves(amplitude, ratio, ratio_sd, frequency / half, frequency_sd / half)


@once_per_record
def law_free(signal: Signal) -> LawFree:
    """Smooth a record's amplitude and frequency. Raises Refusal where it has too few cycles."""
    windows = sinusoids(signal)
    # The likeliest of several constant errors is added to those of the amplitudes: noise that was filtered to the
    # oscillation's own band does not appear within a window, only between windows.
    least, log_sizes, x = float(windows.amplitudes.min()), np.log(windows.amplitudes), windows.places
    options = [
        replace(windows, errors=np.hypot(windows.errors, share * least / windows.amplitudes))
        for share in FLOORS
    ]
    windows = max(options, key=lambda w: max(f.log for f in _smooth_power(w, log_sizes, 0.0, x[:1], False)))
    order = {"angle": 0, "velocity": 1, "acceleration": 2}[signal.quantity]
    sizes, half = log_sizes, 0.5 * float(windows.times[-1] - windows.times[0])
    line = _fit_line(windows, sizes)
    backbone, phases = _fit_backbone(windows, np.exp(line(x))), windows.phases
    for _ in range(2 if order else 0):
        # A derivative multiplies x = exp(iωt − σt) by iω − σ: amplitude and phase of the displacement.
        pace, rate = backbone.at(np.exp(line(x)))[0], -line.deriv()(x) / half
        sizes = log_sizes - order * np.log(np.hypot(pace, rate))
        line = _fit_line(windows, sizes)
        phases = windows.phases - order * np.arctan2(rate, pace)
        backbone = _fit_backbone(replace(windows, phases=phases), np.exp(line(x)))
    averages, width = sizes, 2 * windows.widths / (windows.times[-1] - windows.times[0])
    share = np.linspace(-0.5, 0.5, 41)
    weight = np.cos(np.pi * share) ** 2
    for _ in range(ROUNDS):
        # A window's average amplitude is larger than the one in its middle where the curve is hollow.
        curve = scipy.interpolate.CubicSpline(x, _smooth(windows, sizes, x, with_slopes=False)[0])
        inside = np.exp(curve(x[:, None] + share * width[:, None]) - curve(x)[:, None])
        sizes = averages - np.log(inside @ (weight / weight.sum()))
    return LawFree(replace(windows, phases=phases), sizes, backbone, _fit_line(windows, sizes))


def amplitude_curves(signal: Signal) -> Curves:
    """Evaluate the curves at up to `POINTS` times along a record, from the first on.

    Raises Refusal where it has too few cycles.
    """
    fit = law_free(signal)
    count = int(np.clip(fit.sizes.size // PER_WINDOW + 1, 2, POINTS))
    return fit.at(np.linspace(*fit.span, count))


def _fit_line(windows: Sinusoids, sizes: np.ndarray) -> np.polynomial.Polynomial:
    """Fit a polynomial to log amplitudes (k,)."""
    degree = min(DEGREE, max(sizes.size // PER_WINDOW, 1))
    return np.polynomial.Polynomial.fit(windows.places, sizes, degree, w=1 / windows.errors)


def _smooth(
    windows: Sinusoids,
    values: np.ndarray,
    at: np.ndarray,
    powers: Sequence[float] = POWERS,
    with_slopes: bool = True,
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Smooth log amplitudes or phases (k,).

    Return those at places `at` (m,), their slopes by the place, and the variances of the slopes, these two empty where
    they are not wanted.
    """
    fits = [f for p in powers for f in _smooth_power(windows, values, p, at, with_slopes)]
    logs = np.array([f.log for f in fits])
    weights = np.exp(logs - logs.max())
    weights = weights / weights.sum()
    slope, variance = _mix(weights, [f.slopes for f in fits], [f.sds for f in fits])
    return weights @ np.array([f.sizes for f in fits]), slope, variance


def _mix(
    weights: np.ndarray, values: Sequence[np.ndarray], sds: Sequence[np.ndarray]
) -> tuple[np.ndarray, np.ndarray]:
    """Return mean and variance, (k,), of a mixture of curves with these weights (m,), values and sds, (m, k)."""
    mean = weights @ np.array(values)
    return mean, weights @ (np.square(sds) + (np.array(values) - mean) ** 2)


@dataclass(frozen=True)
class Backbone:
    """Angular frequency as a polynomial in the squared amplitude: several degrees, each with a weight.

    Attributes
    ----------
    largest
        The amplitude by which amplitudes are divided.
    parts
        Weight, coefficients (m,), and their covariance (m, m), of each degree.
    """

    largest: float
    parts: tuple[tuple[float, np.ndarray, np.ndarray], ...]

    def at(self, amplitude: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Evaluate at amplitudes (k,).

        Return the frequency (rad/s), and the factor that turns a rate of decay (1/s) into a damping ratio, with its sd
        (s).
        """
        a = amplitude / self.largest
        curves = [_backbone_curves(c, a) for _, c, _ in self.parts]
        sds = []
        for (_, c, covariance), middle in zip(self.parts, curves, strict=True):
            # One step along each principal axis of the coefficients' covariance.
            values, axes = np.linalg.eigh(covariance)
            total = np.zeros(a.size)
            for size, axis in zip(np.sqrt(np.maximum(values, 0.0)).tolist(), axes.T, strict=True):
                total = total + (_backbone_curves(c + size * axis, a)[1] - middle[1]) ** 2
            sds.append(np.sqrt(total))
        weights = np.array([w for w, _, _ in self.parts])
        ratio, variance = _mix(weights, [c[1] for c in curves], sds)
        return weights @ np.array([c[0] for c in curves]), ratio, np.sqrt(variance)


def _backbone_curves(c: np.ndarray, a: np.ndarray) -> np.ndarray:
    """Return the frequency at relative amplitudes a (k,), and the damping ratio over the rate of decay, (2, k).

    The damping ratio is the rate of decay of the energy over 2ω. The action of a nearly sinusoidal oscillation is
    J = ωa²/2, and its energy E has dE/dJ = ω exactly.
    """
    powers = np.arange(c.size)

    def pace(b: np.ndarray) -> np.ndarray:
        return np.maximum((b[..., None] ** (2 * powers)) @ c, 1e-6 * abs(c[0]) + 1e-300)

    def bend(b: np.ndarray) -> np.ndarray:
        return (2 * powers[1:] * b[..., None] ** (2 * powers[1:] - 1)) @ c[1:]

    inside = 0.5 * a[:, None] * (_X + 1)
    w = pace(inside)
    energy = 0.5 * a * ((w * (w * inside + 0.5 * inside**2 * bend(inside))) @ _W)
    omega = pace(a)
    return np.stack([omega, omega * a**2 * (2 + a * bend(a) / omega) / (4 * np.maximum(energy, 1e-300))])


def _fit_backbone(windows: Sinusoids, amplitude: np.ndarray) -> Backbone:
    """Fit the phases by integrals over time of the powers of the squared amplitude (k,)."""
    t, largest = windows.times, float(amplitude.max())
    a = amplitude / largest
    root = np.linalg.cholesky(windows.covariance)
    independent = INDEPENDENT * t.size / PER_WINDOW
    fits = []
    for count in (1, 2, 3):
        if count > 1 and independent < count + 1:
            break
        rates = a[:, None] ** (2 * np.arange(count))
        steps = 0.5 * (rates[1:] + rates[:-1]) * np.diff(t)[:, None]
        integrals = np.concatenate([np.zeros((1, count)), np.cumsum(steps, axis=0)])
        white = np.linalg.solve(root, np.column_stack([np.ones(t.size), integrals]))
        inverse = np.linalg.pinv(white)
        aim = np.linalg.solve(root, windows.phases)
        c = inverse @ aim
        variance = (float(np.sum((aim - white @ c) ** 2)) + KNOWN) / (t.size - count - 1 + KNOWN)
        wide = float(stdtrit(independent - count - 1 + KNOWN, 0.975)) / TWO_SIDED
        covariance = (inverse @ inverse.T)[1:, 1:] * max(variance, 1.0) * wide**2
        fits.append((independent * np.log(variance) + (count + 1) * np.log(independent), c[1:], covariance))
    logs = np.array([f[0] for f in fits])
    weights = np.exp(-0.5 * (logs - logs.min()))
    weights /= weights.sum()
    return Backbone(largest, tuple((float(w), c, cov) for w, (_, c, cov) in zip(weights, fits, strict=True)))


@dataclass(frozen=True)
class _Smoothed:
    """One curve: log marginal likelihood; log amplitudes, their slopes by the place, and the slopes' sds, (k,)."""

    log: float
    sizes: np.ndarray
    slopes: np.ndarray
    sds: np.ndarray


def _smooth_power(
    windows: Sinusoids, logs: np.ndarray, power: float, at: np.ndarray, with_slopes: bool
) -> list[_Smoothed]:
    """Smooth a power of the amplitude by a line and a random walk of each of the sizes.

    logs: log amplitudes in the windows, (n,), whose relative errors have the windows' covariance. at: places where the
    curve is wanted, (k,). with_slopes: whether its slopes and their sds are wanted too; else they are empty.
    """
    x = windows.places
    middle = logs.mean()
    base = np.exp(power * (logs - middle))
    values = logs - middle if power == 0 else (base - 1) / power
    noise = windows.covariance * np.outer(base, base)
    scale = float(np.exp(np.mean(np.log(np.diag(noise)))))
    columns = np.stack([np.ones_like(x), x], axis=1)
    columns_at = np.stack([np.ones_like(at), at], axis=1)
    columns_slope = np.stack([0 * at, np.ones_like(at)], axis=1)
    z, w = x + 1.0, np.maximum(at + 1.0, 0.0)  # distances from the start, where the walk begins
    less, more = np.minimum(z[:, None], z), np.maximum(z[:, None], z)
    walk = less**2 * (3 * more - less) / 6
    less, more = np.minimum(w[:, None], z), np.maximum(w[:, None], z)
    walk_at, walk_slope = less**2 * (3 * more - less) / 6, z * less - 0.5 * less**2
    free = x.size - 2
    wide = float(stdtrit(free * INDEPENDENT / PER_WINDOW + KNOWN, 0.975)) / TWO_SIDED
    base_at = np.interp(at, x, base)
    curves = []
    prior = np.log(np.where(WALKS == 0, STEADY, (1 - STEADY) / (WALKS.size - 1)))
    for ratio, log_prior in zip(WALKS.tolist(), prior.tolist(), strict=True):
        try:
            factor = cho_factor(noise / scale + ratio * walk, lower=True)
        except np.linalg.LinAlgError:
            continue  # a walk so much larger than the errors leaves no digits of these
        weighted = cho_solve(factor, columns)
        inverse = np.linalg.inv(columns.T @ weighted)
        c = inverse @ (weighted.T @ values)
        rest = values - columns @ c
        off = cho_solve(factor, rest)
        variance = (float(rest @ off) + KNOWN * scale) / (free + KNOWN)
        log = (
            log_prior
            - float(np.sum(np.log(np.diag(factor[0]))))
            + 0.5 * float(np.linalg.slogdet(inverse)[1])
            - 0.5 * (free + KNOWN) * np.log(variance)
            + float(np.sum(np.log(base)))  # densities are those of the log amplitudes
        )
        level = columns_at @ c + ratio * walk_at @ off
        # The curve may not leave the amplitudes.
        stretched = np.clip(1 + power * level, 0.8 * base_at, 1.25 * base_at)
        sizes = middle + (level if power == 0 else np.log(stretched) / power)
        slopes = sds = np.empty(0)
        if with_slopes:
            slopes = (columns_slope @ c + ratio * walk_slope @ off) / stretched
            by_walk = ratio * cho_solve(factor, walk_slope.T)
            line = columns_slope - by_walk.T @ columns
            spread = ratio * (w - np.einsum("ij,ji->i", walk_slope, by_walk)) + np.einsum(
                "ij,jk,ik->i", line, inverse, line
            )
            sds = wide * np.sqrt(variance * np.maximum(spread, 0.0)) / stretched
        curves.append(_Smoothed(log, sizes, slopes, sds))
    return curves


@dataclass(frozen=True)
class DampingAt:
    """The equivalent viscous damping ratio at an amplitude (rad or m), with its standard error.

    It is the energy lost in a cycle over 4π times the energy of the oscillation at that amplitude; for a linear spring,
    −(dA/dt)/(ωA).
    """

    amplitude: float
    ratio: float
    stderr: float

    @property
    def quality(self) -> float:
        """Return the quality factor, 1/(2 ratio)."""
        return 0.5 / self.ratio if self.ratio else float("inf")


@dataclass(frozen=True)
class FirstWords:
    """What a record shows before any model is fitted.

    Attributes
    ----------
    frequency, frequency_low, frequency_high
        In Hz, mean of the piece used, and its 95 % interval, nan where there are too few crossings for one.
    damping
        At the largest amplitude of the piece, the geometric mean, and the smallest that is clear of the noise.
    cycles
        Number above the noise.
    start, stop
        Of the piece used, in s of the record's own times.
    unit
        "rad" or "m", of the amplitudes.
    """

    frequency: float
    frequency_low: float
    frequency_high: float
    damping: tuple[DampingAt, DampingAt, DampingAt]
    cycles: float
    start: float
    stop: float
    unit: str = "rad"

    @property
    def quality(self) -> float:
        """Return the quality factor at the middle amplitude."""
        return self.damping[1].quality

    def in_unit(self, unit: Unit) -> FirstWords:
        """Return the same with amplitudes in a record's own unit of displacement."""
        own = unit.displacement
        if own.base != self.unit:
            return self
        top, middle, least = (replace(d, amplitude=d.amplitude * own.scale) for d in self.damping)
        return replace(self, damping=(top, middle, least), unit=own.name)

    def sentence(self) -> str:
        """Write it as a sentence; half a 95 % interval follows each ±."""
        top, middle, least = self.damping
        half = (self.frequency_high - self.frequency_low) / 2
        near = half < self.frequency
        frequency = fmt.with_error(self.frequency, half) if near else f"about {self.frequency:.2g}"
        span = f"({self.start:.4g} to {self.stop:.4g} s)"
        lead = f"It oscillates at {frequency} Hz for {self.cycles:.0f} cycles {span}"
        at = [
            f"{fmt.with_error(100 * d.ratio, 100 * TWO_SIDED * d.stderr)} % at {d.amplitude:.2g} {self.unit}"
            for d in self.damping
        ]
        ratio = f"the equivalent viscous damping ratio (95 %) is {fmt.listing(at)}"
        pairs = [(a.ratio - b.ratio, np.hypot(a.stderr, b.stderr)) for a, b in ((top, middle), (top, least))]
        spread, error = max(pairs, key=lambda pair: abs(pair[0]) / pair[1])
        q = self.quality
        quality = f" (Q about {float(f'{q:.2g}'):g})" if np.isfinite(q) and q > 0 else ""
        if abs(spread) <= max(3 * error, 0.1 * middle.ratio):
            change = "it does not clearly change with the amplitude (as with viscous damping)"
        elif spread > 0:
            change = "it grows with the amplitude (as with drag)"
        else:
            change = "it grows as the amplitude falls (as with dry friction)"
        return f"{lead}; {ratio}{quality}; {change}."


def first_words(signal: Signal) -> FirstWords:
    """Return frequency, equivalent viscous damping ratio and Q of a free decay, without a damping law.

    Raises Refusal where the record does not oscillate.

    >>> import bayesdamp as bd
    >>> signal = bd.simulate({"viscous": 0.05}, stiffness=20.0, duration=10.0, samples=400, noise_sd=0.003)
    >>> round(bd.first_words(signal).frequency, 2)  # Hz
    0.71
    """
    measured = features(signal)
    fit = law_free(signal)
    first, last = fit.span
    at = fit.at(np.array([first, fit.halfway(), last, *fit.windows.times]))
    damping = zip(at.amplitude[:3].tolist(), at.ratio[:3].tolist(), at.ratio_sd[:3].tolist(), strict=True)
    top, middle, least = (DampingAt(*values) for values in damping)
    frequency = float(at.frequency[3:].mean()) / (2 * np.pi)
    half = TWO_SIDED * float(at.frequency_sd[3:].mean()) / (2 * np.pi)
    begin, half_window = signal.provenance.start, 0.5 * float(fit.windows.widths[-1])
    return FirstWords(
        frequency,
        frequency - half,
        frequency + half,
        (top, middle, least),
        measured.cycles,
        begin + float(signal.t[0]),
        begin + min(last + half_window, float(signal.t[-1])),
        signal.unit,
    )
