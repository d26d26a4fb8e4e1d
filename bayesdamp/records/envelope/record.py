"""An envelope as it was recorded, and its readings as levels."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from bayesdamp.types import InputError

DECIBELS = ("dB", "dBm", "dBV", "dBu", "dBmV", "dBuV", "dBW", "dBA", "dBFS", "dBc")
POWER = ("W", "mW", "uW", "nW", "pW", "V^2", "V2", "m^2", "m2")
"""Units in which a reading is a power: proportional to the square of the amplitude."""
STRONG = 0.2
"""Share of the largest reading beyond which one below zero is none of a floor's."""
LOUDEST = 1000.0
"""dB beyond which, to either side, a level is none: 50 decades of the amplitude. Of readings that are no levels, those
that are so far below the largest are zeros."""


@dataclass(frozen=True, eq=False)
class EnvelopeRecord:
    """A record of an envelope, equal only to itself.

    t: times in s, shape (n,), increasing; level: 20 log10 of the amplitude (10 log10 of the power), shape (n,), in
    dB of `unit`. unit: as recorded. frequency in Hz or None. facts: what the file's head says. notes: how it was read.
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
        """A level as it was recorded, with its unit."""
        if self.logarithmic:
            return level, self.unit
        return 10.0 ** (level / (10.0 if self.unit in POWER else 20.0)), self.unit


def unit_in(name: str) -> str | None:
    """The unit of an envelope that a column's name says: of DECIBELS or POWER; None where it says none of them."""
    words = re.findall(r"[A-Za-z]+(?:\^?2)?", name)
    known = {one.lower(): one for one in DECIBELS} | {one.lower(): one for one in POWER if len(one) > 1}
    found = {known[word.lower()] for word in words if word.lower() in known}
    found |= {"W"} if re.search(r"[\[(/]\s*W\s*[\])]?$", name) else set()
    return found.pop() if len(found) == 1 else None


def made_record(
    name: str,
    t: np.ndarray,
    y: np.ndarray,
    unit: str,
    frequency: float | None = None,
    facts: Mapping[str, str] | None = None,
    notes: tuple[str, ...] = (),
) -> EnvelopeRecord:
    """A record of readings y in this unit at times t (s), both of shape (n,). Raises InputError."""
    if frequency is not None and not (np.isfinite(frequency) and frequency > 0):
        raise InputError(f"{name}: frequency must be positive, in Hz, not {frequency:g}")
    if np.any(np.diff(t) < 0):
        bad = int(np.flatnonzero(np.diff(t) < 0)[0]) + 1
        raise InputError(f"{name}: time goes back at reading {bad + 1} ({t[bad]:g} s); times must increase")
    keep = np.concatenate([[True], np.diff(t) > 0])
    said = list(notes)
    if not keep.all():
        said.append(f"{int((~keep).sum())} readings at the time of the one before are left out.")
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
            said.append(f"{int((y < 0).sum())} readings below zero, of a floor, are taken by their size.")
        if np.any(size == 0):
            said.append(f"{int((size == 0).sum())} readings that are zero are left out.")
        keep &= size != 0
        level = (10.0 if unit in POWER else 20.0) * np.log10(np.where(size != 0, size, 1.0))
    return EnvelopeRecord(
        name, t[keep].astype(float), level[keep], unit, frequency, dict(facts or {}), tuple(said)
    )
