"""Records of which only the envelope is known: amplitudes, powers, levels in dB.

It finds the free decay, infers floor and scatter, and weighs sums of viscous, Coulomb and quadratic damping, each of
which may hold approximately. It fits no oscillation.
"""

from bayesdamp.envelope.analysis import analyse
from bayesdamp.records.envelope.reading import are_envelopes, is_envelope, read_envelope
from bayesdamp.records.envelope.record import EnvelopeRecord, made_record
from bayesdamp.verdict.envelope.answer import Answer

__all__ = [
    "Answer",
    "EnvelopeRecord",
    "analyse",
    "are_envelopes",
    "is_envelope",
    "made_record",
    "read_envelope",
]
