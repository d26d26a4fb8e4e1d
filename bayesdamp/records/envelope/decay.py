"""A decay above a noise floor: a power of the amplitude fitted to levels, and the floor measured behind it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.optimize import least_squares

from bayesdamp.physics.amplitude import EXPONENTS, power_decay, power_slopes

NEPER = 20.0 / np.log(10.0)
"""dB."""
FITTED = 80
"""Blocks that a decay and its floor are fitted to."""
LEAST_DROP = 3.0
"""dB that a decay has to fall for its rate to be determined; a half-life is 6."""
LEAST_POINTS = 6
WORSE = 2.0
"""Multiple of the usual misfit of a short line at which it is not part of the decay."""
GUARD = 0.02
"""Share of the decay's duration left out after the release where a drive precedes it."""
CHECKED = 0.05
"""Share of a decay, at its start, that a law must fit by itself."""
WON = 0.15
"""Share of a decay's duration, or of its fall in dB, by which it must be longer to begin where a power law begins
rather than where a straight line does."""
SMALLEST = 0.15
"""dB below which a deviation is not significant: detectors are not linear to better."""
ABOVE_FLOOR = 10.0
"""dB above the mean power of the floor where a decay ends: there a Gaussian in the logarithm still describes what the
floor does to it, and its mean is right to 1e-5 (the logarithm of a circular Gaussian's power plus a constant's)."""
LAG = 0.1
"""Decay times (1/rate) between readings of a floor that are compared: thermal motion of the mode itself, which is
correlated over its decay time, hardly moves in that time, noise of a detector does."""
PARTS = 8
"""Stretches that each give the floor's swing, for its standard error."""
LEAST = 24
"""Readings below which a floor's swing is not known."""
KNOWN = 0.3
"""Relative sd of a floor's constant part near the decay, measured behind it."""


@dataclass(frozen=True)
class SeenFloor:
    """A floor in units of the reading's power.

    power: its mean; decay: mean power of the remaining decay in the readings that it was measured from; swing: half of
    the mean square difference of readings a LAG apart (power squared), nan where there are too few readings; error:
    relative standard error of swing over power squared.
    """

    power: float
    decay: float = 0.0
    swing: float = float("nan")
    error: float = float("nan")

    def scaled(self, factor: float) -> SeenFloor:
        """Return the floor in another unit of power."""
        return SeenFloor(self.power * factor, self.decay * factor, self.swing * factor**2, self.error)

    def parts(self, slow: float) -> tuple[float, float, float, float]:
        """Separate the fluctuating and the constant power of the floor.

        Of a circular Gaussian of power F and autocorrelation R, added to an amplitude of power D, half of the mean
        square difference of powers is F²(1 - R²) + 2FD(1 - R). The rest of the mean is constant; the weight is that of
        a uniform prior for the constant's share.

        Parameters
        ----------
        slow
            Share of the fluctuations that is slow.

        Returns
        -------
        tuple[float, float, float, float]
            Fluctuating power, constant power, its sd, log weight.
        """
        if not np.isfinite(self.swing):
            return self.power, 0.0, 0.0, 0.0
        correlation = slow * np.exp(-LAG)
        a, b = 1.0 - correlation**2, (1.0 - correlation) * self.decay
        fluctuating = (np.sqrt(b * b + a * self.swing) - b) / a
        if fluctuating <= self.power:
            constant = self.power - fluctuating
            sd = float(np.hypot(KNOWN * constant, 0.5 * self.error * fluctuating))
            return float(fluctuating), float(constant), sd, float(np.log(fluctuating / self.power))
        most = a * self.power**2 + 2.0 * b * self.power
        off = np.log(self.swing / most) / self.error
        return self.power, 0.0, 0.0, float(-0.5 * off**2)


