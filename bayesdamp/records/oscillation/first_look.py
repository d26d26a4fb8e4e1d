"""First words on a record, at once: its frequency, and its damping at three amplitudes, of which no law is assumed."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from bayesdamp.records.oscillation.features import Features, features
from bayesdamp.types import Refusal, Signal
from bayesdamp.units import Unit

POINTS = 240
"""Amplitudes that the curve is fitted to at most; of more, neighbours are averaged."""
POWERS = (-1.0, -0.5, 0.0, 0.5, 1.0)
"""Powers of the amplitude (0: its log) that a curve in time is tried for: drag makes the first a straight line, viscous
damping the middle one, dry friction the last (Box and Cox 1964)."""
DEGREES = (1, 2, 3, 4, 5)
"""Degrees of these curves; three points at least for each coefficient."""
AVERAGED = 2e-3
"""Relative error of a slope of amplitudes that are averages over a swing."""
HUBER = 1.5
"""Standard deviations from which an amplitude counts less."""
MOST_DECIMALS = 9
"""Decimal places of a frequency in Hz beyond which it is written with an exponent."""
TWO_SIDED = 1.96
"""Standard deviations of a 95 % interval."""


@dataclass(frozen=True)
class DampingAt:
    """The equivalent viscous damping ratio at an amplitude (rad or m), with its standard error.

    It is the energy lost in a cycle over 4π times the energy of the oscillation at that amplitude; of a linear
    spring, −(dA/dt)/(ωA).
    """

    amplitude: float
    ratio: float
    stderr: float

    @property
    def quality(self) -> float:
        """The quality factor, 1/(2 ratio)."""
        return 0.5 / self.ratio if self.ratio else float("inf")


@dataclass(frozen=True)
class FirstWords:
    """What a record says before any model is fitted.

    frequency, frequency_low, frequency_high: in Hz, mean of the piece used, and its 95 % interval, nan where there are
    too few crossings for one.
    damping: at the largest amplitude of the piece, the geometric middle, and the smallest that is clear of the noise.
    cycles: that stand out of the noise. start, stop: in s, of the record's own times, of the piece used.
    unit: "rad" or "m", of the amplitudes.
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
        """The quality factor at the middle amplitude."""
        return self.damping[1].quality

    def in_unit(self, unit: Unit) -> FirstWords:
        """The same with amplitudes in a record's own unit of displacement."""
        own = unit.displacement
        if own.base != self.unit:
            return self
        top, middle, least = (replace(d, amplitude=d.amplitude * own.scale) for d in self.damping)
        return replace(self, damping=(top, middle, least), unit=own.name)

    def sentence(self) -> str:
        """All of it in words."""
        top, middle, least = self.damping
        half = (self.frequency_high - self.frequency_low) / 2
        lead = (
            f"It oscillates at {_hertz(self.frequency, half)} "
            f"for {self.cycles:.0f} cycles ({self.start:.4g} to {self.stop:.4g} s)"
        )
        at = [f"{_percent(d)} at {d.amplitude:.2g} {self.unit}" for d in self.damping]
        ratio = f"the equivalent viscous damping ratio is {at[0]}, {at[1]} and {at[2]}"
        pairs = [(a.ratio - b.ratio, np.hypot(a.stderr, b.stderr)) for a, b in ((top, middle), (top, least))]
        spread, error = max(pairs, key=lambda pair: abs(pair[0]) / pair[1])
        if abs(spread) <= max(3 * error, 0.1 * middle.ratio):
            change = "it does not clearly change with the amplitude, as viscous damping would not"
        elif spread > 0:
            change = "it grows with the amplitude, as drag would have it"
        else:
            change = "it grows as the amplitude falls, as dry friction would have it"
        return f"{lead}; {ratio}{_quality(self.quality)}; {change}."


