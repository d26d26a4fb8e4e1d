"""What the readings behind a decay tell of the noise floor."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

ABOVE_FLOOR = 10.0
"""dB above the mean power of the floor where a decay ends: there a Gaussian in the logarithm still describes what the
floor does to it, and its mean is right to 1e-5 (the logarithm of a circular Gaussian's power plus a constant's)."""
LAG = 0.1
"""Decay times (1/rate) over which readings of a floor are held against each other: thermal motion of the mode itself,
which is correlated over its decay time, hardly moves in that, noise of a detector does."""
PARTS = 8
"""Stretches of which each tells the swing, for its own standard error."""
LEAST = 24
"""Readings below which a floor's swing is not known."""
KNOWN = 0.3
"""Relative sd of a floor's constant part near the decay, seen behind it."""


@dataclass(frozen=True)
class SeenFloor:
    """A floor in units of the reading's power.

    power: its mean; decay: mean power of the decay's own rest among the readings that it was taken from; swing: half of
    the mean square difference of readings a LAG apart (power squared), nan where too few readings tell it; error:
    relative standard error of swing over power squared.
    """

    power: float
    decay: float = 0.0
    swing: float = float("nan")
    error: float = float("nan")

    def scaled(self, factor: float) -> SeenFloor:
        """In another unit of power."""
        return SeenFloor(self.power * factor, self.decay * factor, self.swing * factor**2, self.error)

    def parts(self, slow: float) -> tuple[float, float, float, float]:
        """(fluctuating power, constant power, its sd, log weight) if so much of what fluctuates is slow.

        Of a circular Gaussian of power F and autocorrelation R beside an amplitude of power D, half of the mean square
        difference of powers is F²(1 - R²) + 2FD(1 - R). What it leaves of the mean is constant; the weight is that of
        a uniform prior for the constant's share.
        """
        if not np.isfinite(self.swing):
            return self.power, 0.0, 0.0, 0.0
        held = slow * np.exp(-LAG)
        a, b = 1.0 - held**2, (1.0 - held) * self.decay
        fluctuating = (np.sqrt(b * b + a * self.swing) - b) / a
        if fluctuating <= self.power:
            constant = self.power - fluctuating
            sd = float(np.hypot(KNOWN * constant, 0.5 * self.error * fluctuating))
            return float(fluctuating), float(constant), sd, float(np.log(fluctuating / self.power))
        most = a * self.power**2 + 2.0 * b * self.power
        off = np.log(self.swing / most) / self.error
        return self.power, 0.0, 0.0, float(-0.5 * off**2)


def seen_floor(t: np.ndarray, power: np.ndarray, decay: np.ndarray, rate: float) -> SeenFloor:
    """The floor in readings' powers behind a decay at times t (s), shape (n,); decay: power of the decay itself there;
    rate: mean -d ln A/dt of the decay in 1/s."""
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
    # Of the swing in units of the power squared, both of which a few slow values of the floor may put off.
    error = np.hypot(_error(squares), 2.0 * _error(power))
    return SeenFloor(mean, rest, swing, float(error))


def _error(values: np.ndarray) -> float:
    """Relative standard error of the mean of correlated values, from those of PARTS stretches."""
    each = np.array([one.mean() for one in np.array_split(values, PARTS)])
    return float(each.std(ddof=1)) / np.sqrt(PARTS) / float(each.mean())