def measure_floor(t: np.ndarray, power: np.ndarray, decay: np.ndarray, rate: float) -> SeenFloor:
    """Return the floor in the readings behind a decay.

    Parameters
    ----------
    t
        Times in s, shape (n,).
    power, decay
        Power of the readings, and of the decay itself at these times, shape (n,).
    rate
        Mean -d ln A/dt of the decay in 1/s.
    """
    rest = float(decay.mean())
    mean = max(float(power.mean()) - rest, 0.1 * float(power.mean()))
    span = rate * float(t[-1] - t[0])
    lag = max(1, round(LAG * (t.size - 1) / span)) if span > 0 else t.size
    if t.size < LEAST + lag:
        return SeenFloor(mean)
    squares = 0.5 * (power[lag:] - power[:-lag]) ** 2
    swing = float(squares.mean())
    if not swing > 0:
        return SeenFloor(mean)
    # Of the swing in units of the power squared, both of which a few slow values of the floor may change.
    error = np.hypot(_relative_error(squares), 2.0 * _relative_error(power))
    return SeenFloor(mean, rest, swing, float(error))


def _relative_error(values: np.ndarray) -> float:
    """Return the relative standard error of the mean of correlated values, from those of PARTS stretches."""
    means = np.array([part.mean() for part in np.array_split(values, PARTS)])
    return float(means.std(ddof=1)) / np.sqrt(PARTS) / float(means.mean())


