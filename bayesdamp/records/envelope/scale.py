"""What a damping term's own parameters are relative to, in a record whose unit may be none of a motion's."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from bayesdamp.physics.amplitude.loss import Scale, scales_needed
from bayesdamp.physics.damping import TERMS
from bayesdamp.records.envelope.record import POWER, EnvelopeRecord
from bayesdamp.types import InputError
from bayesdamp.units import UNITS


def scale_of(record: EnvelopeRecord, sums: Sequence[tuple[str, ...]], log_amplitude: float) -> Scale:
    """The amplitude at the start, whose ln in the record's unit is given, in rad or m, and the frequency in rad/s,
    where a term of these sums needs them; 1 where none does.

    Raises InputError where one does and they are not known.
    """
    amplitude = frequency = 1.0
    for name in dict.fromkeys(term for terms in sums for term in terms):
        by_amplitude, by_frequency = scales_needed(TERMS.get(name))
        if by_amplitude:
            amplitude = float(np.exp(log_amplitude)) * _factor(record, name)
        if by_frequency:
            if record.frequency is None:
                raise InputError(
                    f"{record.name}: damping term {name!r} has a time of its own, and the frequency is not known; "
                    "give --frequency HZ"
                )
            frequency = 2.0 * np.pi * record.frequency
    return Scale(amplitude, frequency)


def _factor(record: EnvelopeRecord, term: str) -> float:
    """rad or m in one of the record's unit of amplitude."""
    unit = record.unit
    if unit in POWER:
        unit = unit.replace("^2", "").removesuffix("2")
    known = UNITS.get(unit)
    if known is None or not known.physical or known.quantity is not None:
        raise InputError(
            f"{record.name}: damping term {term!r} has a size of its own, in rad or m, and amplitudes are in "
            f"{record.unit}; give them as a motion's with --unit (mm, deg, ...), or leave the term out"
        )
    return known.factor
