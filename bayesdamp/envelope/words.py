"""A result in one sentence."""

from __future__ import annotations

from dataclasses import replace

from bayesdamp.envelope.record import EnvelopeRecord
from bayesdamp.envelope.results import EnvelopeResult


def no_decay(name, why):
    return f"{name}: no free decay: {why}"


def sentence(found: EnvelopeResult, record: EnvelopeRecord) -> EnvelopeResult:
    return replace(found, sentence="x")
