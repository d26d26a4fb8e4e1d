"""A study's recording as its file has it."""

from __future__ import annotations

from functools import lru_cache

from bayesdamp.config import Recording
from bayesdamp.records.cleaning.clean import clean
from bayesdamp.records.cleaning.decimate import decimated
from bayesdamp.records.findings import question
from bayesdamp.records.read import read_record
from bayesdamp.records.record import RawRecord
from bayesdamp.records.wrapped import unwrapped
from bayesdamp.types import InputError, Signal


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
    doubt = question(raw, source.unit, source.quantity, given=False)  # "rad" may be the default
    if doubt is not None:
        raise InputError(doubt.sentence, arguments=doubt.arguments)
    return decimated(unwrapped(raw, source.unit, source.quantity))


def of_file(error: InputError, source: Recording) -> InputError:
    """What is wrong with a record, told by its file as the study has it, and not by a name that was given it."""
    return InputError(error.what, source.file, error.at, error.arguments)


def cleaned(source: Recording, name: str) -> tuple[RawRecord, Signal]:
    """The record and its free decay, under a name. Raises InputError.

    What was made last is kept, until the file changes: a run looks at its inputs before it begins.
    """
    try:
        status = source.path.stat()
    except OSError:
        return _cleaned(source, name, ())
    return _cleaned(source, name, (status.st_mtime_ns, status.st_size, status.st_ino))


@lru_cache(maxsize=1)
def _cleaned(source: Recording, name: str, stamp: tuple[int, ...]) -> tuple[RawRecord, Signal]:
    del stamp
    raw = recorded(source)
    options = {k: getattr(source, k) for k in ("unit", "quantity", "clock", "start", "stop")}
    return raw, clean(raw, name=name, **options)
