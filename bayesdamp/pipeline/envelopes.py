"""Envelopes as records of a study: read from their files, answered, and taken together as one specimen."""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache

from bayesdamp.config import Recording, SignalSpec, Study
from bayesdamp.inference.envelope.sums import Sums, further_terms, weighable
from bayesdamp.interface.envelopes import answer_envelope
from bayesdamp.physics.damping import TERMS, parse_model
from bayesdamp.pipeline.keys import task_key
from bayesdamp.pipeline.records.records import RecordCell
from bayesdamp.pipeline.tasks import Product
from bayesdamp.plugins import sources_below
from bayesdamp.records.envelope.reading import read_envelope
from bayesdamp.records.envelope.record import EnvelopeRecord
from bayesdamp.records.envelope.scale import scale_of
from bayesdamp.records.envelope.window import Window, bounded
from bayesdamp.serial import split
from bayesdamp.store import Store, sha256
from bayesdamp.types import InputError, Refusal

KEPT = 2000
"""Records that stay in memory, some 100 kB each."""


def read_recording(source: Recording, name: str) -> tuple[EnvelopeRecord, Window | None]:
    """Return an envelope under a name, and the window that was asked for. Raises InputError."""
    record = _read(source, source.path.stat().st_mtime_ns)
    first, last = (None if isinstance(end, str) else end for end in (source.start, source.stop))
    try:
        window = None if first is last is None else bounded(record.t, record.level, first, last)
    except Refusal as refusal:
        raise InputError(f"{record.name}: {refusal}") from None
    return replace(record, name=name), window


@lru_cache(maxsize=KEPT)
def _read(source: Recording, changed: int) -> EnvelopeRecord:
    """Return the envelope in a file. changed: when the file was; a command checks its files before a run reads them."""
    del changed
    return read_envelope(
        source.path,
        time=source.time,
        value=source.angle,
        rate=source.rate,
        unit=source.unit or None,
        frequency=source.frequency,
    )


def check_recording(study: Study, spec: SignalSpec) -> None:
    """Read an envelope and check that its damping sums can be weighed on it. Raises InputError."""
    assert isinstance(spec.source, Recording)
    record, _ = read_recording(spec.source, spec.name)
    sums, _ = weighable([parse_model(name) for name in study.dampings(spec)])
    if further_terms(sums):
        scale_of(record, sums, 0.0)


class EnvelopeCell(RecordCell):
    """The verdict on an envelope, as `answer/SIGNAL/0`.

    Its key is of the file's content, the signal's table, the question, and the source of terms and readers.
    """

    def __init__(self, study: Study, spec: SignalSpec, store: Store) -> None:
        super().__init__("answer", study, spec, 0, store)

    @property
    def sums(self) -> Sums:
        """The damping sums that are asked for."""
        return tuple(parse_model(name) for name in self.study.dampings(self.spec))

    def _key(self) -> str:
        assert isinstance(self.spec.source, Recording)
        read = {k: v for k, v in split(self.spec.source).items() if k not in ("file", "path")}
        own = [*map(TERMS.source, further_terms(self.sums)), *sources_below("bayesdamp.records")]
        content, repeated = sha256(self.spec.source.path), bool(self.spec.specimen)
        parts = (self.spec.name, read, content, self.sums, self.study.seed, repeated)
        return task_key("envelope", *parts, own)

    def product(self) -> Product:
        """The verdict with what it rests on."""
        assert isinstance(self.spec.source, Recording)
        record, window = read_recording(self.spec.source, self.spec.name)
        result = answer_envelope(record, window, self.sums, self.study.seed, bool(self.spec.specimen))
        return Product(result.content, result.arrays)