def first_words(signal: Signal) -> FirstWords:
    """Frequency, equivalent viscous damping ratio and Q of a record of free decay, without any law.

    A smooth curve is fitted to the log of the distances of turning points from the midline, robustly; its slope gives
    the damping, and the scatter about it, or the noise if that is larger, the errors. Raises Refusal where the record
    does not oscillate.

    >>> import bayesdamp as bd
    >>> signal = bd.simulate({"viscous": 0.05}, stiffness=20.0, duration=10.0, samples=400, noise_sd=0.003)
    >>> round(bd.first_words(signal).frequency, 2)  # Hz
    0.71
    """
    seen = features(signal)
    if seen.turning_times.size < 3:
        raise Refusal("there are fewer than three turning points to read damping and frequency from")
    order = {"angle": 0, "velocity": 1, "acceleration": 2}[signal.quantity]
    omega = 2 * np.pi / seen.period
    times, sizes, sds, shared = _amplitudes(seen, signal.step)
    at, logs, slopes, errors = _slopes(times, sizes, sds)
    # Of a linear spring: the decay rate over the undamped frequency.
    damping = tuple(
        DampingAt(float(np.exp(v)) / omega**order, float(-s / np.hypot(s, omega)), float(e * shared) / omega)
        for v, s, e in zip(logs, slopes, errors)
    )
    frequency, half = _frequency(seen)
    begin = signal.provenance.start
    return FirstWords(
        frequency,
        frequency - half,
        frequency + half,
        damping,  # type: ignore[arg-type]
        seen.cycles,
        begin + float(signal.t[0]),
        begin + float(at[-1]),
        signal.unit,
    )


