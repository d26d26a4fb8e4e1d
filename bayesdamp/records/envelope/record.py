"""An envelope as it was recorded, its readings as levels, and their scale in units of a motion."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from bayesdamp.physics.amplitude.loss import Scale, scales_needed
from bayesdamp.physics.damping import TERMS
from bayesdamp.types import InputError
from bayesdamp.units import UNITS

DECIBELS = ("dB", "dBm", "dBV", "dBu", "dBmV", "dBuV", "dBW", "dBA", "dBFS", "dBc")
POWER = ("W", "mW", "uW", "nW", "pW", "V^2", "V2", "m^2", "m2")
"""Units in which a reading is a power: proportional to the square of the amplitude."""
STRONG = 0.2
"""Share of the largest reading beyond which a reading below zero is not that of a floor."""
LOUDEST = 1000.0
"""dB beyond which, to either side, a reading is not a level: 50 decades of the amplitude. Of other readings, those that
are so far below the largest are zeros."""


@dataclass(frozen=True, eq=False)
class EnvelopeRecord:
    """A record of an envelope, equal only to itself.

    Parameters
    ----------
    name
        Of the file.
    t
        Times in s, shape (n,), increasing.
    level
        20 log10 of the amplitude (10 log10 of the power) in dB of `unit`, shape (n,).
    unit
        As recorded.
    frequency
        Of the oscillation in Hz, or None.
    facts
        What the file's header states.
    notes
        Sentences on how it was read.
    """

    name: str
    t: np.ndarray
    level: np.ndarray
    unit: str
    frequency: float | None = None
    facts: Mapping[str, str] = field(default_factory=dict)
    notes: tuple[str, ...] = ()

    @property
    def logarithmic(self) -> bool:
        """Whether it was recorded in dB, so that the amplitude has no scale of its own."""
        return self.unit in DECIBELS

    def amplitude(self, level: float) -> tuple[float, str]:
        """Return a level (dB) as it was recorded, with its unit."""
        if self.logarithmic:
            return level, self.unit
        return 10.0 ** (level / (10.0 if self.unit in POWER else 20.0)), self.unit


def unit_in(name: str) -> str | None:
    """Return the unit of an envelope in a column's name, of DECIBELS or POWER; None where it has none, or several."""
    words = re.findall(r"[A-Za-z]+(?:\^?2)?", name)
    known = {unit.lower(): unit for unit in (*DECIBELS, *POWER) if len(unit) > 1}
    units = {known[word.lower()] for word in words if word.lower() in known}
    units |= {"W"} if re.search(r"[\[(/]\s*W\s*[\])]?$", name) else set()
    return units.pop() if len(units) == 1 else None


def made_record(
    name: str,
    t: np.ndarray,
    y: np.ndarray,
    unit: str,
    frequency: float | None = None,
    facts: Mapping[str, str] | None = None,
    notes: tuple[str, ...] = (),
) -> EnvelopeRecord:
    """Return the record of readings.

    Parameters
    ----------
    name
        Of the file.
    t, y
        Times in s and readings in `unit`, shape (n,).
    unit
        Of DECIBELS for levels, of POWER for powers, any other for amplitudes.
    frequency
        Of the oscillation in Hz.
    facts, notes
        As in `EnvelopeRecord`.

    Raises
    ------
    InputError
        Where times go back, or the readings are not those of an envelope.
    """
    if frequency is not None and not (np.isfinite(frequency) and frequency > 0):
        raise InputError(f"{name}: frequency must be positive, in Hz, not {frequency:g}")
    steps = np.diff(t)
    if np.any(steps < 0):
        bad = int(np.flatnonzero(steps < 0)[0]) + 1
        raise InputError(f"{name}: time goes back at reading {bad + 1} ({t[bad]:g} s); times must increase")
    keep = np.concatenate([[True], steps > 0])
    remarks = list(notes)
    if not keep.all():
        remarks.append(f"{int((~keep).sum())} readings at the time of the previous one are left out.")
    if unit in DECIBELS:
        level = y.astype(float)
        far = level[np.argmax(np.abs(level))] if level.size else 0.0
        if abs(far) > LOUDEST:
            raise InputError(
                f"{name}: a level of {far:g} {unit} is beyond any instrument's; is it the right column, and in {unit}?"
            )
    else:
        size = np.abs(y)
        size[size < 10.0 ** (-LOUDEST / 20.0) * size.max(initial=0.0)] = 0.0
        if np.any(y < -STRONG * size.max()):
            raise InputError(
                f"{name}: readings swing to both sides ({y.min():g} to {y.max():g}), which no amplitude does; "
                "give --unit dB for levels, or leave out --quantity envelope for an oscillation"
            )
        if np.any(y < 0):
            remarks.append(
                f"The absolute value is used of {int((y < 0).sum())} readings below zero, of a floor."
            )
        if np.any(size == 0):
            remarks.append(f"{int((size == 0).sum())} readings that are zero are left out.")
        keep &= size != 0
        level = (10.0 if unit in POWER else 20.0) * np.log10(np.where(size != 0, size, 1.0))
    t, level = t[keep].astype(float), level[keep]
    return EnvelopeRecord(name, t, level, unit, frequency, dict(facts or {}), tuple(remarks))


def scale_of(record: EnvelopeRecord, sums: Sequence[tuple[str, ...]], log_amplitude: float) -> Scale:
    """Return the amplitude in rad or m and the frequency in rad/s that the parameters of damping terms are relative to.

    Parameters
    ----------
    record
        In whose unit the amplitude is.
    sums
        Damping terms by name.
    log_amplitude
        ln of the amplitude at the start.

    Returns
    -------
    Scale
        With 1 for what no term needs.

    Raises
    ------
    InputError
        Where a term needs the amplitude or the frequency and it is not known.
    """
    amplitude = frequency = 1.0
    for name in dict.fromkeys(term for terms in sums for term in terms):
        by_amplitude, by_frequency = scales_needed(TERMS.get(name))
        if by_amplitude:
            unit = record.unit.replace("^2", "").removesuffix("2") if record.unit in POWER else record.unit
            known = UNITS.get(unit)
            if known is None or not known.physical or known.quantity is not None:
                raise InputError(
                    f"{record.name}: damping term {name!r} has a size of its own, in rad or m, and amplitudes are in "
                    f"{record.unit}; give them as a motion's with --unit (mm, deg, ...), or leave the term out"
                )
            amplitude = float(np.exp(log_amplitude)) * known.factor
        if by_frequency:
            if record.frequency is None:
                raise InputError(
                    f"{record.name}: damping term {name!r} has a time of its own, and the frequency is not known; "
                    "give --frequency HZ"
                )
            frequency = 2.0 * np.pi * record.frequency
    return Scale(amplitude, frequency)
