"""Envelopes as records of a study: read from their files, answered, and taken together as one specimen."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import lru_cache

import numpy as np
from threadpoolctl import threadpool_limits

from bayesdamp.config import Recording, SignalSpec, Study
from bayesdamp.inference.envelope.analysis import free_decay
from bayesdamp.inference.envelope.dampings import Sums, assumed, further_terms, weighable
from bayesdamp.inference.envelope.likelihood import RateLikelihood
from bayesdamp.physics.amplitude.laws import SUMS
from bayesdamp.physics.damping import TERMS, parse_model
from bayesdamp.pipeline.answer import Answer
from bayesdamp.pipeline.keys import task_key
from bayesdamp.pipeline.records.answering import answer_of
from bayesdamp.pipeline.records.records import RecordCell
from bayesdamp.pipeline.tasks import Product
from bayesdamp.plugins import sources_below
from bayesdamp.records.envelope.reading import read_envelope
from bayesdamp.records.envelope.record import EnvelopeRecord
from bayesdamp.records.envelope.scale import scale_of
from bayesdamp.records.envelope.window import Window, bounded
from bayesdamp.serial import join, split
from bayesdamp.store import Store, sha256
from bayesdamp.store.contents.answers import AnswerContent, EnvelopeContent
from bayesdamp.types import InputError, Refusal
from bayesdamp.verdict.envelope.answer import Answer as EnvelopeAnswer
from bayesdamp.verdict.envelope.answer import answer
from bayesdamp.verdict.envelope.specimen import specimen
from bayesdamp.verdict.parts import Grade
from bayesdamp.verdict.types import Verdict

KEPT = 2000
"""Records that stay in memory, some 100 kB each."""
POINTS = 4000
"""Readings of a record that are stored for its picture, about."""
LIKELIHOOD, PICTURE = "likelihood/", "picture"
"""Arrays of an answer: the likelihoods of the rates, and the PNG of its picture as bytes."""


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


def analyse(
    record: EnvelopeRecord,
    window: Window | None = None,
    seed: int = 0,
    sums: Sequence[tuple[str, ...]] = SUMS,
) -> EnvelopeAnswer:
    """Return the damping of an envelope with its uncertainty; a refusal is a verdict of grade "no_free_decay".

    Parameters
    ----------
    record
        As it was read.
    window
        Of the free decay; None where it is to be found.
    seed
        Of the draws that intervals are read from.
    sums
        Of registered damping terms, each by their names, three at most.

    Raises
    ------
    InputError
        Where the scale of a term is not known.
    """
    try:
        # Matrices of a hundred rows: threads of a linear algebra library only wait for each other.
        with threadpool_limits(1, "blas"):
            decay, weighed = free_decay(record, window, sums)
            return answer(decay, weighed, seed)
    except Refusal as refusal:
        why = f"No free decay: {refusal}."
        nan = float("nan")
        return EnvelopeAnswer(
            Verdict(record.name, Grade.NO_FREE_DECAY, False, "", nan, quantity="envelope", sentence=why)
        )


def answer_envelope(
    record: EnvelopeRecord,
    window: Window | None,
    sums: Sequence[tuple[str, ...]],
    seed: int,
    repeated: bool,
) -> Answer:
    """Return the answer on an envelope under these sums, with its picture.

    Parameters
    ----------
    record
        As it was read.
    window
        Of the free decay; None where it is to be found.
    sums
        Damping sums by their terms' names.
    seed
        Of the draws that intervals are read from.
    repeated
        Whether it is one of several records of a specimen.

    Raises
    ------
    InputError
        Where the sums cannot be weighed on this record.
    """
    from bayesdamp.report.figures.envelope import picture  # imports slowly
    from bayesdamp.report.figures.record import thinned

    chosen, left_out = weighable(sums)
    result = analyse(record, window, seed, chosen)
    t, level = thinned(record.t, record.level, POINTS)
    arrays = {"t": t, "level": level}
    if result.curve is not None:
        arrays |= {f"curve/{name}": values for name, values in vars(result.curve).items()}
    drawn = picture(arrays, result.verdict, record.unit if record.logarithmic else f"dB of 1 {record.unit}")
    arrays[PICTURE] = np.frombuffer(drawn, np.uint8)
    likelihoods = result.likelihoods if repeated else {}
    numbers = {name: split(one, arrays, f"{LIKELIHOOD}{name}") for name, one in likelihoods.items()}
    w = result.verdict.window
    used = record.t.size if w is None else int(np.count_nonzero((record.t >= w.start) & (record.t <= w.stop)))
    about = EnvelopeContent(record.unit, used, numbers, assumed(chosen, left_out))
    return Answer(AnswerContent(result.verdict.to_dict(), envelope=about), arrays)


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


def specimen_of_envelopes(name: str, answers: Sequence[Answer]) -> Verdict | None:
    """Return the verdict on a specimen from the answers on its envelopes; None where fewer than two have a decay.

    Raises
    ------
    InputError
        Where the records have different units.
    """
    found = []
    for one in answers:
        stored = one.content.envelope.likelihoods if one.content.envelope else {}
        own = {n: join(RateLikelihood, v, one.arrays, f"{LIKELIHOOD}{n}") for n, v in stored.items()}
        found.append(EnvelopeAnswer(one.verdict, likelihoods=own))
    return specimen(name, found)


def specimen_of_cells(store: Store, name: str, specs: Sequence[SignalSpec]) -> Verdict | None:
    """Return the same from what a run's folder holds."""
    answers = [one for spec in specs if (one := answer_of(store, spec.name, 0)) is not None]
    return specimen_of_envelopes(name, answers)
