"""The free decay of a record with the noise of its readings: what an answer is made of."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from bayesdamp.envelope.model.candidates import Blocks
from bayesdamp.envelope.model.noise import Noise
from bayesdamp.envelope.records.one_law import NEPER
from bayesdamp.envelope.records.record import EnvelopeRecord
from bayesdamp.envelope.records.window import Window


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