def _amplitudes(seen: Features, step: float) -> tuple[np.ndarray, np.ndarray, np.ndarray, float]:
    """(times in s, amplitudes, relative errors, each (k,), by how much errors exceed those of independent amplitudes).

    Half the range of a swing needs no midline; it belongs to the middle of the swing. Neighbours share a turning point.
    """
    times, sizes = seen.swing_times, seen.swing_sizes
    sds = np.maximum(np.hypot(0.5 * seen.roughness, 0.29 * step) / sizes, 1e-9)
    several = -(-times.size // POINTS)
    if several > 1:
        starts = np.arange(0, times.size - several + 1, several)
        times, sizes, sds = (np.add.reduceat(v, starts)[:-1] / several for v in (times, sizes, sds))
    return times, sizes, sds, float(np.sqrt(1 + 1 / several))


def _slopes(
    times: np.ndarray, sizes: np.ndarray, sds: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """(times, log amplitudes, slopes, errors of these) at the largest, the middle and the smallest amplitude, (3,).

    The mean over curves of several powers and degrees, weighted by the Bayesian information criterion; what they differ
    by is part of the error.
    """
    middle, width = 0.5 * (times[0] + times[-1]), 0.5 * float(times[-1] - times[0])
    x = (times - middle) / max(width, 1e-300)
    logs = np.log(sizes)
    line = np.polynomial.Polynomial.fit(x, logs, min(3, x.size - 1))
    grid = np.linspace(-1, 1, 401)
    half = 0.5 * (line(-1.0) + line(1.0))
    ends = np.array([-1.0, float(grid[np.argmin(np.abs(line(grid) - half))]), 1.0])
    fits = []
    for power in POWERS:
        for degree in DEGREES:
            if degree == 1 or 3 * (degree + 1) <= x.size:
                fits.append(_curve(x, logs, sds, power, degree, ends))
    criterion = np.array([fit[0] for fit in fits])
    weights = np.exp(-0.5 * (criterion - criterion.min()))
    weights /= weights.sum()
    values, slopes, errors = (np.array([fit[i] for fit in fits]) for i in (1, 2, 3))
    mean = weights @ slopes
    spread = np.sqrt(weights @ (errors**2 + (slopes - mean) ** 2) + (AVERAGED * mean) ** 2)
    return middle + width * ends, weights @ values, mean / width, spread / width


def _curve(
    x: np.ndarray, logs: np.ndarray, sds: np.ndarray, power: float, degree: int, ends: np.ndarray
) -> tuple[float, np.ndarray, np.ndarray, np.ndarray]:
    """(information criterion, log amplitudes, slopes of these, errors of the slopes) of one curve at `ends` (3,)."""
    base = np.exp(power * (logs - logs.mean()))
    values = logs - logs.mean() if power == 0 else (base - 1) / power
    columns = np.polynomial.chebyshev.chebvander(x, degree)
    weights = 1 / (sds * base)
    root, scale, off = weights, 1.0, np.zeros(x.size)
    inverse, c = np.zeros(columns.T.shape), np.zeros(degree + 1)
    for _ in range(6):
        inverse = np.linalg.pinv(columns * root[:, None]) * root
        c = inverse @ values
        off = np.abs(values - columns @ c) * weights
        scale = max(1.4826 * float(np.median(off)), 1e-12)
        if off.max() <= HUBER * scale:
            break
        root = weights * np.sqrt(np.minimum(1.0, HUBER * scale / np.maximum(off, 1e-300)))
    free = max(x.size - degree - 1, 1)
    loss = np.where(off <= HUBER * scale, off**2, HUBER * scale * (2 * off - HUBER * scale))
    variance = max(float(np.sum(loss)) / free, 1e-18)
    # Relative errors are compared: the transformation stretches the residuals by the power.
    criterion = x.size * np.log(variance * free / x.size) + (degree + 1) * np.log(x.size)
    there = np.polynomial.chebyshev.chebvander(ends, degree) @ c
    rates = np.stack(
        [
            np.polynomial.chebyshev.chebval(ends, np.polynomial.chebyshev.chebder(e))
            for e in np.eye(degree + 1)
        ],
        axis=1,
    )
    seen = np.interp(ends, x, base)
    stretched = np.clip(1 + power * there, 0.8 * seen, 1.25 * seen)  # the curve may not leave the amplitudes
    level = there if power == 0 else np.log(stretched) / power
    covariance = (inverse * (variance / weights**2)) @ inverse.T
    errors = np.sqrt(np.einsum("ij,jk,ik->i", rates, covariance, rates)) / stretched
    return criterion, level + logs.mean(), rates @ c / stretched, errors


def _frequency(seen: Features) -> tuple[float, float]:
    """(mean frequency in Hz, half of its 95 % interval) from the crossings of the midline."""
    crossings, k = seen.crossing_times, np.arange(seen.crossing_times.size, dtype=float)
    if k.size < 3:
        return 1 / seen.period, float("nan")
    columns = np.stack([np.ones_like(k), k / 2, (-1.0) ** k], axis=1)[:, : 3 if k.size >= 4 else 2]
    root = np.abs(np.diff(seen.turning_values))
    root = root / root.max()
    inverse = np.linalg.pinv(columns * root[:, None]) * root
    c = inverse @ crossings
    free = max(k.size - columns.shape[1], 1)
    error = float(np.sqrt(np.sum((inverse[1] * (crossings - columns @ c)) ** 2) * k.size / free))
    return 1 / float(c[1]), TWO_SIDED * error / float(c[1]) ** 2


def _hertz(frequency: float, half: float) -> str:
    """A frequency in Hz, as many digits as half its interval allows; about what it is where that has no end."""
    if not half < frequency:
        return f"about {frequency:.2g} Hz"
    half = max(half, 1e-9 * frequency)
    decimals = max(1 - int(np.floor(np.log10(half))), 0)
    if decimals > MOST_DECIMALS:
        digits = decimals + 1 + int(np.floor(np.log10(frequency)))
        return f"{frequency:.{digits}g} ± {half:.2g} Hz"
    return f"{frequency:.{decimals}f} ± {half:.{decimals}f} Hz"


def _percent(d: DampingAt) -> str:
    """A damping ratio in per cent, as many digits as its error allows."""
    error = 100 * d.stderr
    decimals = int(np.clip(1 - np.floor(np.log10(max(error, 1e-9))), 0, 6)) if error else 3
    return f"{100 * d.ratio:.{decimals}f} ± {error:.{decimals}f} %"


def _quality(q: float) -> str:
    """Q in brackets, where there is one."""
    return f" (Q about {float(f'{q:.2g}'):g})" if np.isfinite(q) and q > 0 else ""