def blocks(t: np.ndarray, y: np.ndarray, most: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return means of times and values over at most so many runs of samples, and the runs' bounds (blocks + 1,)."""
    count = min(most, t.size)
    edges = np.linspace(0, t.size, count + 1).round().astype(int)
    size = np.diff(edges)
    return np.add.reduceat(t, edges[:-1]) / size, np.add.reduceat(y, edges[:-1]) / size, edges


def fall(y: np.ndarray, begin: int, end: int) -> float:
    """Return the fall in dB from the first twentieth to the last."""
    if end - begin < 2:
        return 0.0
    part = max(1, (end - begin) // 20)
    return float(y[begin : begin + part].mean() - y[end - part : end].mean())


@dataclass(frozen=True, eq=False)
class Levels:
    """Levels over time, and their means over blocks of samples.

    t: in s, y: in dB of power, (n,); tb, yb: their means, (blocks,); edges: bounds of the blocks, (blocks + 1,).
    """

    t: np.ndarray
    y: np.ndarray
    tb: np.ndarray
    yb: np.ndarray
    edges: np.ndarray


@dataclass(frozen=True, eq=False)
class DecayFit:
    """A power of the amplitude and a floor, fitted from a block on.

    x: ln of the amplitude at the blocks; floor: its power; floor_at: the block from which the floor is visible;
    stop: the reading up to which both were fitted; scale: the level in dB that these are relative to.
    """

    x: np.ndarray
    floor: float
    floor_at: int
    stop: int
    scale: float


def power_law_start(levels: Levels, begin: int, end: int) -> int:
    """Return the block from which one power of the amplitude, and a floor, describe the level up to a block.

    Straight lines follow a decay back only as long as it is straight in dB: dry friction bends it, and drag. The search
    halves the blocks before the one that straight lines gave (begin), which is kept where little is gained.
    """
    y = levels.yb
    low, first = -1, begin
    while first - low > 1:
        middle = (low + first) // 2
        if power_law_holds(levels, middle):
            first = middle
        else:
            low = middle
    span, whole = max(end - first, 1), fall(y, first, end)
    won = whole - fall(y, begin, end)
    if won < LEAST_DROP or (begin - first < WON * span and won < WON * whole):
        return begin
    return first + (max(1, round(GUARD * span)) if first > 0 else 0)


def power_law_holds(levels: Levels, at: int) -> bool:
    """Return whether one power of the amplitude, and a floor, describe the level from a block on.

    They must also describe it right behind that block by itself.
    """
    fit = fit_power_law(levels, at)
    x = fit.x[: max(fit.floor_at - at, LEAST_POINTS)]
    off = levels.yb[at : at + x.size] - fit.scale - 10.0 * np.log10(np.exp(2.0 * x) + fit.floor)
    z = off / np.hypot(SMALLEST, NEPER * np.sqrt(0.5 * fit.floor) * np.exp(-x))
    first = z[: max(LEAST_POINTS, round(CHECKED * z.size))]
    return bool(max(np.mean(z**2), np.mean(first**2)) <= WORSE**2)


def fit_power_law(levels: Levels, begin: int) -> DecayFit:
    """Fit a power of the amplitude and a floor from a block on."""
    t, y = levels.t, levels.y
    start, stop = int(levels.edges[begin]), y.size
    scale = float(y[start:].max())
    x, floor_at, floor, p = np.zeros(0), levels.tb.size, 0.0, None
    for _ in range(2):
        tc, power, _ = blocks(t[start:stop], 10.0 ** ((y[start:stop] - scale) / 10.0), FITTED)
        p = _fit_decay_and_floor(tc - t[start], power, p)
        times = levels.tb[begin:] - t[start]
        x = power_decay(times, p[0], p[1] - (p[2] - 1.0) * p[0], p[2])
        floor = float(np.exp(p[3]))
        reached = np.flatnonzero(np.exp(2.0 * x) < floor)
        if not reached.size:
            break
        # What the floor does long after is not what it does to the decay.
        floor_at = begin + int(reached[0])
        stop = int(np.searchsorted(t, t[start] + 2.0 * float(times[reached[0]])))
        stop = min(max(stop, start + LEAST_POINTS), y.size)
        if stop >= y.size:
            break
    return DecayFit(x, floor, floor_at, stop, scale)


def _fit_decay_and_floor(t: np.ndarray, power: np.ndarray, begin: np.ndarray | None) -> np.ndarray:
    """Fit powers (n,) at times t (s); return ln of the first amplitude and rate, the exponent, and ln of the floor.

    begin: the values to start from; None for three exponents.
    """
    level = 5.0 * np.log(power)
    tail = float(np.median(power[-max(2, power.size // 8) :]))
    x0 = 0.5 * float(np.log(power[:3].mean()))
    fallen = np.flatnonzero(0.5 * np.log(power) < 0.5 * (x0 + 0.5 * np.log(tail)))
    half = float(t[fallen[0]]) if fallen.size and fallen[0] > 0 else float(t[-1])
    depth = max(0.5 * (x0 - 0.5 * np.log(tail)), 0.05)
    # A tolerance of 0.3 dB, and of what a floor of random phase does to a level.
    width = np.hypot(0.3, 5.0 * np.sqrt(0.5 * tail / np.maximum(power, tail)))

    def signal(p: np.ndarray) -> np.ndarray:
        return np.exp(2.0 * power_decay(t, p[0], p[1] - (p[2] - 1.0) * p[0], p[2]))

    def residuals(p: np.ndarray) -> np.ndarray:
        return (5.0 * np.log(signal(p) + np.exp(p[3])) - level) / width

    def jacobian(p: np.ndarray) -> np.ndarray:
        decay, floor = signal(p), np.exp(p[3])
        columns = np.column_stack([2.0 * decay[:, None] * power_slopes(t, p), np.full(t.size, floor)])
        return columns * (5.0 / ((decay + floor) * width))[:, None]

    low, high = [-30.0, -60.0, EXPONENTS[0], -80.0], [10.0, 60.0, EXPONENTS[1], 1.0]
    starts = [] if begin is None else [begin]
    for exponent in (1.0, 0.2, 1.8) if begin is None else ():
        # The rate at the start with which this law falls by `depth` in the time `half`.
        q = exponent - 1.0
        rate = depth if q == 0.0 else np.expm1(q * depth) / q
        starts.append(np.array([x0, np.log(rate / max(half, 1e-300)), exponent, np.log(tail)]))
    fits = [
        least_squares(
            residuals,
            np.clip(p, low, high),
            jacobian,  # type: ignore[arg-type]
            bounds=(low, high),
            loss="soft_l1",
            max_nfev=25,
            x_scale=[1.0, 1.0, 0.3, 1.0],
        )
        for p in starts
    ]
    return min(fits, key=lambda fit: fit.cost).x
