"""Compute the verdicts that the pages judge. Records count as simulated, so that their probabilities are not capped."""

from __future__ import annotations

from collections.abc import Sequence

from bayesdamp.interface.answer import answer
from bayesdamp.types import Signal
from bayesdamp.verdict.types import Verdict


def sampled_verdict(
    signal: Signal, amplitudes: Sequence[float] | None = None, deviation: str = "auto"
) -> Verdict:
    """Return the verdict on a record from sequential Monte Carlo with the full equation of motion."""
    return answer(signal, amplitudes, deviation=deviation, measured=False).verdict


def quick_verdict(
    signal: Signal, amplitudes: Sequence[float] | None = None, deviation: str = "auto"
) -> Verdict:
    """Return the verdict on a record from linear approximations, without sampling."""
    return answer(signal, amplitudes, deviation=deviation, measured=False, sample=False).verdict
