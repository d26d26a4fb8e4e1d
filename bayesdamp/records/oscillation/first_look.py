"""The first line on a record: its frequency, and its damping at three amplitudes, without any law."""

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
        """Write it as a sentence; ± stands before half a 95 % interval."""
        top, middle, least = self.damping
        half = (self.frequency_high - self.frequency_low) / 2
        near = half < self.frequency
        frequency = fmt.with_error(self.frequency, half) if near else f"about {self.frequency:.2g}"
        lead = (
            f"It oscillates at {frequency} Hz "
            f"for {self.cycles:.0f} cycles ({self.start:.4g} to {self.stop:.4g} s)"
        )
        at = [f"{_percent(d)} at {d.amplitude:.2g} {self.unit}" for d in self.damping]
        ratio = f"the equivalent viscous damping ratio (95 %) is {at[0]}, {at[1]} and {at[2]}"
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
    """Return frequency, equivalent viscous damping ratio and Q of a free decay, without any law.

    Raises Refusal where the record does not oscillate.

    >>> import bayesdamp as bd
    >>> signal = bd.simulate({"viscous": 0.05}, stiffness=20.0, duration=10.0, samples=400, noise_sd=0.003)
    >>> round(bd.first_words(signal).frequency, 2)  # Hz
    0.71
    """
    seen = features(signal)
    found = law_free(signal, seen)
    first, last = found.span
    at = found.at(np.array([first, found.halfway(), last]))
    damping = tuple(map(DampingAt, at.amplitude.tolist(), at.ratio.tolist(), at.ratio_sd.tolist()))
    along = found.at(found.windows.times)
    frequency = float(along.frequency.mean()) / (2 * np.pi)
    half = TWO_SIDED * float(along.frequency_sd.mean()) / (2 * np.pi)
    begin, half_window = signal.provenance.start, 0.5 * float(found.windows.widths[-1])
    return FirstWords(
        frequency,
        frequency - half,
        frequency + half,
        damping,  # type: ignore[arg-type]
        seen.cycles,
        begin + float(signal.t[0]),
        begin + min(last + half_window, float(signal.t[-1])),
        signal.unit,
    )


def _percent(d: DampingAt) -> str:
    """A damping ratio in per cent with half its 95 % interval."""
    return f"{fmt.with_error(100 * d.ratio, 100 * TWO_SIDED * d.stderr)} %"
