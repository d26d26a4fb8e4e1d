"""Describe a record in one sentence: its frequency, and its damping at three amplitudes, without a damping law."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from bayesdamp import formatting as fmt
from bayesdamp.records.oscillation.features import features
from bayesdamp.records.oscillation.law_free import TWO_SIDED, law_free
from bayesdamp.types import Signal
from bayesdamp.units import Unit


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
