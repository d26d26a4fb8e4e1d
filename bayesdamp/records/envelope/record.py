"""Read an envelope record (amplitude, power or level of an oscillation against time), and convert it to levels in dB.

The amplitude (rad or m) and the frequency are determined too, for damping terms that depend on them (`scale_of`).
"""

import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from bayesdamp.physics.amplitude import Scale, scales_needed
from bayesdamp.physics.damping import TERMS
from bayesdamp.records.files.contents import hertz_written
from bayesdamp.records.read import ColumnName, read_record
from bayesdamp.types import DECIBELS, UNITS, InputError

POWER = ("GW", "MW", "kW", "W", "mW", "uW", "nW", "pW", "fW", "V^2", "V2", "m^2", "m2")
"""Units of power, which is proportional to the square of the amplitude."""
MAX_NEGATIVE = 0.2
"""If a reading is negative by more than this fraction of the largest absolute reading, the record is refused: it is not
an envelope. Smaller negative readings count as noise (conventional)."""
LARGEST_LEVEL = 1000.0
"""A record with a level beyond ± this value in dB (50 decades of the amplitude) is refused. In a record in a linear
unit, readings more than 50 decades below the largest one count as zero (conventional)."""
HEAD_BYTES = 8192
"""Number of bytes at the start of a file in which the names of its columns are searched for a unit such as dB or
dBm."""


@dataclass(frozen=True, eq=False)
class EnvelopeRecord:
    """An envelope record: the level (amplitude in dB) of an oscillation against time. Instances compare by identity.

    Parameters
    ----------
    name
        Name of the file.
    t
        Times in s, shape (n,), increasing.
    level
        Level in dB, shape (n,): the recorded value itself if `unit` is one of DECIBELS (dB, dBm, ...), 10 log10 of the
        power in `unit` if that is one of POWER (W, V^2, ...), else 20 log10 of the amplitude in `unit`.
    unit
        Unit of the recorded values.
    frequency
        Frequency of the oscillation in Hz, or None if unknown.
    notes
        Sentences on how the record was read.
    """

    name: str
    t: np.ndarray
    level: np.ndarray
    unit: str
    frequency: float | None = None
    notes: tuple[str, ...] = ()

    @property
    def logarithmic(self) -> bool:
        """Return whether the record is in dB, so that the absolute amplitude is unknown."""
        return self.unit in DECIBELS

    def amplitude(self, level: float) -> tuple[float, str]:
        """Convert a level (dB) to the recorded amplitude or power, and return it with its unit.

        In a record in dB, the recorded value is the level itself, which is returned unchanged.
        """
        if self.logarithmic:
            return level, self.unit
        return 10.0 ** (level / (10.0 if self.unit in POWER else 20.0)), self.unit


def unit_in(name: str) -> str | None:
    """Return the unit of DECIBELS (dB, dBm, ...) or POWER (W, V^2, ...) that a column's name contains.

    The result is None if the name contains no such unit or several. Upper and lower case are distinguished only in "W",
    and between "mW" and "MW"; the result is written as in these lists.
    """
    words = re.findall(r"[A-Za-z]+(?:\^?2)?", name.replace("µ", "u").replace("μ", "u"))
    known = {unit.lower(): unit for unit in (*DECIBELS, *POWER) if len(unit) > 1}
    units = {word if word in POWER else known[word.lower()] for word in words if word.lower() in known}
    units |= {"W"} if re.search(r"[\[(/]\s*W\s*[\])]?$", name) else set()
    return units.pop() if len(units) == 1 else None


