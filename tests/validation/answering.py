"""Stands in for an answer: it knows the motion's ratio from a crude envelope, or fails on purpose."""

from __future__ import annotations

import numpy as np

from bayesdamp.types import Refusal, Signal
from bayesdamp.verdict.parts import DampingRatio, Grade
from bayesdamp.verdict.types import Verdict


def ratio_at(amplitude: float, value: float, half: float) -> DampingRatio:
    return DampingRatio(amplitude, "rad", value, 0.0, 0.0, value - half, value + half)


def by_envelope(signal: Signal, amplitudes: tuple[float, ...], deviation: str) -> Verdict:
    """The same ratio at all amplitudes, from the record's spread in its two halves; wide intervals."""
    y = signal.y - signal.y.mean()
    half = y.size // 2
    sign = np.sign(y)
    cycles = max(np.count_nonzero(sign[1:] != sign[:-1]) / 2, 1)
    fall = np.log(np.std(y[:half]) / np.std(y[half:])) / (np.pi * cycles)
    wide = 2.0 if deviation == "auto" else 1.0
    spans = tuple(ratio_at(a, fall, 0.4 * wide * fall) for a in amplitudes)
    return Verdict("a", Grade.APPROXIMATE, False, "viscous", 0.5, damping_ratio=spans)


def sometimes(signal: Signal, amplitudes: tuple[float, ...], deviation: str) -> Verdict:
    """Refuses dense records, fails on sparse ones."""
    if signal.t.size > 1500:
        raise Refusal("too many samples for this test")
    raise RuntimeError("a fault\nof two lines")
