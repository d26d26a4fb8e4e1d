"""Damping and frequency against amplitude, from the record alone: no law of damping or restoring force is assumed.

The amplitudes and phases of sinusoids in short windows are smoothed. The amplitude, or a power of it, is a straight
line in time plus an integrated random walk, so that the rate of decay may wander (a cubic smoothing spline: G. Wahba,
1978); the walk's size is unknown and averaged over by its marginal likelihood. The frequency is the slope of
the phases, smoothed in the same way. A polynomial in the squared amplitude through it gives the energy of the
oscillation, and with it the equivalent viscous damping ratio.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.linalg import cho_factor, cho_solve
from scipy.special import stdtrit
from threadpoolctl import threadpool_limits

from bayesdamp.records.oscillation.features import Features
from bayesdamp.records.oscillation.sinusoids import PER_WINDOW, Sinusoids, sinusoids
from bayesdamp.types import Signal

POWERS = (-1.0, -0.5, 0.0, 0.5, 1.0)
"""Powers of the amplitude (0: its log) that may be a straight line in time: drag makes the first one, viscous damping
the middle one, dry friction the last (Box and Cox 1964)."""
WALKS = np.concatenate([[0.0], np.geomspace(1e-3, 1e8, 12)])
"""Variances of the random walk over the whole record, relative to those of the amplitudes' errors."""
KNOWN = 4.0
"""How many amplitudes the noise that was seen within the windows counts for, beside their scatter (conventional)."""
STEADY = 0.5
"""Prior probability that there is no walk; its sizes share the rest (conventional)."""
SYSTEMATIC = 5e-4
"""Relative error of every rate, from averaging over a window."""
TWO_SIDED = 1.96
"""Standard deviations of a 95 % interval."""
DEGREE = 5
"""Highest degree of the polynomial that times of amplitudes are found with, and frequencies compared with."""
ROUNDS = 2
"""How often amplitudes are corrected for what their windows average over."""
FLOORS = (0.0, 0.03, 0.1, 0.3, 1.0)
"""Constant errors that are tried, relative to the smallest amplitude."""
POINTS = 12
"""Points of a curve that is drawn."""
INDEPENDENT = 1.5
"""Windows' starts within one window over the number of independent estimates in it (of raised cosines)."""
_X, _W = np.polynomial.legendre.leggauss(16)


@dataclass(frozen=True)
class Curves:
    """At k places along a record: amplitude of the displacement (rad or m), equivalent viscous damping ratio, angular
    frequency (rad/s), and the standard errors of the last two, each of shape (k,)."""

    amplitude: np.ndarray
    ratio: np.ndarray
    ratio_sd: np.ndarray
    frequency: np.ndarray
    frequency_sd: np.ndarray