def make_record(
    name: str,
    t: np.ndarray,
    y: np.ndarray,
    unit: str,
    frequency: float | None = None,
    notes: tuple[str, ...] = (),
) -> EnvelopeRecord:
    """Make an envelope record from times and readings.

    A reading with the same time as the reading before is left out. Amplitudes and powers of zero (or too small, see
    `LARGEST_LEVEL`) are left out too, and small negative ones are replaced by their absolute values. The record's notes
    give the number of these readings.

    Parameters
    ----------
    name
        Name of the file.
    t, y
        Times in s and readings in `unit`, shape (n,).
    unit
        Unit of the readings. They are levels if it is one of DECIBELS (dB, dBm, ...), powers if it is one of POWER (W,
        V^2, ...), else amplitudes.
    frequency
        Frequency of the oscillation in Hz; None if it is not known.
    notes
        Sentences on how the record was read.

    Raises
    ------
    InputError
        If there are no readings other than zero, times decrease, the frequency is not positive, or the readings cannot
        be an envelope.
    """
    if not t.size:
        raise InputError(f"{name}: there are no readings")
    if frequency is not None and not (np.isfinite(frequency) and frequency > 0):
        raise InputError(f"{name}: frequency must be positive, in Hz, not {frequency:g}")
    steps = np.diff(t)
    if np.any(steps < 0):
        bad = int(np.flatnonzero(steps < 0)[0]) + 1
        raise InputError(f"{name}: time goes back at reading {bad + 1} ({t[bad]:g} s); times must increase")
    keep = np.concatenate([[True], steps > 0])
    remarks = list(notes)
    if not keep.all():
        remarks.append(f"{int((~keep).sum())} readings with the same time as the one before are left out.")
    if unit in DECIBELS:
        level = y.astype(float)
        far = level[np.argmax(np.abs(level))]
        if abs(far) > LARGEST_LEVEL:
            raise InputError(
                f"{name}: a level of {far:g} {unit} is implausible; is it the right column, and is it in {unit}?"
            )
    else:
        size = np.abs(y)
        if not size.any():
            raise InputError(f"{name}: all readings are zero")
        size[size < 10.0 ** (-LARGEST_LEVEL / 20.0) * size.max()] = 0.0
        if np.any(y < -MAX_NEGATIVE * size.max()):
            raise InputError(
                f"{name}: readings below zero ({y.min():g} to {y.max():g}) are not amplitudes; "
                "give --unit dB if they are levels, or leave out --quantity envelope if they are an oscillation"
            )
        if np.any(y < 0):
            remarks.append(
                f"The absolute value is used for {int((y < 0).sum())} readings below zero (noise)."
            )
        if np.any(size == 0):
            remarks.append(f"{int((size == 0).sum())} readings that are zero are left out.")
        keep &= size != 0
        level = (10.0 if unit in POWER else 20.0) * np.log10(np.where(size != 0, size, 1.0))
    t, level = t[keep].astype(float), level[keep]
    return EnvelopeRecord(name, t, level, unit, frequency, tuple(remarks))


def is_envelope(path: Path, value: ColumnName | None = None, unit: str | None = None) -> bool:
    """Return whether a file is recognised as an envelope: whether its unit is one of DECIBELS (dB, dBm, ...).

    The first of these that is given states the unit: the argument `unit`; the column name `value`, unless it is a
    number; the file's header, which is the last line with two successive letters in the first `HEAD_BYTES` bytes. The
    result is False for a file that cannot be opened.
    """
    if unit is not None:
        return unit in DECIBELS
    if isinstance(value, str) and not value.isdigit():
        return unit_in(value) in DECIBELS
    if not path.is_file():
        return False
    try:
        with path.open("rb") as file:
            lines = file.read(HEAD_BYTES).decode("latin-1").splitlines()
    except OSError:  # the error is reported later, when the file is read
        return False
    named = [line for line in lines if re.search(r"[A-Za-z]{2}", line)]
    return bool(named) and unit_in(named[-1]) in DECIBELS


