"""A study's recording as its file has it."""

from __future__ import annotations

from bayesdamp.config import Recording
from bayesdamp.records.cleaning.decimate import decimated
from bayesdamp.records.read import read_record
from bayesdamp.records.record import RawRecord


def recorded(source: Recording) -> RawRecord:
    """The record that a study asks for, thinned where it has far more samples than it needs. Raises InputError."""
    raw = read_record(
        source.path,
        time=source.time,
        value=source.angle,
        rate=source.rate,
        run=source.run,
        channel=source.channel,
        time_unit=source.time_unit,
    )
    return decimated(raw)
