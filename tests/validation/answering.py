"""Stands in for an answer: it knows the motion's ratio from a crude envelope, or fails on purpose."""

from __future__ import annotations

import numpy as np

from bayesdamp.types import Refusal, Signal
from tests.validation.test_scoring import At, Said


def by_envelope(signal: Signal, amplitudes: tuple[float, ...], deviation: str) -> Said:
    """The same ratio at all amplitudes, from the record's spread in its two halves; wide intervals."""
    y = signal.y - signal.y.mean()
    half = y.size // 2
    sign = np.sign(y)
    cycles = max(np.count_nonzero(sign[1:] != sign[:-1]) / 2, 1)
    fall = np.log(np.std(y[:half]) / np.std(y[half:])) / (np.pi * cycles)
    wide = 2.0 if deviation == "auto" else 1.0
    spans = tuple(At(a, fall, fall * (1 - 0.4 * wide), fall * (1 + 0.4 * wide)) for a in amplitudes)
    return Said(False, "viscous", 0.5, "approximate", spans)


def sometimes(signal: Signal, amplitudes: tuple[float, ...], deviation: str) -> Said:
    """Refuses dense records, fails on sparse ones."""
    if signal.t.size > 1500:
        raise Refusal("too many samples for this test")
    raise RuntimeError("a fault\nof two lines")
