"""Read the envelopes (recorded amplitudes or levels) of a study, and compare damping models on them."""

from dataclasses import replace
from functools import lru_cache

from bayesdamp.config import Recording, SignalSpec, Study
from bayesdamp.inference.envelope.sums import Sums, distinguishable_sums, further_terms
from bayesdamp.interface.envelopes import answer_envelope
from bayesdamp.physics.damping import TERMS, parse_model
from bayesdamp.pipeline.records import StudyRecord
from bayesdamp.pipeline.tasks import Product, task_key
from bayesdamp.plugins import sources_below
from bayesdamp.records.envelope.record import EnvelopeRecord, read_envelope, scale_of
from bayesdamp.records.envelope.window import EnvelopeWindow, window_between
from bayesdamp.serial import split
from bayesdamp.store.results import sha256
from bayesdamp.types import InputError, Refusal

CACHED_ENVELOPES = 2000
"""Largest number of envelopes that are cached in memory; each needs about 100 kB."""


def read_recording(source: Recording, name: str) -> tuple[EnvelopeRecord, EnvelopeWindow | None]:
    """Read an envelope from its file, and return it with the window (the part with the decay) that the study states.

    The envelope gets the name `name`. If the study states only the start or only the stop, the other end is searched
    for; if it states neither, the window is None. Raises InputError if the file cannot be read, if the window contains
    too few readings, or if the search for the other end finds no decay.
    """
    record = _read(source, source.path.stat().st_mtime_ns)
    first, last = (None if isinstance(end, str) else end for end in (source.start, source.stop))
    try:
        window = None if first is last is None else window_between(record.t, record.level, first, last)
    except Refusal as refusal:
        raise InputError(f"{record.name}: {refusal}") from None
    return replace(record, name=name), window


@lru_cache(maxsize=CACHED_ENVELOPES)
def _read(source: Recording, changed: int) -> EnvelopeRecord:
    """Read the envelope in a file, or take it from the cache, because a run reads each file twice.

    `changed` is the time at which the file was last modified. It is only a key of the cache, so that a file that has
    changed is read again.
    """
    del changed
    return read_envelope(
        source.path,
        time=source.time,
        value=source.angle,
        rate=source.rate,
        unit=source.unit or None,
        frequency=source.frequency,
    )


def _sums(study: Study, spec: SignalSpec) -> Sums:
    """Return the sums of damping terms that the study compares on a signal, each as a tuple of names."""
    return tuple(parse_model(name) for name in study.dampings(spec))


def check_recording(study: Study, spec: SignalSpec) -> None:
    """Check that an envelope can be read, and that the study's sums of damping terms can be compared on it.

    Return nothing. Sums that an envelope cannot distinguish from others are not an error; they are left out later.

    Raises
    ------
    InputError
        If the envelope or its window is unusable (see `read_recording`), if a sum has more than `MOST_TERMS` terms, if
        a term dissipates no energy, if no sum is left, or if a term needs a frequency or an amplitude in rad or m that
        is not known.
    """
    assert isinstance(spec.source, Recording)
    record, _ = read_recording(spec.source, spec.name)
    sums, _ = distinguishable_sums(_sums(study, spec))
    if further_terms(sums):
        scale_of(record, sums, 0.0)


def envelope_key(record: StudyRecord) -> str:
    """Return the key (hash of all inputs) of the task `answer/SIGNAL/0` of an envelope.

    It depends on the content of the file, on the settings of the signal and the study, and on the source code of the
    comparison, the damping terms and the readers.
    """
    study, spec, source = record.study, record.spec, record.spec.source
    assert isinstance(source, Recording)

    def compute() -> str:
        sums = _sums(study, spec)
        settings = {k: v for k, v in split(source).items() if k not in ("file", "path")}
        sources = [*map(TERMS.source, further_terms(sums)), *sources_below("bayesdamp.records")]
        parts = (spec.name, settings, sha256(source.path), sums, study.seed, bool(spec.specimen))
        return task_key("envelope", *parts, sources)

    return record.store.key(f"answer/{record.name}", (study, spec), compute)


def compute_envelope(study: Study, spec: SignalSpec) -> Product:
    """Compute the answer on an envelope: compare its damping models, and form the verdict.

    The content of the result is an `AnswerContent`: the verdict and, in `envelope`, further values. The arrays are
    those of `answer_envelope`. An end of the decay that the study does not state is searched for. If it states neither
    end and no decay is found, the verdict says so. Raises InputError for the reasons that `check_recording` states.
    """
    assert isinstance(spec.source, Recording)
    record, window = read_recording(spec.source, spec.name)
    result = answer_envelope(record, window, _sums(study, spec), study.seed, bool(spec.specimen))
    return Product(result.content, result.arrays)
