"""The verdicts that the pages judge: on simulated records, so that probabilities are not capped."""

from __future__ import annotations

from collections.abc import Sequence

from bayesdamp.interface.answer import answer
from bayesdamp.types import Signal
from bayesdamp.verdict.types import Verdict


def sampled_verdict(
    signal: Signal, amplitudes: Sequence[float] | None = None, deviation: str = "auto"
) -> Verdict:
    """Return the verdict with motions sampled."""
    return answer(signal, amplitudes, deviation=deviation, measured=False).verdict


def quick_verdict(
    signal: Signal, amplitudes: Sequence[float] | None = None, deviation: str = "auto"
) -> Verdict:
    """Return the verdict of linear models alone."""
    return answer(signal, amplitudes, deviation=deviation, measured=False, sample=False).verdict
