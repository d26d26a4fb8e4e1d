"""The free decay of a record with the noise of its readings: what an answer is made of."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from bayesdamp.inference.envelope.candidates import Blocks
from bayesdamp.inference.envelope.noise import Noise
from bayesdamp.records.envelope.decay import NEPER
from bayesdamp.records.envelope.record import EnvelopeRecord
from bayesdamp.records.envelope.window import Window


@dataclass(frozen=True, eq=False)
class Curve:
    """For pictures: times in s on the record's clock, levels in dB of the recorded power of the readings' means and of
    the best sum with its law's deviation, the sd of the latter, and the sd of a reading's scatter in dB, shape (n,)."""

    t: np.ndarray
    level: np.ndarray
    fit: np.ndarray
    fit_sd: np.ndarray
    scatter: np.ndarray


@dataclass(frozen=True, eq=False)
class Decay:
    """record: it is of; window: the free decay; first: its first reading; blocks: its readings; reference: ln of their
    reference amplitude in the record's unit; noises: each with the covariance of the blocks; inverse: of the triangle
    in which fits are sought."""

    record: EnvelopeRecord
    window: Window
    first: int
    blocks: Blocks
    reference: float
    noises: list[tuple[Noise, np.ndarray]]
    inverse: np.ndarray

    @property
    def omega(self) -> float | None:
        """rad/s."""
        return 2.0 * np.pi * self.record.frequency if self.record.frequency else None

    @property
    def readings(self) -> int:
        """In the decay."""
        return self.window.stop - self.first

    @property
    def fall(self) -> float:
        """dB."""
        top, bottom = self.blocks.ends
        return (top - bottom) * NEPER

    def amplitude(self, x: float) -> tuple[float, str]:
        """Return the amplitude at ln(A/A_ref) as the record has amplitudes, and its unit."""
        value, unit = self.record.amplitude((x + self.reference) * NEPER)
        return float(value), unit

    def curve(self, fit: np.ndarray, sd: np.ndarray) -> Curve:
        """Return the readings with ln(A/A_ref) of a sum and its sd, (n,) both."""
        b, t = self.blocks, self.record.t[self.first : self.window.stop]
        # The blocks' own clock starts at the first one's middle.
        start = float(t.min()) + 0.5 * (b.t[1] - b.t[0]) * (b.each > 1)
        level, fitted = ((one + self.reference) * NEPER for one in (b.x, fit))
        return Curve(b.t + start, level, fitted, sd * NEPER, np.sqrt(np.diag(self.noises[0][1])) * NEPER)

    def misfit(self, fit: np.ndarray) -> tuple[float, float]:
        """Return the root mean squares, relative to the amplitude and weighted by its square, of what a fit leaves
        beyond the noise, and of the noise."""
        weight = np.exp(2.0 * fit)
        weight = weight / weight.sum()
        off = self.blocks.x - fit
        off = off - weight @ off
        left, noise = float(weight @ off**2), float(weight @ np.diag(self.noises[0][1]))
        return float(np.sqrt(max(left - noise, 0.0))), float(np.sqrt(noise))