@dataclass(frozen=True)
class LawFree:
    """The smoothed amplitude and frequency of a record, from which `at` reads curves.

    windows: the fits that it rests on. sizes: log amplitudes of the displacement in the windows, (k,). backbone: the
    frequency's polynomial. line: a polynomial log amplitude, by the place −1 to 1 along the record.
    """

    windows: Sinusoids
    sizes: np.ndarray
    backbone: Backbone
    line: np.polynomial.Polynomial

    @property
    def span(self) -> tuple[float, float]:
        """First and last time that it reaches, in s."""
        return float(self.windows.times[0]), float(self.windows.times[-1])

    def times_of(self, amplitudes: np.ndarray) -> np.ndarray:
        """When the displacement has these amplitudes (rad or m), in s, within the span."""
        grid = np.linspace(-1, 1, 401)
        falling = np.minimum.accumulate(self.line(grid))
        return self._time(np.interp(-np.log(amplitudes), -falling, grid))

    def halfway(self) -> float:
        """When the log amplitude is halfway between its first and its last, in s."""
        first, last = np.exp(self.line(np.array([-1.0, 1.0])))
        return float(self.times_of(np.array([np.sqrt(first * last)]))[0])

    def at(self, times: np.ndarray) -> Curves:
        """Evaluate the curves at times in s, shape (k,)."""
        sizes, slope, sd = _smooth(self.windows, self.sizes, self._place(np.asarray(times, float)))
        half = 0.5 * (self.span[1] - self.span[0])
        amplitude = np.exp(sizes)
        energy, energy_sd = self.backbone.at(amplitude)[2:]
        frequency, frequency_sd = self._paces(np.asarray(times, float))
        rate = -slope / half * energy
        ratio = rate / np.hypot(rate, 1.0)
        ratio_sd = np.hypot(sd / half * energy, slope / half * energy_sd)
        return Curves(amplitude, ratio, ratio_sd, frequency, frequency_sd)

    def _paces(self, times: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return the angular frequency at times (k,) and its sd, rad/s: the slope of the smoothed phases."""
        windows, half = self.windows, 0.5 * (self.span[1] - self.span[0])
        with threadpool_limits(1, "blas"):
            fits = _smoothed(windows.places, windows.phases, windows.covariance, 0.0, self._place(times))
        mean, variance = _mixed(_weights(fits), [f.slopes for f in fits], [f.sds for f in fits])
        return mean / half, np.sqrt(variance) / half

    def _place(self, times: np.ndarray) -> np.ndarray:
        first, last = self.span
        return 2 * (times - first) / (last - first) - 1

    def _time(self, place: np.ndarray) -> np.ndarray:
        first, last = self.span
        return first + 0.5 * (place + 1) * (last - first)


def law_free(signal: Signal, seen: Features) -> LawFree:
    """Smooth a record's amplitude and frequency. Raises Refusal where it has too few cycles."""
    windows = _with_floor(sinusoids(signal, seen))
    order = {"angle": 0, "velocity": 1, "acceleration": 2}[signal.quantity]
    sizes, half = np.log(windows.amplitudes), 0.5 * float(windows.times[-1] - windows.times[0])
    line = _line(windows, sizes)
    backbone, phases = _backbone(windows, np.exp(line(windows.places))), windows.phases
    for _ in range(2 if order else 0):
        # A derivative multiplies x = exp(iωt − σt) by iω − σ: amplitude and phase of the displacement.
        x = windows.places
        pace, rate = backbone.at(np.exp(line(x)))[0], -line.deriv()(x) / half
        sizes = np.log(windows.amplitudes) - order * np.log(np.hypot(pace, rate))
        line = _line(windows, sizes)
        moved = replace(windows, phases=windows.phases - order * np.arctan2(rate, pace))
        backbone = _backbone(moved, np.exp(line(x)))
        phases = moved.phases
    seen_sizes, x = sizes, windows.places
    for _ in range(ROUNDS):
        sizes = seen_sizes - _taken(windows, _smooth(windows, sizes, x)[0])
    return LawFree(replace(windows, phases=phases), sizes, backbone, _line(windows, sizes))


def amplitude_curves(signal: Signal, seen: Features) -> Curves:
    """Evaluate the curves at up to `POINTS` times along a record, from the first on.

    Raises Refusal where it has too few cycles.
    """
    found = law_free(signal, seen)
    count = int(np.clip(found.sizes.size // PER_WINDOW + 1, 2, POINTS))
    return found.at(np.linspace(*found.span, count))


def _with_floor(windows: Sinusoids) -> Sinusoids:
    """Add the likeliest of several constant errors to those of the amplitudes.

    Noise that was filtered to the oscillation's own band does not show within a window, only between windows.
    """
    least, sizes = float(windows.amplitudes.min()), np.log(windows.amplitudes)
    found = [
        replace(windows, errors=np.hypot(windows.errors, share * least / windows.amplitudes))
        for share in FLOORS
    ]
    x = windows.places

    def likelihood(one: Sinusoids) -> float:
        return max(f.log for f in _smoothed(x, sizes, one.covariance, 0.0, x[:1]))

    with threadpool_limits(1, "blas"):
        return max(found, key=likelihood)


def _line(windows: Sinusoids, sizes: np.ndarray) -> np.polynomial.Polynomial:
    """Fit a polynomial to log amplitudes (k,)."""
    degree = min(DEGREE, max(sizes.size // PER_WINDOW, 1))
    return np.polynomial.Polynomial.fit(windows.places, sizes, degree, w=1 / windows.errors)


def _smooth(
    windows: Sinusoids, sizes: np.ndarray, at: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Smooth log amplitudes (k,): those at places `at` (m,), their slopes by the place, and the slopes' sds."""
    with threadpool_limits(1, "blas"):  # threads of a linear algebra library only wait for each other here
        fits = [f for p in POWERS for f in _smoothed(windows.places, sizes, windows.covariance, p, at)]
    weights = _weights(fits)
    slope, variance = _mixed(weights, [f.slopes for f in fits], [f.sds for f in fits])
    level = weights @ np.array([f.sizes for f in fits])
    return level, slope, np.sqrt(variance + (SYSTEMATIC * slope) ** 2)


def _mixed(
    weights: np.ndarray, values: Sequence[np.ndarray], sds: Sequence[np.ndarray]
) -> tuple[np.ndarray, np.ndarray]:
    """Return mean and variance, (k,), of a mixture of curves with these weights (m,), values and sds, (m, k)."""
    mean = weights @ np.array(values)
    return mean, weights @ (np.square(sds) + (np.array(values) - mean) ** 2)


def _weights(fits: Sequence[_Smoothed]) -> np.ndarray:
    """Return the probability of each curve, (k,)."""
    logs = np.array([f.log for f in fits])
    weights = np.exp(logs - logs.max())
    return weights / weights.sum()


def _taken(windows: Sinusoids, sizes: np.ndarray) -> np.ndarray:
    """Return the log of the amplitude that a window sees over the one in its middle, (k,), where log amplitudes `sizes`
    (k,) are on a smooth curve."""
    from scipy.interpolate import CubicSpline  # imports slowly

    line = CubicSpline(windows.places, sizes)
    u = np.linspace(-0.5, 0.5, 41)
    weight = np.cos(np.pi * u) ** 2
    x = windows.places
    width = 2 * windows.widths / (windows.times[-1] - windows.times[0])
    return np.log(np.exp(line(x[:, None] + u * width[:, None]) - line(x)[:, None]) @ (weight / weight.sum()))


@dataclass(frozen=True)
class Backbone:
    """Angular frequency as a polynomial in the squared amplitude: several degrees, each with a weight.

    largest: the amplitude that amplitudes are divided by. parts: weight, coefficients (m,), their covariance (m, m).
    """

    largest: float
    parts: tuple[tuple[float, np.ndarray, np.ndarray], ...]

    def at(self, amplitude: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """Evaluate at amplitudes (k,): frequency and its sd (rad/s); what turns a rate of decay (1/s) into a damping
        ratio, and its sd (s)."""
        a = amplitude / self.largest
        weights = np.array([w for w, _, _ in self.parts])
        paces, ratios = zip(*(self._one(c, a) for _, c, _ in self.parts), strict=True)
        pace_sds, ratio_sds = zip(*(self._spread(c, cov, a) for _, c, cov in self.parts), strict=True)
        pace, pace_variance = _mixed(weights, paces, pace_sds)
        ratio, ratio_variance = _mixed(weights, ratios, ratio_sds)
        return pace, np.sqrt(pace_variance), ratio, np.sqrt(ratio_variance)

    @staticmethod
    def _one(c: np.ndarray, a: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Frequency at relative amplitudes a (k,), and the ratio of a rate of decay: its energy's over 2ω.

        The action of a nearly sinusoidal oscillation is J = ωa²/2, and its energy E has dE/dJ = ω exactly.
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
        return omega, omega * a**2 * (2 + a * bend(a) / omega) / (4 * np.maximum(energy, 1e-300))

    def _spread(self, c: np.ndarray, covariance: np.ndarray, a: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Standard deviations of both, by one step along each principal axis of the coefficients' covariance."""
        values, axes = np.linalg.eigh(covariance)
        here = self._one(c, a)
        total = [np.zeros(a.size), np.zeros(a.size)]
        for size, axis in zip(np.sqrt(np.maximum(values, 0.0)).tolist(), axes.T, strict=True):
            for i, (moved, at) in enumerate(zip(self._one(c + size * axis, a), here, strict=True)):
                total[i] = total[i] + (moved - at) ** 2
        return np.sqrt(total[0]), np.sqrt(total[1])


def _backbone(windows: Sinusoids, amplitude: np.ndarray) -> Backbone:
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
        columns = np.column_stack(
            [np.ones(t.size), np.concatenate([np.zeros((1, count)), np.cumsum(steps, axis=0)])]
        )
        white = np.linalg.solve(root, columns)
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


def _smoothed(
    x: np.ndarray, logs: np.ndarray, errors: np.ndarray, power: float, at: np.ndarray
) -> list[_Smoothed]:
    """Smooth a power of the amplitude by a line and a random walk of each of the sizes.

    x: places of log amplitudes `logs`, both (n,), whose relative errors have the covariance `errors`, (n, n); at:
    places where the curve is wanted, (k,).
    """
    middle = logs.mean()
    base = np.exp(power * (logs - middle))
    values = logs - middle if power == 0 else (base - 1) / power
    noise = errors * np.outer(base, base)
    scale = float(np.exp(np.mean(np.log(np.diag(noise)))))
    columns = np.stack([np.ones_like(x), x], axis=1)
    there = np.stack([np.ones_like(at), at], axis=1)
    there_slope = np.stack([0 * at, np.ones_like(at)], axis=1)
    z, w = x + 1.0, np.maximum(at + 1.0, 0.0)  # distances from the start, where the walk begins
    less, more = np.minimum(z[:, None], z), np.maximum(z[:, None], z)
    walk = less**2 * (3 * more - less) / 6
    less, more = np.minimum(w[:, None], z), np.maximum(w[:, None], z)
    walk_at, walk_slope = less**2 * (3 * more - less) / 6, z * less - 0.5 * less**2
    free = x.size - 2
    wide = float(stdtrit(free * INDEPENDENT / PER_WINDOW + KNOWN, 0.975)) / TWO_SIDED
    seen = np.interp(at, x, base)
    found = []
    prior = np.log(np.where(WALKS == 0, STEADY, (1 - STEADY) / (WALKS.size - 1)))
    for ratio, log_prior in zip(WALKS.tolist(), prior.tolist(), strict=True):
        try:
            factor = cho_factor(noise / scale + ratio * walk, lower=True)
        except np.linalg.LinAlgError:
            continue  # a walk so large beside the errors leaves no digits of these
        weighted = cho_solve(factor, columns)
        inverse = np.linalg.inv(columns.T @ weighted)
        c = inverse @ (weighted.T @ values)
        off = cho_solve(factor, values - columns @ c)
        variance = (float((values - columns @ c) @ off) + KNOWN * scale) / (free + KNOWN)
        log = (
            log_prior
            - float(np.sum(np.log(np.diag(factor[0]))))
            + 0.5 * float(np.linalg.slogdet(inverse)[1])
            - 0.5 * (free + KNOWN) * np.log(variance)
            + float(np.sum(np.log(base)))  # densities are those of the log amplitudes
        )
        level = there @ c + ratio * walk_at @ off
        slope = there_slope @ c + ratio * walk_slope @ off
        by_walk = ratio * cho_solve(factor, walk_slope.T)
        line = there_slope - by_walk.T @ columns
        spread = ratio * (w - np.einsum("ij,ji->i", walk_slope, by_walk)) + np.einsum(
            "ij,jk,ik->i", line, inverse, line
        )
        # The curve may not leave the amplitudes.
        stretched = np.clip(1 + power * level, 0.8 * seen, 1.25 * seen)
        found.append(
            _Smoothed(
                log,
                middle + (level if power == 0 else np.log(stretched) / power),
                slope / stretched,
                wide * np.sqrt(variance * np.maximum(spread, 0.0)) / stretched,
            )
        )
    return found
