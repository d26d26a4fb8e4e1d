"""Answer which damping an envelope has, and several envelopes of one specimen."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from threadpoolctl import threadpool_limits

from bayesdamp.inference.envelope.decay import free_decay
from bayesdamp.inference.envelope.posterior import RateLikelihood
from bayesdamp.inference.envelope.sums import assumed, weighable
from bayesdamp.interface.answer import Answer
from bayesdamp.physics.amplitude import SUMS
from bayesdamp.records.envelope.record import EnvelopeRecord
from bayesdamp.records.envelope.window import EnvelopeWindow
from bayesdamp.serial import join, split
from bayesdamp.store.contents import AnswerContent, EnvelopeContent
from bayesdamp.types import Refusal
from bayesdamp.verdict.envelope import EnvelopeAnswer, answer, specimen
from bayesdamp.verdict.parts import Grade
from bayesdamp.verdict.types import Verdict

POINTS = 4000
"""Approximate number of readings that are stored for the picture of a record."""
LIKELIHOOD, PICTURE = "likelihood/", "picture"
"""Names of arrays: prefix of the likelihoods of the rates, and the PNG of the picture as bytes."""


def analyse(
    record: EnvelopeRecord,
    window: EnvelopeWindow | None = None,
    seed: int = 0,
    sums: Sequence[tuple[str, ...]] = SUMS,
) -> EnvelopeAnswer:
    """Return the damping of an envelope with its uncertainty; a refusal is a verdict of grade "no_free_decay".

    Parameters
    ----------
    record
        The envelope.
    window
        Window of the free decay; None to find it.
    seed
        Seed of the draws that intervals follow from.
    sums
        Sums of registered damping terms by their names, three terms at most.

    Raises
    ------
    InputError
        Where the scale of a term is not known.
    """
    try:
        # For matrices of a hundred rows, threads of a linear algebra library only wait for each other.
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
    window: EnvelopeWindow | None,
    sums: Sequence[tuple[str, ...]],
    seed: int,
    repeated: bool,
) -> Answer:
    """Return the answer on an envelope under these sums, with its picture.

    Parameters
    ----------
    record
        The envelope.
    window
        Window of the free decay; None to find it.
    sums
        Damping sums by their terms' names.
    seed
        Seed of the draws that intervals follow from.
    repeated
        Whether it is one of several records of a specimen.

    Raises
    ------
    InputError
        Where the sums cannot be weighed on this record.
    """
    from bayesdamp.report.figures.answer import picture  # imports slowly
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
    numbers = {name: split(value, arrays, f"{LIKELIHOOD}{name}") for name, value in likelihoods.items()}
    w = result.verdict.window
    used = record.t.size if w is None else int(np.count_nonzero((record.t >= w.start) & (record.t <= w.stop)))
    about = EnvelopeContent(record.unit, used, numbers, assumed(chosen, left_out))
    return Answer(AnswerContent(result.verdict.to_dict(), envelope=about), arrays)


def specimen_of_envelopes(name: str, answers: Sequence[Answer]) -> Verdict | None:
    """Return the verdict on a specimen from the answers on its envelopes; None where fewer than two have a decay.

    Raises
    ------
    InputError
        Where the records have different units.
    """
    records = []
    for a in answers:
        stored = a.content.envelope.likelihoods if a.content.envelope else {}
        own = {n: join(RateLikelihood, v, a.arrays, f"{LIKELIHOOD}{n}") for n, v in stored.items()}
        records.append(EnvelopeAnswer(a.verdict, likelihoods=own))
    return specimen(name, records)
