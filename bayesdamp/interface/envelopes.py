"""Compute the answer on an envelope (amplitude against time), and the verdict on several envelopes of one specimen."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from threadpoolctl import threadpool_limits

from bayesdamp.inference.envelope.decay import free_decay
from bayesdamp.inference.envelope.posterior import RateLikelihood
from bayesdamp.inference.envelope.sums import distinguishable_sums, list_assumptions
from bayesdamp.interface.answer import Answer
from bayesdamp.physics.amplitude import FORMS, SUMS
from bayesdamp.records.envelope.record import EnvelopeRecord
from bayesdamp.records.envelope.window import EnvelopeWindow
from bayesdamp.serial import join, split
from bayesdamp.store.results import AnswerContent, EnvelopeContent
from bayesdamp.types import Refusal
from bayesdamp.verdict.envelope import EnvelopeAnswer, answer, specimen
from bayesdamp.verdict.parts import Grade
from bayesdamp.verdict.types import Verdict

STORED_READINGS = 4000
"""Approximate number of an envelope's readings (levels against time) that are stored for its figure."""
LIKELIHOOD = "likelihood/"
"""Prefix of the names of the stored arrays that contain likelihoods of decay rates."""


def analyse(
    record: EnvelopeRecord,
    window: EnvelopeWindow | None = None,
    seed: int = 0,
    sums: Sequence[tuple[str, ...]] = (*SUMS, *FORMS),
) -> EnvelopeAnswer:
    """Find the free decay in an envelope, and return the verdict on its damping, its curve, and the rate likelihoods.

    If the envelope does not contain a free decay, the verdict has the grade "no_free_decay", and there are no curve and
    no likelihoods.

    Parameters
    ----------
    record
        The envelope.
    window
        Window of the free decay, as indices of readings; None to find it.
    seed
        Seed of the draws from which intervals are computed.
    sums
        Damping sums to compare, each as the names of its terms; by default the seven sums of viscous, Coulomb and
        quadratic damping, and those of `FORMS`.

    Raises
    ------
    InputError
        If a damping term cannot be used for this envelope: if it dissipates no energy, or needs a frequency or an
        amplitude in rad or m that is not known.
    """
    try:
        # The matrices have about a hundred rows; with more than one BLAS thread this is slower.
        with threadpool_limits(1, "blas"):
            decay, scaled_sums = free_decay(record, window, sums)
            return answer(decay, scaled_sums, seed)
    except Refusal as refusal:
        verdict = Verdict(record.name, Grade.NO_FREE_DECAY, False, "", float("nan"), quantity="envelope")
        return EnvelopeAnswer(replace(verdict, sentence=f"No free decay: {refusal}."))


def answer_envelope(
    record: EnvelopeRecord,
    window: EnvelopeWindow | None,
    sums: Sequence[tuple[str, ...]],
    seed: int,
    repeated: bool,
) -> Answer:
    """Compute the answer on an envelope, with the arrays of its figure.

    Parameters
    ----------
    record
        The envelope.
    window
        Window of the free decay, as indices of readings; None to find it.
    sums
        Damping sums to compare, each as the names of its terms. All seven sums of viscous, Coulomb and quadratic
        damping mean these and those of `FORMS`. Of sums that an envelope cannot distinguish, only the first is
        compared. A sum of terms that it cannot distinguish from each other is left out.
    seed
        Seed of the draws from which intervals are computed.
    repeated
        Whether the record is one of several records of a specimen. The answer then contains, for each damping sum whose
        terms have no inferred parameters besides their coefficients, the likelihood of the decay rates.

    Returns
    -------
    Answer
        Its arrays are `t` in s and `level` in dB of the whole record (about `STORED_READINGS` of them); if there is a
        decay, the fields of `inference.envelope.decay.Curve` as `curve/...`; and those of the likelihoods as
        `likelihood/DAMPING/...`.

    Raises
    ------
    InputError
        If a sum has more than three terms, a term cannot be used for this envelope (see `analyse`), or no sum is left.
    """
    from bayesdamp.report.figures.record import thin_line  # imports slowly

    chosen, left_out = distinguishable_sums(sums)
    result = analyse(record, window, seed, chosen)
    t, level = thin_line(record.t, record.level, STORED_READINGS)
    arrays = {"t": t, "level": level}
    if result.curve is not None:
        arrays |= {f"curve/{name}": values for name, values in vars(result.curve).items()}
    likelihoods = result.likelihoods if repeated else {}
    numbers = {name: split(value, arrays, f"{LIKELIHOOD}{name}") for name, value in likelihoods.items()}
    w = result.verdict.window
    used = record.t.size if w is None else int(np.count_nonzero((record.t >= w.start) & (record.t <= w.stop)))
    about = EnvelopeContent(record.unit, used, numbers, list_assumptions(chosen, left_out))
    return Answer(AnswerContent(result.verdict.to_dict(), envelope=about), arrays)


def specimen_of_envelopes(name: str, answers: Sequence[Answer]) -> Verdict | None:
    """Return the verdict on a specimen from the answers on its envelopes; None if fewer than two contain a decay.

    `name` is that of the specimen. The answers must be computed with `repeated=True`.

    Raises
    ------
    InputError
        If the records with a decay have different units.
    """
    records = []
    for a in answers:
        stored = a.content.envelope.likelihoods if a.content.envelope else {}
        own = {n: join(RateLikelihood, v, a.arrays, f"{LIKELIHOOD}{n}") for n, v in stored.items()}
        records.append(EnvelopeAnswer(a.verdict, likelihoods=own))
    return specimen(name, records)
