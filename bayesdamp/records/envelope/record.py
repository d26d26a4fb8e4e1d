"""A record of an envelope: reading it from a file, its levels, and their scale in units of a motion."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from bayesdamp.physics.amplitude import Scale, scales_needed
from bayesdamp.physics.damping import TERMS
from bayesdamp.records.read import ColumnName, read_record
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
HEAD = 8192
"""Bytes in which a file's header and the names of its columns are looked for."""
_HERTZ = {"hz": 1.0, "khz": 1e3, "mhz": 1e6, "ghz": 1e9}


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


def is_envelope(path: Path, value: ColumnName | None = None, unit: str | None = None) -> bool:
    """Return whether a file's levels are those of an envelope: their unit, or their column's name, is dB or dBm."""
    if unit is not None:
        return unit in DECIBELS
    if isinstance(value, str) and not value.isdigit():
        return unit_in(value) in DECIBELS
    if not path.is_file():
        return False
    try:
        with path.open("rb") as file:
            lines = file.read(HEAD).decode("latin-1").splitlines()
    except OSError:  # reported when the file is read
        return False
    named = [line for line in lines if re.search(r"[A-Za-z]{2}", line)]
    return bool(named) and unit_in(named[-1]) in DECIBELS


def are_envelopes(
    paths: Sequence[Path],
    value: ColumnName | None = None,
    unit: str | None = None,
    quantity: str | None = None,
) -> bool:
    """Return whether records are envelopes: as `quantity` says, else as `is_envelope` of each.

    Raises
    ------
    InputError
        Where some are and some are not.
    """
    if quantity is not None:
        return quantity == "envelope"
    are = [is_envelope(path, value, unit) for path in paths]
    if any(are) and not all(are):
        envelope, other = paths[are.index(True)], paths[are.index(False)]
        raise InputError(
            f"{envelope.name} is an envelope in dB, {other.name} does not look like one; compare them in separate "
            "calls, or give --quantity envelope for all"
        )
    return all(are)


def read_envelope(
    path: Path | str,
    *,
    time: ColumnName | None = None,
    value: ColumnName | None = None,
    rate: float | None = None,
    unit: str | None = None,
    frequency: float | None = None,
) -> EnvelopeRecord:
    """Read a record of which only the envelope is known: amplitudes, powers, or levels in dB.

    Parameters
    ----------
    path
        Of the file.
    time, value
        Columns by name or number from 1, else the first and the second of two.
    rate
        In Hz, for a file without times.
    unit
        Of the readings, else as the column's name says: dB, dBm and such are levels, W and such powers, any other an
        amplitude.
    frequency
        Of the oscillation in Hz, else as the file's head says (`% Frequency [Hz]: 1562325`).

    Raises
    ------
    InputError
        Where the file cannot be read, or its readings are not those of an envelope.
    """
    path = Path(path)
    raw = read_record(path, time=time, value=value, rate=rate)
    t = raw.t if raw.t is not None else np.arange(raw.y.size) / (raw.rate or 1.0)
    about = replace(raw.provenance, header_lines=0)  # they are read
    facts = {name: str(fact) for name, fact in about.facts.items()}
    column = about.value_column
    bracketed = re.search(r"[\[(]([^\])]+)[\])]\s*$", column)
    in_brackets = bracketed[1].strip() if bracketed else ""
    chosen = unit or unit_in(column) or in_brackets or "units"
    for name, text in facts.items() if frequency is None else ():
        if not re.search(r"\bfrequency\b", name, re.IGNORECASE) or re.search("sampl", name, re.IGNORECASE):
            continue
        hertz = re.search(r"\b([kMG]?Hz)\b", f"{name} {text}", re.IGNORECASE)
        number = re.match(r"[+-]?\d+(\.\d*)?([eE][+-]?\d+)?", text)
        if number and float(number[0]) > 0:
            frequency = float(number[0]) * (_HERTZ[hertz[1].lower()] if hertz else 1.0)
            break
    return made_record(path.name, t, raw.y, chosen, frequency, facts, about.sentences)


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
