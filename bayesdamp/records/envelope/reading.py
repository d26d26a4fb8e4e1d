"""Reading an envelope out of a file."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from bayesdamp.records.envelope.record import DECIBELS, EnvelopeRecord, made_record, unit_in
from bayesdamp.records.read import ColumnName, read_record
from bayesdamp.types import InputError

HEAD = 8192
"""Bytes in which a file's header and the names of its columns are looked for."""
_HERTZ = {"hz": 1.0, "khz": 1e3, "mhz": 1e6, "ghz": 1e9}


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
    frequency = frequency if frequency is not None else _stated_frequency(facts)
    return made_record(path.name, t, raw.y, chosen, frequency, facts, about.said)


def _stated_frequency(facts: dict[str, str]) -> float | None:
    """Return the oscillation's frequency in Hz that a fact states; None where none does."""
    for name, text in facts.items():
        if not re.search(r"\bfrequency\b", name, re.IGNORECASE) or re.search("sampl", name, re.IGNORECASE):
            continue
        unit = re.search(r"\b([kMG]?Hz)\b", f"{name} {text}", re.IGNORECASE)
        number = re.match(r"[+-]?\d+(\.\d*)?([eE][+-]?\d+)?", text)
        if number and float(number[0]) > 0:
            return float(number[0]) * (_HERTZ[unit[1].lower()] if unit else 1.0)
    return None