def are_envelopes(
    paths: Sequence[Path],
    value: ColumnName | None = None,
    unit: str | None = None,
    quantity: str | None = None,
) -> bool:
    """Return whether files are envelopes (records of the amplitude alone).

    If the user gives a `quantity`, the result is whether it is "envelope". If it is None, the units of the files decide
    (`is_envelope`). value, unit: column name and unit of the readings that the user gives for all files, or None.

    Raises
    ------
    InputError
        If `quantity` is None, and some files are envelopes and some are not.
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
    """Read an envelope record from a file: amplitudes, powers, or levels in dB of an oscillation.

    Parameters
    ----------
    path
        The file.
    time, value
        Columns by name or number from 1; by default chosen as in `read_record`.
    rate
        Sampling rate in Hz; replaces the times and the rate of the file. Only one of `time` and `rate` can be given.
    unit
        Unit of the readings; by default the unit in the column's name, or else the text in brackets at the end of the
        name, or else "units". The readings are levels if the unit is one of DECIBELS (dB, dBm, ...), powers if it is
        one of POWER (W, V^2, ...), else amplitudes.
    frequency
        Frequency of the oscillation in Hz; by default that in the header of the file (`% Frequency [Hz]: 1562325`).

    Returns
    -------
    EnvelopeRecord
        The record.

    Raises
    ------
    InputError
        If the file cannot be read, an argument is invalid, or the readings cannot be an envelope.
    """
    path = Path(path)
    raw = read_record(path, time=time, value=value, rate=rate)
    t = raw.t if raw.t is not None else np.arange(raw.y.size) / (raw.rate or 1.0)
    # No note on skipped header lines is needed, because the facts in them have been read.
    about = replace(raw.provenance, header_lines=0)
    column = about.value_column
    bracketed = re.search(r"[\[(]([^\])]+)[\])]\s*$", column)
    chosen = unit or unit_in(column) or (bracketed and bracketed[1].strip()) or "units"
    for name, text in about.facts.items() if frequency is None else ():
        if not re.search(r"\bfrequency\b", name, re.IGNORECASE) or re.search("sampl", name, re.IGNORECASE):
            continue
        hertz = re.search(r"\b([kMG]?Hz)\b", f"{name} {text}", re.IGNORECASE)
        scale = hertz_written(hertz[1] if hertz else "")
        number = re.match(r"[+-]?\d+(\.\d*)?([eE][+-]?\d+)?", str(text))
        if scale and number and float(number[0]) > 0:
            frequency = float(number[0]) * scale
            break
    return make_record(path.name, t, raw.y, chosen, frequency, about.sentences)


def scale_of(record: EnvelopeRecord, sums: Sequence[tuple[str, ...]], log_amplitude: float) -> Scale:
    """Return the start amplitude (rad or m) and the frequency (rad/s) of a record, if its damping terms need them.

    Parameters
    ----------
    record
        The record.
    sums
        Sums of damping terms, each a tuple of the names of its terms.
    log_amplitude
        ln of the amplitude at the start, in the unit of the record (for a power in m^2, in m).

    Returns
    -------
    Scale
        Amplitude and frequency; each is 1 if no term needs it.

    Raises
    ------
    InputError
        If a term needs the amplitude or the frequency and it is unknown.
    """
    amplitude = frequency = 1.0
    for name in dict.fromkeys(term for terms in sums for term in terms):
        by_amplitude, by_frequency = scales_needed(TERMS.get(name))
        if by_amplitude:
            unit = record.unit.replace("^2", "").removesuffix("2") if record.unit in POWER else record.unit
            known = UNITS.get(unit)
            if known is None or not known.physical or known.quantity is not None:
                raise InputError(
                    f"{record.name}: damping term {name!r} depends on the amplitude in rad or m, but the amplitudes "
                    f"are in {record.unit}; give a unit of displacement with --unit (mm, deg, ...), or leave the "
                    "term out"
                )
            amplitude = float(np.exp(log_amplitude)) * known.factor
        if by_frequency:
            if record.frequency is None:
                raise InputError(
                    f"{record.name}: damping term {name!r} depends on the frequency, which is not known; "
                    "give --frequency HZ"
                )
            frequency = 2.0 * np.pi * record.frequency
    return Scale(amplitude, frequency)
